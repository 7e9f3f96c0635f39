#version 460
// Divides the offsets of split Gaussians of a template among their children, in one run of offset records: children lie within
// what the instance shows of their parent, and have that one's opacity times the same factor, not the template's.
//
// - Reads `origins` and `made` by new source Gaussian (see `densify_place`) and the template's `quats`, `log_scales` and
//   `opacity_logits`, which are still those of the parent: comes before `densify_split`. Reads offsets of shape; updates
//   `offset_means` and `offset_opacity_logits`, which hold the parent's before.
// - An instance's child is at the same place among the standard deviations of its parent as the template's, so that scales need
//   no change: the same divisor is taken off the same axis of both.
// - Grid: one thread per new Gaussian of the run's template. Bytes: 4 read each, 92 more per child.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "strategy.glsl"
#include "random.glsl"
#include "rotation.glsl"
#include "children.glsl"

layout(scalar, binding = 0) readonly buffer Origins { uint origins[]; };                    // old Gaussian of each new one
layout(scalar, binding = 1) readonly buffer Made { uint made[]; };                          // MADE_*
layout(scalar, binding = 2) readonly buffer Quats { vec4 quats[]; };                        // rotations, wxyz
layout(scalar, binding = 3) readonly buffer LogScales { vec3 log_scales[]; };               // log standard deviations of the parent
layout(scalar, binding = 4) readonly buffer OpacityLogits { float opacity_logits[]; };      // opacity logits of the parent
layout(scalar, binding = 5) readonly buffer OffsetLogScales { vec3 offset_log_scales[]; };  // by new record, if any
layout(scalar, binding = 6) readonly buffer OffsetQuats { vec4 offset_quats[]; };           // by new record, if any
layout(scalar, binding = 7) buffer OffsetMeans { vec3 offset_means[]; };                    // the parent's in, the child's out
layout(scalar, binding = 8) buffer OffsetLogits { float offset_opacity_logits[]; };         // the parent's in, the child's out
layout(scalar, push_constant) uniform DensifySplitOffsetsParams {
    uint count;         // new Gaussians of the template
    uint first_source;  // the first of them
    uint first_offset;  // first new record of the run
    uint kinds;         // bits: 1 = there are offsets of log scales, 2 = of quaternions, 4 = means have offsets that may change
    uvec2 seed;         // seed of the run, low word first
    uint time;          // steps done
    uint halves;        // 1 = children divide the longest axis, 0 = they are drawn at random
    float distance;     // with halves: of a child's centre from its parent's, standard deviations
    float opacity;      // opacity of a child, times its parent's; at most 1
};

void main() {
    uint i = thread_index();
    if (i >= count) return;
    uint source = first_source + i, record = first_offset + i;
    if (made[source] < MADE_CHILD) return;
    float logit = opacity_logits[source];
    // Otherwise the opacities are those of the parent, and so is their difference.
    if (opacity < 1.0) offset_opacity_logits[record] = child_logit(logit + offset_opacity_logits[record], opacity) - child_logit(logit, opacity);
    if ((kinds & 4) == 0) return;
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
