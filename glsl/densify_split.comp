#version 460
// Shrinks the children of split Gaussians and places them at random inside the Gaussian they come from.
//
// - Reads `origins`, `made` and `quats`; updates `means` and `log_scales` of children, which hold the parent's before.
// - The position is `mean + R diag(scale) n` with standard normals n from a hash of (seed, steps done, old index,
//   number of the child): see `instgs_reference::random`.
// - Grid: one thread per new Gaussian. Bytes: 4 read per Gaussian, 68 more per child.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "strategy.glsl"
#include "random.glsl"
#include "rotation.glsl"

layout(scalar, binding = 0) readonly buffer Origins { uint origins[]; };      // old Gaussian of each new one
layout(scalar, binding = 1) readonly buffer Made { uint made[]; };            // MADE_*
layout(scalar, binding = 2) readonly buffer Quats { vec4 quats[]; };          // rotations, wxyz
layout(scalar, binding = 3) buffer Means { vec3 means[]; };                   // centres: the parent's in, the child's out
layout(scalar, binding = 4) buffer LogScales { vec3 log_scales[]; };          // log standard deviations: the parent's in, the child's out
layout(scalar, push_constant) uniform DensifySplitParams {
    uint count;        // new Gaussians
    float log_shrink;  // log of the divisor of the scales of children
    uvec2 seed;        // seed of the run, low word first
    uint time;         // steps done
};

void main() {
    uint j = thread_index();
    if (j >= count || made[j] < MADE_CHILD) return;
    vec3 normals = random_normals(seed, time, RANDOM_SPLIT, origins[j], made[j] - MADE_CHILD);
    vec3 scales = log_scales[j];
    means[j] += rotation_from_quat(quats[j]) * (exp(scales) * normals);
    log_scales[j] = scales - log_shrink;
}
