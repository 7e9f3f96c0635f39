#version 460
// What the loss would feel without each Gaussian, from what it felt of its opacity: the mean square of the gradient by the
// logit, over the square of the transparency (the logit of an opaque Gaussian moves little), for each expanded Gaussian. First
// pass of making room in a full cloud.
//
// - Reads the second moments of the logits, `screen_statistics`, `uses` and `highest_logits` (see `source_use`). A moment is a
//   mean over the last steps, so it is divided by the part of the views that show the Gaussian: what few views show counts no
//   less. Moments start at 0 when a Gaussian is made, so what is young seems to cost less than it does (0.4 of it after 500 steps).
// - Writes `keys` (bits of the cost, for an ascending radix sort) and `values` (the index).
// - Grid: one thread per Gaussian. Bytes per Gaussian: 28 read, 8 written.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/recycle.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"

layout(scalar, binding = 0) readonly buffer LogitMoments { vec2 logit_moments[]; };          // first and second moment of the opacity logit
layout(scalar, binding = 1) readonly buffer ScreenStatistics { vec3 screen_statistics[]; };  // sum of screen gradients, number of views that show it, largest radius_px
layout(scalar, binding = 2) readonly buffer Uses { uint uses[]; };                           // number of instances that have it
layout(scalar, binding = 3) readonly buffer HighestLogits { float highest_logits[]; };       // largest opacity logit in any instance
layout(scalar, binding = 4) writeonly buffer Keys { uint keys[]; };                          // ascending with the cost
layout(scalar, binding = 5) writeonly buffer Values { uint values[]; };                      // index of the Gaussian
layout(scalar, push_constant) uniform DensifyCostParams {
    uint count;   // Gaussians
    float steps;  // steps that the statistics are of
};

const float LEAST_SHARE = 0.02;         // of the views: moments of what hardly any view shows are noise
const float LEAST_TRANSPARENCY = 1e-3;  // below it the gradient by the logit says nothing
const float LARGEST_LOGIT = 20.0;       // its exponential is finite

void main() {
    uint i = thread_index();
    if (i >= count) return;
    float used = float(max(uses[i], 1));
    float share = clamp(screen_statistics[i].y / (steps * used), LEAST_SHARE, 1.0);
    float transparency = max(1.0 / (1.0 + exp(min(highest_logits[i], LARGEST_LOGIT))), LEAST_TRANSPARENCY);
    float cost = logit_moments[i].y / (share * transparency * transparency * used);
    // What is not finite is removed by other rules.
    keys[i] = is_finite(cost) && cost >= 0.0 ? floatBitsToUint(cost) : 0xFFFFFFFF;
    values[i] = i;
}
