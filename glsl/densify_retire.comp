#version 460
// Marks the Gaussians that cost least as transparent, so that `densify_mark` removes them: a full cloud gets room to grow.
//
// - Reads `order` (Gaussians by ascending cost, ties by index) and `uses_before`, the exclusive scan of their instances in that
//   order. Writes `highest_logits` of those that are needed to free `goal` expanded Gaussians.
// - Grid: one thread per index in the order. Bytes per Gaussian: 8 read.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/recycle.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(scalar, binding = 0) readonly buffer Order { uint order[]; };                     // Gaussians by ascending cost
layout(scalar, binding = 1) readonly buffer UsesBefore { uint uses_before[]; };          // expanded Gaussians before each in that order
layout(scalar, binding = 2) writeonly buffer HighestLogits { float highest_logits[]; };  // largest opacity logit in any instance
layout(scalar, push_constant) uniform DensifyRetireParams {
    uint count;  // Gaussians
    uint goal;   // expanded Gaussians to be freed
};

const float TRANSPARENT_LOGIT = -3.402823466e38;  // the lowest finite f32

void main() {
    uint place = thread_index();
    if (place < count && uses_before[place] < goal) highest_logits[order[place]] = TRANSPARENT_LOGIT;
}
