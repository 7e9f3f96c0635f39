// WebGPU: projects every splat of the scene once, and gives it its key for the order. The twin of project.frag and of
// glsl/preprocess_instance_expand.comp; buffers are laid out as textures.js lays out texels. Constants in capitals are the page's.

struct View {
  view: array<vec4f, 3>,  // rows of view_from_world
  position: vec3f,        // camera centre, world
  near: f32,
  focal_px: vec2f,
  principal_px: vec2f,
  size_px: vec2f,
  dilation_px2: f32,
  antialias: f32,         // 1 = opacity makes up for the dilation
  dim: f32,               // brightness of what is not selected
  count: u32,             // number of splats
}

struct Splat {
  place: vec4f,  // centre, and standard deviation along the longer axis as a vector, pixels
  color: vec4f,  // colour and opacity
  reach: vec4f,  // standard deviation along the shorter axis, pixels; half the quad's side in standard deviations
}

@group(0) @binding(0) var<uniform> u: View;
@group(0) @binding(1) var<storage, read> geometry: array<vec4f>;  // 3 for each Gaussian
@group(0) @binding(2) var<storage, read> sh: array<vec4u>;        // SH_TEXELS for each, halves, two coefficients in each
@group(0) @binding(3) var<storage, read> offsets: array<vec4f>;   // OFFSET_TEXELS for each record
@group(0) @binding(4) var<storage, read> rows: array<vec4f>;      // 8 for each row
@group(0) @binding(5) var<storage, read> flat_list: array<vec2u>; // in flat order: Gaussian in the pool, row
@group(0) @binding(6) var<storage, read_write> splats: array<Splat>;
@group(0) @binding(7) var<storage, read_write> keys: array<u32>;
@group(0) @binding(8) var<storage, read_write> draw: array<atomic<u32>, 4>;  // number of vertices first

const NOT_DRAWN = 0xffffffffu;

fn transformed(a: vec4f, b: vec4f, c: vec4f, p: vec3f) -> vec3f {
  let one = vec4f(p, 1.0);
  return vec3f(dot(a, one), dot(b, one), dot(c, one));
}

fn linear_part(a: vec4f, b: vec4f, c: vec4f) -> mat3x3f {
  return transpose(mat3x3f(a.xyz, b.xyz, c.xyz));
}

