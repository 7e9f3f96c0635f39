#version 460
// Changes one run of offset records after densification has moved it: what is to be hidden is, and the offsets of split Gaussians
// are divided among their children.
//
// - Reads `origins` and `made` by new source Gaussian (see `densify_place`), `offset_origins` by new record (see
//   `densify_place_offsets`), `retired` (see `densify_retire`), and the template's `quats`, `log_scales` and `opacity_logits`,
//   which are still those of the parent: comes before `densify_split`. Reads offsets of shape; updates `offset_means` and
//   `offset_opacity_logits`, which hold the parent's before.
// - Children lie within what the instance shows of their parent, at the same place among its standard deviations as the
//   template's, and have that one's opacity times the same factor. Scales need no change: the same divisor is taken off the
//   same axis of both.
// - What is hidden is so transparent that it is never drawn.
// - Grid: one thread per new Gaussian of the run's template. Bytes: 12 read each, 112 more per child.
//
// Twin: `instgs_reference::densify`. Tests: `tests/kernels/densify.rs`, `tests/kernels/recycle.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "strategy.glsl"
#include "random.glsl"
#include "rotation.glsl"
#include "children.glsl"

layout(scalar, binding = 0) readonly buffer Origins { uint origins[]; };                    // old Gaussian of each new one
layout(scalar, binding = 1) readonly buffer Made { uint made[]; };                          // MADE_*
layout(scalar, binding = 2) readonly buffer OffsetOrigins { uint offset_origins[]; };       // old record of each new one
layout(scalar, binding = 3) readonly buffer Retired { uint retired[]; };                    // 1 = to be hidden; by old source Gaussian, then by old record
layout(scalar, binding = 4) readonly buffer Quats { vec4 quats[]; };                        // rotations, wxyz
layout(scalar, binding = 5) readonly buffer LogScales { vec3 log_scales[]; };               // log standard deviations of the parent
layout(scalar, binding = 6) readonly buffer OpacityLogits { float opacity_logits[]; };      // opacity logits of the parent
layout(scalar, binding = 7) readonly buffer OffsetLogScales { vec3 offset_log_scales[]; };  // by new record, if any
layout(scalar, binding = 8) readonly buffer OffsetQuats { vec4 offset_quats[]; };           // by new record, if any
layout(scalar, binding = 9) buffer OffsetMeans { vec3 offset_means[]; };                    // the parent's in, the child's out
layout(scalar, binding = 10) buffer OffsetLogits { float offset_opacity_logits[]; };        // the parent's in, the child's out
layout(scalar, push_constant) uniform DensifyOffsetsParams {
    uint count;          // new Gaussians of the template
    uint first_source;   // the first of them
    uint first_offset;   // first new record of the run
    uint first_retired;  // index in `retired` of the first record
    uint kinds;          // bits: 1 = there are offsets of log scales, 2 = of quaternions, 4 = means have offsets that may change
    uvec2 seed;          // seed of the run, low word first
    uint time;           // steps done
    uint halves;         // 1 = children divide the longest axis, 0 = they are drawn at random
    float distance;      // with halves: of a child's centre from its parent's, standard deviations
    float opacity;       // opacity of a child, times its parent's; at most 1
    float hidden_logit;  // opacity logit of what is hidden
};

void main() {
    uint i = thread_index();
    if (i >= count) return;
    uint source = first_source + i, record = first_offset + i;
    bool hides = retired[first_retired + offset_origins[record]] != 0;
    bool is_child = made[source] >= MADE_CHILD;
    if (!hides && !is_child) return;
    float factor = is_child ? opacity : 1.0;
    float logit = opacity_logits[source];
    float shown = hides ? hidden_logit : child_logit(logit + offset_opacity_logits[record], factor);
    offset_opacity_logits[record] = shown - child_logit(logit, factor);
    if (!is_child || (kinds & 4) == 0) return;
    vec3 scales = log_scales[source];
    vec4 quat = quats[source];
    vec3 place = child_place(halves != 0, distance, scales, seed, time, origins[source], made[source] - MADE_CHILD);
    vec3 of_template = rotation_from_quat(quat) * (exp(scales) * place);
    if ((kinds & 1) != 0) scales += offset_log_scales[record];
    if ((kinds & 2) != 0) quat += offset_quats[record];
    vec3 change = rotation_from_quat(quat) * (exp(scales) * place) - of_template;
    // What an instance does not draw, as its scales or its rotation are not finite, has no place.
    if (is_finite(change)) offset_means[record] += change;
}
