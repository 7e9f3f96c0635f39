#version 460
// What the loss would feel without each Gaussian, for each instance that shows it: of source Gaussians, and of offset records
// alone. First pass of making room in a full cloud.
//
// - Reads `felt`, `record_felt` and `uses` (see `source_use`), `screen_statistics` and `record_statistics`. What is felt is a mean
//   over the last steps, so it is divided by the part of the views that show the Gaussian: what few views show counts no less.
//   Moments start at 0 when a Gaussian is made, so what is young seems to cost less than it does (0.4 of it after 500 steps).
// - Writes `keys` (bits of the cost, for an ascending radix sort), `values` (the index; records come after the sources) and
//   `draws` (how many expanded Gaussians leave with it; 0 for what is NOT_SHOWN).
// - Grid: one thread per Gaussian or record. Bytes each: at most 20 read, 12 written.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/recycle.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "strategy.glsl"

layout(scalar, binding = 0) readonly buffer Felt { float felt[]; };                          // what the loss feels, summed over instances
layout(scalar, binding = 1) readonly buffer ScreenStatistics { vec3 screen_statistics[]; };  // sum of screen gradients, number of views that show it, largest radius_px
layout(scalar, binding = 2) readonly buffer Uses { uint uses[]; };                           // number of instances that show it
layout(scalar, binding = 3) readonly buffer RecordFelt { float record_felt[]; };             // what the loss feels of each record
layout(scalar, binding = 4) readonly buffer RecordStatistics { vec2 record_statistics[]; };  // the first two of screen_statistics, by record
layout(scalar, binding = 5) writeonly buffer Keys { uint keys[]; };                          // ascending with the cost
layout(scalar, binding = 6) writeonly buffer Values { uint values[]; };                      // index of the Gaussian, or that of the record behind the sources
layout(scalar, binding = 7) writeonly buffer Draws { uint draws[]; };                        // expanded Gaussians that leave with it
layout(scalar, push_constant) uniform DensifyCostParams {
    uint count;    // source Gaussians and records
    uint sources;  // source Gaussians
    float steps;   // steps that the statistics are of
};

const float LEAST_SHARE = 0.02;  // of the views: moments of what hardly any view shows are noise

void main() {
    uint i = thread_index();
    if (i >= count) return;
    bool is_record = i >= sources;
    uint used = is_record ? 1 : uses[i];
    float views = is_record ? record_statistics[i - sources].y : screen_statistics[i].y;
    float feels = is_record ? record_felt[i - sources] : felt[i];
    float over = float(max(used, 1));
    float cost = feels / (clamp(views / (steps * over), LEAST_SHARE, 1.0) * over);
    // What is not finite is removed by other rules.
    keys[i] = is_finite(cost) && cost >= 0.0 ? floatBitsToUint(cost) : 0xFFFFFFFF;
    values[i] = i;
    draws[i] = feels == NOT_SHOWN ? 0 : used;
}
