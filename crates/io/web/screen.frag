#version 300 es
// The blended splats over the background.
precision highp float;
precision highp sampler2D;
uniform sampler2D u_blended;
uniform vec3 u_background;
out vec4 o_color;

void main() {
  vec4 blended = texelFetch(u_blended, ivec2(gl_FragCoord.xy), 0);
  o_color = vec4(blended.rgb + (1.0 - blended.a) * u_background, 1.0);
}