fn rotation_of(wxyz: vec4f) -> mat3x3f {
  var q = wxyz / max(max(abs(wxyz.x), abs(wxyz.y)), max(abs(wxyz.z), abs(wxyz.w)));
  q = q / sqrt(dot(q, q));
  let w = q.x; let x = q.y; let y = q.z; let z = q.w;
  return mat3x3f(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
                 2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
                 2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}

// SH in direction `dir`, INRIA's order and signs; `record` is the offset record, -1 if there is none.
fn sh_color(source: u32, record: i32, dir: vec3f) -> vec3f {
  var c: array<vec3f, 16>;
  for (var t = 0u; t < SH_TEXELS; t++) {
    let bits = sh[SH_TEXELS * source + t];
    c[2 * t] = vec3f(unpack2x16float(bits.x), unpack2x16float(bits.y).x);
    c[2 * t + 1] = vec3f(unpack2x16float(bits.z), unpack2x16float(bits.w).x);
  }
  if (record >= 0) {
    let first = OFFSET_TEXELS * u32(record);
    c[0] += offsets[first + 1].xyz;
    if (OFFSET_SH_REST == 1) {
      for (var k = 1u; k < COEFFICIENTS; k++) { c[k] += offsets[first + FIRST_SH_REST + k - 1].xyz; }
    }
  }
  var color = 0.28209479177387814 * c[0];
  let x = dir.x; let y = dir.y; let z = dir.z;
  let xx = x * x; let yy = y * y; let zz = z * z;
  if (COEFFICIENTS > 1) {
    color += 0.4886025119029199 * (-y * c[1] + z * c[2] - x * c[3]);
  }
  if (COEFFICIENTS > 4) {
    color += 1.0925484305920792 * (x * y * c[4] - y * z * c[5] - x * z * c[7]);
    color += 0.31539156525252005 * (2.0 * zz - xx - yy) * c[6];
    color += 0.5462742152960396 * (xx - yy) * c[8];
  }
  if (COEFFICIENTS > 9) {
    color += -0.5900435899266435 * y * (3.0 * xx - yy) * c[9];
    color += 2.890611442640554 * x * y * z * c[10];
    color += -0.4570457994644658 * y * (4.0 * zz - xx - yy) * c[11];
    color += 0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * c[12];
    color += -0.4570457994644658 * x * (4.0 * zz - xx - yy) * c[13];
    color += 1.445305721320277 * z * (xx - yy) * c[14];
    color += -0.5900435899266435 * x * (xx - 3.0 * yy) * c[15];
  }
  return color + 0.5;
}

// What the page makes of a colour: the tint with the lightness of what was there, and less light where something else is selected.
fn looked(color: vec3f, tint: vec4f, is_selected: bool) -> vec3f {
  let lightness = dot(color, vec3f(0.2126, 0.7152, 0.0722));
  let tinted = mix(color, tint.rgb * lightness * 1.6, tint.a);
  return select(tinted * u.dim, tinted, is_selected);
}

// Writes the splat of a place of the flat order; false if it is not drawn.
fn project(flat_index: u32, slot: u32) -> bool {
  let source = flat_list[flat_index].x;
  let r = 8 * flat_list[flat_index].y;
  let last = rows[r + 7];  // first Gaussian, first offset, whether it is shown, whether it is selected
  if (last.z < 0.5) { return false; }
  let record = select(i32(last.y) + i32(source) - i32(last.x), -1, last.y < 0.0);
  var mean_logit = geometry[3 * source];
  var quat = geometry[3 * source + 1];
  var log_scales = geometry[3 * source + 2].xyz;
  if (record >= 0) {
    let first = OFFSET_TEXELS * u32(record);
    mean_logit += offsets[first];
    if (OFFSET_SHAPE == 1) {
      quat += offsets[first + 2];
      log_scales += offsets[first + 3].xyz;
    }
  }
  let mean_world = transformed(rows[r], rows[r + 1], rows[r + 2], mean_logit.xyz);
  let mean_view = transformed(u.view[0], u.view[1], u.view[2], mean_world);
  let z = mean_view.z;
  if (!(z > u.near)) { return false; }

  let world = linear_part(rows[r], rows[r + 1], rows[r + 2]);
  let turned = linear_part(u.view[0], u.view[1], u.view[2]) * world * rotation_of(quat);
  let sigmas = exp(log_scales);
  let axes = mat3x3f(turned[0] * sigmas.x, turned[1] * sigmas.y, turned[2] * sigmas.z);
  let slope = mean_view.xy / z;
  let least = -(u.principal_px + 0.15 * u.size_px) / u.focal_px;
  let clamped = clamp(slope, least, (1.15 * u.size_px - u.principal_px) / u.focal_px);
  let scale = u.focal_px / z;
  let bx = scale.x * (vec3f(axes[0].x, axes[1].x, axes[2].x) - clamped.x * vec3f(axes[0].z, axes[1].z, axes[2].z));
  let by = scale.y * (vec3f(axes[0].y, axes[1].y, axes[2].y) - clamped.y * vec3f(axes[0].z, axes[1].z, axes[2].z));
  let d = u.dilation_px2;
  let area = cross(bx, by);
  let det_sharp = dot(area, area);
  let det = det_sharp + d * (dot(bx, bx) + dot(by, by)) + d * d;
  let xx = dot(bx, bx) + d;
  let yy = dot(by, by) + d;
  let xy = dot(bx, by);
  var opacity = 1.0 / (1.0 + exp(-mean_logit.w));
  if (u.antialias > 0.5) { opacity *= sqrt(max(2.5e-5, det_sharp / det)); }
  // What is no number fails these tests.
  if (!(opacity >= 1.0 / 255.0 && opacity < 2.0 && det > 0.0 && det < 1e30)) { return false; }

  // The ellipse of alpha 1/255: axes of the covariance, lengths in pixels.
  let reach = sqrt(2.0 * (log(255.0 * opacity) * 1.001 + 0.01));
  let longer = 0.5 * (xx + yy) + length(vec2f(0.5 * (xx - yy), xy));
  let shorter = det / longer;
  let one = vec2f(longer - yy, xy);
  let two = vec2f(xy, longer - xx);
  var axis = select(two, one, dot(one, one) > dot(two, two));
  axis = select(vec2f(1.0, 0.0), axis / length(axis), dot(axis, axis) > 0.0);
  let center = u.focal_px * slope + u.principal_px;
  let half_px = reach * sqrt(vec2f(xx, yy));
  if (any(center + half_px < vec2f(0.0)) || any(center - half_px > u.size_px)) { return false; }

  let dir = transpose(world) * (mean_world - u.position);
  let len = sqrt(dot(dir, dir));
  let shaded = sh_color(source, record, select(vec3f(0.0, 0.0, 1.0), dir / len, len > 0.0));
  let rgb = transformed(rows[r + 3], rows[r + 4], rows[r + 5], shaded);
  if (!all(rgb < vec3f(1e15))) { return false; }
  let color = looked(max(rgb, vec3f(0.0)), rows[r + 6], last.w > 0.5);
  splats[slot] = Splat(vec4f(center, sqrt(longer) * axis), vec4f(color, opacity), vec4f(sqrt(shorter), reach, 0.0, 0.0));
  // The farthest first. Bits of positive floats are in the order of the floats.
  keys[slot] = ~bitcast<u32>(z);
  return true;
}

@compute @workgroup_size(256)
fn project_all(@builtin(global_invocation_id) id: vec3u) {
  let flat_index = id.x;
  if (flat_index >= u.count) { return; }
  // Where depths are equal, the last of the flat order is drawn first: it lies behind.
  let slot = u.count - 1 - flat_index;
  if (project(flat_index, slot)) {
    atomicAdd(&draw[0], 6u);
  } else {
    keys[slot] = NOT_DRAWN;
  }
}
