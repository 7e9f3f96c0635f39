#version 460
// Shrinks the children of split Gaussians, places them inside the Gaussian they come from, and lowers their opacity.
//
// - Reads `origins`, `made` and `quats`; updates `means`, `log_scales` and `opacity_logits` of children, which hold the
//   parent's before.
// - The position is `mean + R diag(scale) n` with standard normals n from a hash of (seed, steps done, old index,
//   number of the child): see `instgs_reference::random`.
// - With `halves`, children lie to both sides along the longest axis, which alone is divided: `distance` standard
//   deviations away, where the two together have the variance of the old one along it. Even ones lie ahead.
// - Grid: one thread per new Gaussian. Bytes: 4 read per Gaussian, 76 more per child.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "strategy.glsl"
#include "random.glsl"
#include "rotation.glsl"
#include "children.glsl"

layout(scalar, binding = 0) readonly buffer Origins { uint origins[]; };      // old Gaussian of each new one
layout(scalar, binding = 1) readonly buffer Made { uint made[]; };            // MADE_*
layout(scalar, binding = 2) readonly buffer Quats { vec4 quats[]; };          // rotations, wxyz
layout(scalar, binding = 3) buffer Means { vec3 means[]; };                   // centres: the parent's in, the child's out
layout(scalar, binding = 4) buffer LogScales { vec3 log_scales[]; };          // log standard deviations: the parent's in, the child's out
layout(scalar, binding = 5) buffer OpacityLogits { float opacity_logits[]; };  // opacity logits: the parent's in, the child's out
layout(scalar, push_constant) uniform DensifySplitParams {
    uint count;        // new Gaussians
    float log_shrink;  // log of the divisor of the scales of children, or of the longest alone
    uvec2 seed;        // seed of the run, low word first
    uint time;         // steps done
    uint halves;       // 1 = children divide the longest axis, 0 = they are drawn at random
    float distance;    // with halves: of a child's centre from its parent's, standard deviations
    float opacity;     // opacity of a child, times its parent's; at most 1
};

void main() {
    uint j = thread_index();
    if (j >= count || made[j] < MADE_CHILD) return;
    uint child = made[j] - MADE_CHILD;
    vec3 scales = log_scales[j];
    vec3 place = child_place(halves != 0, distance, scales, seed, time, origins[j], child);
    means[j] += rotation_from_quat(quats[j]) * (exp(scales) * place);
    log_scales[j] = child_log_scales(scales, log_shrink, halves != 0);
    opacity_logits[j] = child_logit(opacity_logits[j], opacity);
}
