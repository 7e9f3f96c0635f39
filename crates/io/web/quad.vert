#version 300 es
// A projected splat (project.frag) as a quad that holds its ellipse of alpha 1/255. An instance of the draw call is BATCH splats,
// four vertices each: many small instances are slow on some devices.
precision highp float;
precision highp int;
precision highp sampler2D;

uniform sampler2D u_place;  // what project.frag says of each splat, in the order of drawing
uniform sampler2D u_color;
uniform sampler2D u_reach;
uniform int u_count;        // number of splats
uniform vec2 u_size_px;

out vec2 v_sigmas;      // place in the splat, standard deviations
flat out vec4 v_color;  // colour and opacity

void main() {
  gl_Position = vec4(2.0, 2.0, 2.0, 1.0);  // outside: what returns early is not drawn
  v_sigmas = vec2(0.0);
  v_color = vec4(0.0);
  int splat = gl_InstanceID * BATCH + (gl_VertexID >> 2);
  if (splat >= u_count) return;
  ivec2 where = ivec2(splat & 2047, splat >> 11);
  vec2 reach = texelFetch(u_reach, where, 0).xy;
  if (!(reach.y > 0.0)) return;
  vec4 place = texelFetch(u_place, where, 0);
  v_color = texelFetch(u_color, where, 0);
  v_sigmas = reach.y * vec2((gl_VertexID & 1) == 0 ? -1.0 : 1.0, (gl_VertexID & 2) == 0 ? -1.0 : 1.0);
  vec2 shorter = reach.x * normalize(vec2(-place.w, place.z));
  vec2 at = place.xy + v_sigmas.x * place.zw + v_sigmas.y * shorter;
  gl_Position = vec4(2.0 * at.x / u_size_px.x - 1.0, 1.0 - 2.0 * at.y / u_size_px.y, 0.0, 1.0);
}
