// One Gaussian as a quad around its ellipse on the image plane (METHOD §8: EWA splatting).
// DEGREE and MASKS are defined by the program that compiles this.

precision highp float;
precision highp int;
precision highp sampler2D;
precision highp isampler2D;

// Gaussians in a row of a texture.
const int COLUMNS = 256;
// Added to the diagonal of the covariance, square pixels.
const float DILATION = 0.3;
// Least alpha that is drawn.
const float MIN_ALPHA = 1.0 / 255.0;
// Added to the depth that divides the centre's position.
const float DEPTH_GUARD = 1e-7;
// Bounds of the tangents in the Jacobian, relative to half of the field of view.
const float TANGENT_BOUND = 1.3;

// Four texels a Gaussian: centre and opacity; log-scales, static and dynamic mask; quaternion; base colour and
// brightness mask.
uniform sampler2D before;
uniform sampler2D after;
// Weight of `after`.
uniform float weight;
// Higher colour coefficients in steps, four in a texel.
uniform isampler2D rest;
uniform float restStep;

// From world to camera, OpenCV axes.
uniform mat3 rotation;
uniform vec3 translation;
// The camera's centre.
uniform vec3 eye;
uniform vec2 focal;
uniform vec2 principal;
uniform vec2 size;
uniform float near;

in uint index;

// Position in the ellipse at whose border alpha is MIN_ALPHA: the unit circle.
out vec2 local;
// Logarithm of the opacity over MIN_ALPHA.
flat out float logRatio;
flat out vec3 colour;
flat out float opacity;
#ifdef MASKS
flat out vec3 mask;
#endif

vec4 texel(sampler2D states, int part) {
  int i = int(index);
  return texelFetch(states, ivec2(4 * (i % COLUMNS) + part, i / COLUMNS), 0);
}

// The static and the dynamic mask, packed as bytes into a number below 2^16.
vec2 unpackMasks(float bytes) {
  int both = int(bytes);
  return vec2(both & 255, both >> 8) / 255.0;
}

mat3 rotationOf(vec4 q) {
  float w = q.x, x = q.y, y = q.z, z = q.w;
  // By columns.
  return mat3(
    1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
    2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
    2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}

#if DEGREE > 0
// The coefficient of one basis function for all channels.
vec3 coefficient(int basis) {
  // Three for each function, four in a texel.
  const int TEXELS = (3 * ((DEGREE + 1) * (DEGREE + 1) - 1) + 3) / 4;
  int i = int(index);
  vec3 found;
  for (int channel = 0; channel < 3; channel++) {
    int number = 3 * basis + channel;
    ivec4 four = texelFetch(rest, ivec2(TEXELS * (i % COLUMNS) + number / 4, i / COLUMNS), 0);
    found[channel] = float(four[number % 4]);
  }
  return restStep * found;
}
#endif

// Spherical harmonics in the order and with the signs of 3DGS.
vec3 colourFrom(vec3 base, vec3 d) {
  vec3 sum = 0.5 + 0.28209479177387814 * base;
#if DEGREE > 0
  const float C1 = 0.4886025119029199;
  sum += C1 * (-d.y * coefficient(0) + d.z * coefficient(1) - d.x * coefficient(2));
#endif
#if DEGREE > 1
  float xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
  sum += 1.0925484305920792 * d.x * d.y * coefficient(3);
  sum += -1.0925484305920792 * d.y * d.z * coefficient(4);
  sum += 0.31539156525252005 * (2.0 * zz - xx - yy) * coefficient(5);
  sum += -1.0925484305920792 * d.x * d.z * coefficient(6);
  sum += 0.5462742152960396 * (xx - yy) * coefficient(7);
#endif
#if DEGREE > 2
  sum += -0.5900435899266435 * d.y * (3.0 * xx - yy) * coefficient(8);
  sum += 2.890611442640554 * d.x * d.y * d.z * coefficient(9);
  sum += -0.4570457994644658 * d.y * (4.0 * zz - xx - yy) * coefficient(10);
  sum += 0.3731763325901154 * d.z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * coefficient(11);
  sum += -0.4570457994644658 * d.x * (4.0 * zz - xx - yy) * coefficient(12);
  sum += 1.445305721320277 * d.z * (xx - yy) * coefficient(13);
  sum += -0.5900435899266435 * d.x * (xx - 3.0 * yy) * coefficient(14);
#endif
  return max(sum, 0.0);
}

void main() {
  // Outside the image until it is placed.
  gl_Position = vec4(0.0, 0.0, 2.0, 1.0);
  vec4 centreOpacity = mix(texel(before, 0), texel(after, 0), weight);
  vec3 centre = centreOpacity.xyz;
  opacity = centreOpacity.w;
  logRatio = log(opacity / MIN_ALPHA);
  vec3 point = rotation * centre + translation;
  // Also for numbers that are none.
  if (!(point.z > near) || !(logRatio > 0.0)) {
    return;
  }

  vec4 sizesBefore = texel(before, 1);
  vec4 sizesAfter = texel(after, 1);
  vec3 scales = exp(mix(sizesBefore.xyz, sizesAfter.xyz, weight));
  vec4 quaternion = mix(texel(before, 2), texel(after, 2), weight);
  mat3 axes = rotationOf(quaternion / max(length(quaternion), 1e-6));

  vec2 bound = TANGENT_BOUND * 0.5 * size / focal;
  vec2 tangents = clamp(point.xy / point.z, -bound, bound);
  vec2 zoom = focal / point.z;
  // Rows of the Jacobian times the camera's rotation. `v * rotation` is a row times the matrix.
  vec3 across = zoom.x * (vec3(1.0, 0.0, -tangents.x) * rotation);
  vec3 down = zoom.y * (vec3(0.0, 1.0, -tangents.y) * rotation);
  vec3 f0 = (across * axes) * scales;
  vec3 f1 = (down * axes) * scales;
  float xx = dot(f0, f0) + DILATION;
  float xy = dot(f0, f1);
  float yy = dot(f1, f1) + DILATION;
  // A sum of positive terms, which does not cancel for needles.
  vec3 normal = cross(f0, f1);
  float determinant = dot(normal, normal) + DILATION * (xx + yy) - DILATION * DILATION;

  float middle = 0.5 * (xx + yy);
  float spread = length(vec2(0.5 * (xx - yy), xy));
  float longest = middle + spread;
  float angle = spread > 0.0 ? 0.5 * atan(2.0 * xy, xx - yy) : 0.0;
  vec2 axis = vec2(cos(angle), sin(angle));
  vec2 radii = sqrt(2.0 * logRatio * vec2(longest, determinant / longest));
  local = vec2(gl_VertexID & 1, gl_VertexID >> 1) * 2.0 - 1.0;
  vec2 offset = local.x * radii.x * axis + local.y * radii.y * vec2(-axis.y, axis.x);
  vec2 pixel = focal * point.xy / (point.z + DEPTH_GUARD) + principal + offset;

  vec4 base = mix(texel(before, 3), texel(after, 3), weight);
  colour = colourFrom(base.xyz, normalize(centre - eye));
#ifdef MASKS
  vec2 shares = mix(unpackMasks(sizesBefore.w), unpackMasks(sizesAfter.w), weight);
  mask = vec3(shares.x, base.w, shares.y);
#endif
  gl_Position = vec4(2.0 * pixel.x / size.x - 1.0, 1.0 - 2.0 * pixel.y / size.y, 0.0, 1.0);
}
