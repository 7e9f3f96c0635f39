#version 460
// Tests the bounding ball of every instance against the view and writes how many of its chunks to test. In scenes with
// levels of detail, each level is an instance of its own, and hidden levels have no chunks to test.
//
// The ball in the world is `T_k c` with radius `s (r + max |d_mean|)` and largest standard deviation `s sigma_max`.
// The background is the last instance, with the identity as its transform.
//
// - Reads `instances` (by instance). Writes `instance_chunks` (by instance): `ceil(source_count / WORKGROUP_SIZE)`, or
//   0.
// - Grid: one thread per instance; the host knows their number. Together with the following scan, which turns the
//   counts into candidates, it is the only pass whose work grows with all instances.
// - Bytes per instance: 132 read (92 of them used), 4 written.
// - LEVELS: a level is shown if its weight is above 0: its cells are at most `lod_error_px` pixels wide at the nearest
//   point of the instance's ball, and the next level's are not, or are still fading in (`lod.glsl`; over a quarter of
//   an octave, within which two levels are drawn). Scenes without levels have kernels without this code.
// - Guarantee: an instance is dropped only if no pixel can change. For a splat at depth z the reach on the screen is
//   at most `EXTENT_SIGMAS * (f L sigma / z + sqrt(dilation))` pixels, with f the focal length and
//   `L = sqrt(1 + limit^2)` the largest stretch of the clamped Jacobian. Times z this is linear in the position, so
//   each image border is one half-space test of the ball. A ball with NaN in it is kept.
// - `EXTENT_SIGMAS` = 3.34: an opaque splat falls to alpha 1/255 at sqrt(2 ln 255) = 3.3290 standard deviations, and
//   the slightly enlarged extent of `preprocess_instance_expand` ends at 3.3337. Lengths get 0.4 % (`LENGTH_SLACK`
//   twice: transforms are validated to 1e-3 only), the ball 2e-6 of the terms of its transforms, which is what f32
//   rounding leaves of large coordinates, and the border one pixel.
//
// Twin: `instgs_reference::cull_chunks` (both levels of culling), `instgs_reference::lod`. Tests: `tests/kernels/cull_chunks.rs`,
// `scale.rs`, `lod.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "counters.glsl"
#include "scene.glsl"
#include "lod.glsl"

layout(scalar, binding = 0) readonly buffer Instances { Instance instances[]; };          // instances, background last
layout(scalar, binding = 1) writeonly buffer InstanceChunks { uint instance_chunks[]; };  // chunks to test per instance
layout(scalar, push_constant) uniform CullInstancesParams {
    View view;            // the camera
    uint instance_count;  // instances, background included
    float lod_error_px;   // largest cell of a level of detail that is shown, pixels; 0 = everything at full detail
};

void main() {
    uint i = thread_index();
    if (i >= instance_count) return;
    Instance instance = instances[i];
    float radius = instance.bound_radius + instance.max_offset;
    float sigma = instance.sigma_max * instance.sigma_growth;
    Reach reach = reach_of_ball(view, instance.world_from_template, instance.scale, instance.bound_center, radius, sigma);
    bool culled = outside_view(view, reach);
    if (LEVELS != 0) culled = culled || level_weight(view, instance, lod_error_px) <= 0.0;
    instance_chunks[i] = culled ? 0 : divide_up(instance.source_count, WORKGROUP_SIZE);
}
