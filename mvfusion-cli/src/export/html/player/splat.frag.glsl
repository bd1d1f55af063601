// A pixel of a Gaussian, premultiplied, for blending back to front (METHOD §8).

precision highp float;

// Largest alpha of one Gaussian at one pixel.
const float MAX_ALPHA = 0.99;

in vec2 local;
flat in float logRatio;
flat in vec3 colour;
flat in float opacity;
#ifdef MASKS
flat in vec3 mask;
#endif

layout(location = 0) out vec4 colourOut;
#ifdef MASKS
layout(location = 1) out vec4 maskOut;
#endif

void main() {
  float radius = dot(local, local);
  if (radius > 1.0) {
    discard;
  }
  float alpha = min(opacity * exp(-logRatio * radius), MAX_ALPHA);
  colourOut = vec4(alpha * colour, alpha);
#ifdef MASKS
  maskOut = vec4(alpha * mask, alpha);
#endif
}
