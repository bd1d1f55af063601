// The blend of the static and the dynamic branch by the mask (METHOD §1.3, as in an evaluation).

precision highp float;
precision highp int;
precision highp sampler2D;

const int STATIC = 1;
const int DYNAMIC = 2;
const int MASK = 3;

const float BRIGHTNESS_OFFSET = 0.5;
const float BRIGHTNESS_KNEE = 0.75;
const float BRIGHTNESS_SLOPE = 37.0;
const float SHARE_GUARD = 1e-6;
const float SUM_GUARD = 1e-8;

// Premultiplied colours and alpha.
uniform sampler2D staticColour;
uniform sampler2D dynamicColour;
// Mask probabilities: static, brightness, dynamic.
uniform sampler2D dynamicMask;
// Behind all Gaussians.
uniform float grey;
uniform vec3 masks;
// Whether there is a static branch.
uniform bool isBlended;
uniform int layer;

out vec4 shown;

vec3 over(vec4 premultiplied, vec3 behind) {
  return premultiplied.rgb + (1.0 - premultiplied.a) * behind;
}

void main() {
  ivec2 pixel = ivec2(gl_FragCoord.xy);
  vec3 moving = clamp(over(texelFetch(dynamicColour, pixel, 0), vec3(grey)), 0.0, 1.0);
  if (!isBlended) {
    shown = vec4(moving, 1.0);
    return;
  }
  vec3 still = over(texelFetch(staticColour, pixel, 0), vec3(grey));
  vec3 mask = clamp(over(texelFetch(dynamicMask, pixel, 0), masks), 0.0, 1.0);
  float light = BRIGHTNESS_OFFSET + mask.y + (BRIGHTNESS_SLOPE - 1.0) * max(mask.y - BRIGHTNESS_KNEE, 0.0);
  vec2 shares = mask.xz + SHARE_GUARD;
  shares /= shares.x + shares.y + SUM_GUARD;
  vec3 composed = shares.y * moving + shares.x * clamp(light * still, 0.0, 1.0);
  vec3 chosen = layer == STATIC ? still : layer == DYNAMIC ? moving : layer == MASK ? vec3(shares.y) : composed;
  shown = vec4(clamp(chosen, 0.0, 1.0), 1.0);
}
