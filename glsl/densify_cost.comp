#version 460
// What the loss would feel without each Gaussian, for each of its instances. First pass of making room in a full cloud.
//
// - Reads `felt` and `uses` (see `source_use`) and `screen_statistics`. What is felt is a mean over the last steps, so it is
//   divided by the part of the views that show the Gaussian: what few views show counts no less. Moments start at 0 when a
//   Gaussian is made, so what is young seems to cost less than it does (0.4 of it after 500 steps).
// - Writes `keys` (bits of the cost, for an ascending radix sort) and `values` (the index).
// - Grid: one thread per Gaussian. Bytes per Gaussian: 20 read, 8 written.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/recycle.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"

layout(scalar, binding = 0) readonly buffer Felt { float felt[]; };                          // what the loss feels, summed over instances
layout(scalar, binding = 1) readonly buffer ScreenStatistics { vec3 screen_statistics[]; };  // sum of screen gradients, number of views that show it, largest radius_px
layout(scalar, binding = 2) readonly buffer Uses { uint uses[]; };                           // number of instances that have it
layout(scalar, binding = 3) writeonly buffer Keys { uint keys[]; };                          // ascending with the cost
layout(scalar, binding = 4) writeonly buffer Values { uint values[]; };                      // index of the Gaussian
layout(scalar, push_constant) uniform DensifyCostParams {
    uint count;   // Gaussians
    float steps;  // steps that the statistics are of
};

const float LEAST_SHARE = 0.02;  // of the views: moments of what hardly any view shows are noise

void main() {
    uint i = thread_index();
    if (i >= count) return;
    float used = float(max(uses[i], 1));
    float share = clamp(screen_statistics[i].y / (steps * used), LEAST_SHARE, 1.0);
    float cost = felt[i] / (share * used);
    // What is not finite is removed by other rules.
    keys[i] = is_finite(cost) && cost >= 0.0 ? floatBitsToUint(cost) : 0xFFFFFFFF;
    values[i] = i;
}
