#version 300 es
// Projects splats, each once: the twin of glsl/preprocess_instance_expand.comp. A pixel is one Gaussian of one row of the scene, in
// the order of drawing; quad.vert draws from what stands in it. Texels are laid out by textures.js.
precision highp float;
precision highp int;
precision highp sampler2D;
precision highp usampler2D;

uniform usampler2D u_list;     // Gaussian in the pool, row
uniform int u_count;           // number of splats in the list
uniform sampler2D u_geometry;  // 3 texels a Gaussian
uniform usampler2D u_sh;       // SH_TEXELS a Gaussian, halves, two coefficients in each
uniform sampler2D u_offsets;   // OFFSET_TEXELS a record
uniform sampler2D u_rows;      // 8 texels a row
uniform vec4 u_view[3];        // rows of view_from_world
uniform vec3 u_position;       // camera centre, world
uniform vec2 u_focal_px;
uniform vec2 u_principal_px;
uniform vec2 u_size_px;
uniform float u_near;
uniform float u_dilation_px2;
uniform float u_antialias;     // 1 = opacity makes up for the dilation
uniform float u_dim;           // brightness of what is not selected

layout(location = 0) out vec4 o_place;  // centre, and standard deviation along the longer axis as a vector, pixels
layout(location = 1) out vec4 o_color;  // colour and opacity
layout(location = 2) out vec4 o_reach;  // standard deviation along the shorter axis, pixels; half the quad's side in standard
                                        // deviations, 0 = not drawn

struct Row {
  vec4 world[3];
  vec4 color[3];
  vec4 tint;
  int first;
  int first_offset;
  bool shown;
  bool selected;
};

vec4 texel(sampler2D of, int i) {
  return texelFetch(of, ivec2(i & 2047, i >> 11), 0);
}

Row row_at(int r) {
  vec4 last = texel(u_rows, 8 * r + 7);
  return Row(vec4[3](texel(u_rows, 8 * r), texel(u_rows, 8 * r + 1), texel(u_rows, 8 * r + 2)),
             vec4[3](texel(u_rows, 8 * r + 3), texel(u_rows, 8 * r + 4), texel(u_rows, 8 * r + 5)), texel(u_rows, 8 * r + 6),
             int(last.x), int(last.y), last.z > 0.5, last.w > 0.5);
}

vec3 transformed(vec4 rows[3], vec3 p) {
  return vec3(dot(rows[0].xyz, p) + rows[0].w, dot(rows[1].xyz, p) + rows[1].w, dot(rows[2].xyz, p) + rows[2].w);
}

mat3 linear_part(vec4 rows[3]) {
  return transpose(mat3(rows[0].xyz, rows[1].xyz, rows[2].xyz));
}

mat3 rotation_of(vec4 wxyz) {
  vec4 q = wxyz / max(max(abs(wxyz.x), abs(wxyz.y)), max(abs(wxyz.z), abs(wxyz.w)));
  q /= sqrt(dot(q, q));
  float w = q.x, x = q.y, y = q.z, z = q.w;
  return mat3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
              2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
              2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}

// SH in direction `dir`, INRIA's order and signs; `record` is the offset record, -1 if there is none.
vec3 sh_color(int source, int record, vec3 dir) {
  vec3 sh[2 * SH_TEXELS];
  for (int t = 0; t < SH_TEXELS; ++t) {
    int i = SH_TEXELS * source + t;
    uvec4 bits = texelFetch(u_sh, ivec2(i & 2047, i >> 11), 0);
    sh[2 * t] = vec3(unpackHalf2x16(bits.x), unpackHalf2x16(bits.y).x);
    sh[2 * t + 1] = vec3(unpackHalf2x16(bits.z), unpackHalf2x16(bits.w).x);
  }
  if (record >= 0) {
    sh[0] += texel(u_offsets, OFFSET_TEXELS * record + 1).xyz;
#if OFFSET_SH_REST
    for (int c = 1; c < COEFFICIENTS; ++c) sh[c] += texel(u_offsets, OFFSET_TEXELS * record + FIRST_SH_REST + c - 1).xyz;
#endif
  }
  vec3 color = 0.28209479177387814 * sh[0];
  float x = dir.x, y = dir.y, z = dir.z;
  float xx = x * x, yy = y * y, zz = z * z;
#if COEFFICIENTS > 1
  color += 0.4886025119029199 * (-y * sh[1] + z * sh[2] - x * sh[3]);
#endif
#if COEFFICIENTS > 4
  color += 1.0925484305920792 * (x * y * sh[4] - y * z * sh[5] - x * z * sh[7]);
  color += 0.31539156525252005 * (2.0 * zz - xx - yy) * sh[6];
  color += 0.5462742152960396 * (xx - yy) * sh[8];
#endif
#if COEFFICIENTS > 9
  color += -0.5900435899266435 * y * (3.0 * xx - yy) * sh[9];
  color += 2.890611442640554 * x * y * z * sh[10];
  color += -0.4570457994644658 * y * (4.0 * zz - xx - yy) * sh[11];
  color += 0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * sh[12];
  color += -0.4570457994644658 * x * (4.0 * zz - xx - yy) * sh[13];
  color += 1.445305721320277 * z * (xx - yy) * sh[14];
  color += -0.5900435899266435 * x * (xx - 3.0 * yy) * sh[15];
#endif
  return color + 0.5;
}

