// WebGPU: draws sorted splats as quads that hold their ellipses of alpha 1/255, and the blended picture over the background. The
// twins of quad.vert, quad.frag and screen.frag.

struct Splat {
  place: vec4f,  // as project.wgsl writes it
  color: vec4f,
  reach: vec4f,
}

struct Screen {
  background: vec3f,
  size_px: vec2f,
}

struct Corner {
  @builtin(position) at: vec4f,
  @location(0) sigmas: vec2f,                     // place in the splat, standard deviations
  @location(1) @interpolate(flat) color: vec4f,  // colour and opacity
}

@group(0) @binding(0) var<uniform> u: Screen;
@group(0) @binding(1) var<storage, read> splats: array<Splat>;
@group(0) @binding(2) var<storage, read> order: array<u32>;  // the farthest first
@group(0) @binding(3) var blended: texture_2d<f32>;

@vertex
fn quad(@builtin(vertex_index) v: u32) -> Corner {
  let splat = splats[order[v / 6]];
  // Two triangles: corners 0 1 2 and 2 1 3.
  var corners = array(0u, 1u, 2u, 2u, 1u, 3u);
  let corner = corners[v % 6];
  var out: Corner;
  out.sigmas = splat.reach.y * vec2f(select(1.0, -1.0, (corner & 1) == 0), select(1.0, -1.0, (corner & 2) == 0));
  let shorter = splat.reach.x * normalize(vec2f(-splat.place.w, splat.place.z));
  let at = splat.place.xy + out.sigmas.x * splat.place.zw + out.sigmas.y * shorter;
  out.at = vec4f(2.0 * at.x / u.size_px.x - 1.0, 1.0 - 2.0 * at.y / u.size_px.y, 0.0, 1.0);
  out.color = splat.color;
  return out;
}

// Alpha below 1/255 is skipped and at most 0.99. Colours are those of the photos' encoding and blend as they are.
@fragment
fn splat_pixel(in: Corner) -> @location(0) vec4f {
  let alpha = min(0.99, in.color.a * exp(-0.5 * dot(in.sigmas, in.sigmas)));
  if (alpha < 1.0 / 255.0) { discard; }
  return vec4f(in.color.rgb * alpha, alpha);
}

// One triangle over the whole picture.
@vertex
fn screen(@builtin(vertex_index) v: u32) -> @builtin(position) vec4f {
  return vec4f(select(-1.0, 3.0, v == 1), select(-1.0, 3.0, v == 2), 0.0, 1.0);
}

@fragment
fn screen_pixel(@builtin(position) at: vec4f) -> @location(0) vec4f {
  let pixel = textureLoad(blended, vec2u(at.xy), 0);
  return vec4f(pixel.rgb + (1.0 - pixel.a) * u.background, 1.0);
}
