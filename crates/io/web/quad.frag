#version 300 es
// A splat's pixel: alpha below 1/255 is skipped and at most 0.99. Colours are those of the photos' encoding and blend as they are.
precision highp float;
in vec2 v_sigmas;
flat in vec4 v_color;
out vec4 o_color;  // times alpha

void main() {
  float alpha = min(0.99, v_color.a * exp(-0.5 * dot(v_sigmas, v_sigmas)));
  if (alpha < 1.0 / 255.0) discard;
  o_color = vec4(v_color.rgb * alpha, alpha);
}