// What the page makes of a colour: the tint with the lightness of what was there, and less light where something else is selected.
vec3 looked(Row row, vec3 color) {
  float lightness = dot(color, vec3(0.2126, 0.7152, 0.0722));
  color = mix(color, row.tint.rgb * lightness * 1.6, row.tint.a);
  return row.selected ? color : color * u_dim;
}

void main() {
  o_place = vec4(0.0);
  o_color = vec4(0.0);
  o_reach = vec4(0.0);
  ivec2 at = ivec2(gl_FragCoord.xy);
  if (2048 * at.y + at.x >= u_count) return;
  uvec2 splat = texelFetch(u_list, at, 0).xy;
  int source = int(splat.x);
  Row row = row_at(int(splat.y));
  if (!row.shown) return;
  int record = row.first_offset < 0 ? -1 : row.first_offset + source - row.first;
  vec4 mean_logit = texel(u_geometry, 3 * source);
  vec4 quat = texel(u_geometry, 3 * source + 1);
  vec3 log_scales = texel(u_geometry, 3 * source + 2).xyz;
  if (record >= 0) {
    mean_logit += texel(u_offsets, OFFSET_TEXELS * record);
#if OFFSET_SHAPE
    quat += texel(u_offsets, OFFSET_TEXELS * record + 2);
    log_scales += texel(u_offsets, OFFSET_TEXELS * record + 3).xyz;
#endif
  }
  vec3 mean_world = transformed(row.world, mean_logit.xyz);
  vec3 mean_view = transformed(u_view, mean_world);
  float z = mean_view.z;
  if (!(z > u_near)) return;

  mat3 axes = linear_part(u_view) * linear_part(row.world) * rotation_of(quat);
  vec3 sigmas = exp(log_scales);
  axes = mat3(axes[0] * sigmas.x, axes[1] * sigmas.y, axes[2] * sigmas.z);
  vec2 slope = mean_view.xy / z;
  vec2 clamped = clamp(slope, -(u_principal_px + 0.15 * u_size_px) / u_focal_px, (1.15 * u_size_px - u_principal_px) / u_focal_px);
  vec2 scale = u_focal_px / z;
  vec3 bx = scale.x * (vec3(axes[0].x, axes[1].x, axes[2].x) - clamped.x * vec3(axes[0].z, axes[1].z, axes[2].z));
  vec3 by = scale.y * (vec3(axes[0].y, axes[1].y, axes[2].y) - clamped.y * vec3(axes[0].z, axes[1].z, axes[2].z));
  float d = u_dilation_px2;
  float xx = dot(bx, bx), yy = dot(by, by), xy = dot(bx, by);
  vec3 area = cross(bx, by);
  float det_sharp = dot(area, area);
  float det = det_sharp + d * (xx + yy) + d * d;
  xx += d;
  yy += d;
  float opacity = 1.0 / (1.0 + exp(-mean_logit.w));
  if (u_antialias > 0.5) opacity *= sqrt(max(2.5e-5, det_sharp / det));
  // What is no number fails these tests.
  if (!(opacity >= 1.0 / 255.0 && opacity < 2.0 && det > 0.0 && det < 1e30)) return;

  // The ellipse of alpha 1/255: axes of the covariance, lengths in pixels.
  float reach = sqrt(2.0 * (log(255.0 * opacity) * 1.001 + 0.01));
  float middle = 0.5 * (xx + yy);
  float longer = middle + length(vec2(0.5 * (xx - yy), xy));
  float shorter = det / longer;
  vec2 one = vec2(longer - yy, xy), two = vec2(xy, longer - xx);
  vec2 axis = dot(one, one) > dot(two, two) ? one : two;
  axis = dot(axis, axis) > 0.0 ? normalize(axis) : vec2(1.0, 0.0);
  vec2 center = u_focal_px * slope + u_principal_px;
  vec2 half_px = reach * sqrt(vec2(xx, yy));
  if (any(lessThan(center + half_px, vec2(0.0))) || any(greaterThan(center - half_px, u_size_px))) return;

  vec3 dir = transpose(linear_part(row.world)) * (mean_world - u_position);
  float len = sqrt(dot(dir, dir));
  vec3 rgb = sh_color(source, record, len > 0.0 ? dir / len : vec3(0.0, 0.0, 1.0));
  rgb = vec3(dot(row.color[0], vec4(rgb, 1.0)), dot(row.color[1], vec4(rgb, 1.0)), dot(row.color[2], vec4(rgb, 1.0)));
  if (!all(lessThan(rgb, vec3(1e15)))) return;
  o_color = vec4(looked(row, max(rgb, 0.0)), opacity);

  o_place = vec4(center, sqrt(longer) * axis);
  o_reach = vec4(sqrt(shorter), reach, 0.0, 0.0);
}
