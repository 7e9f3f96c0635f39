#version 460
// Ends the forward half of a training step: raises the sticky overflow flag, and records loss and counts.
//
// - Reads `counters`, `ssim_sums`, `error_sums`; reads and writes `status`; writes one entry of `step_records`, a ring
//   that the host reads some steps later.
// - Grid: one work-group. Sums have a fixed order: within each thread, then over threads.
// - A step overflows if candidates, work items or intersections did not fit, or a tile's list is longer than the loops of the
//   driver (lavapipe's take 65535 iterations): then `tile_blend` has left out what is behind. From then on `adam`,
//   `gather_gradients` and all that changes poses or exposures do nothing, in this and all later steps, until the host has enlarged the buffers and reset the
//   flag; it then submits the same steps again.
//
// Twin: `instgs_reference::image_loss`. Test: `tests/kernels/image_loss.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "train_status.glsl"

layout(scalar, binding = 0) readonly buffer Counters { uint counters[]; };          // COUNTER_*
layout(scalar, binding = 1) readonly buffer SsimSums { float ssim_sums[]; };        // per strip, by thread of image_loss_columns
layout(scalar, binding = 2) readonly buffer ErrorSums { vec2 error_sums[]; };       // per strip, by thread of image_loss_backward_columns
layout(scalar, binding = 3) buffer Status { uint status[]; };                       // STATUS_*
layout(scalar, binding = 4) writeonly buffer StepRecords { StepRecord step_records[]; };  // ring of LOG_STEPS
layout(scalar, binding = 5) readonly buffer TileRanges { uvec2 tile_ranges[]; };    // first and end intersection per tile
layout(scalar, push_constant) uniform TrainStatusParams {
    uint step;                // number of the step
    uint candidate_capacity;  // candidates that fit
    uint work_item_capacity;  // work items that fit
    uint strips;              // entries of the sums
    float values;             // number of pixels times channels
    uint tile_count;          // tiles of the picture, 0 where lists may have any length
    uint longest_list;        // splats of a tile that the loops have iterations for
};

shared vec3 partial_sums[WORKGROUP_SIZE];
shared uint longest_lists[WORKGROUP_SIZE];

void main() {
    uint lane = gl_LocalInvocationID.x;
    // Each thread sums a fixed run, thread 0 sums over threads: the order is fixed.
    uint per_thread = divide_up(strips, WORKGROUP_SIZE);
    uint end = min((lane + 1) * per_thread, strips);
    vec3 sum = vec3(0.0);
    for (uint i = lane * per_thread; i < end; ++i) sum += vec3(ssim_sums[i], error_sums[i]);
    partial_sums[lane] = sum;
    uint longest = 0;
    for (uint tile = lane; tile < tile_count; tile += WORKGROUP_SIZE) longest = max(longest, tile_ranges[tile].y - tile_ranges[tile].x);
    longest_lists[lane] = longest;
    barrier();
    if (lane != 0) return;
    vec3 total = vec3(0.0);
    for (uint t = 0; t < WORKGROUP_SIZE; ++t) {
        total += partial_sums[t];
        longest = max(longest, longest_lists[t]);
    }
    bool fits = counters[COUNTER_CANDIDATES_NEEDED] <= candidate_capacity && counters[COUNTER_WORK_ITEMS_NEEDED] <= work_item_capacity &&
                counters[COUNTER_SLAB_END] == counters[COUNTER_VISIBLE] && (tile_count == 0 || longest <= longest_list);
    uint overflowed = status[STATUS_OVERFLOW] != 0 || !fits ? 1 : 0;
    status[STATUS_OVERFLOW] = overflowed;
    total /= values;
    step_records[step % LOG_STEPS] =
        StepRecord(step, overflowed, counters[COUNTER_VISIBLE], counters[COUNTER_INTERSECTIONS], counters[COUNTER_CANDIDATES_NEEDED],
                   counters[COUNTER_WORK_ITEMS_NEEDED], longest, total.x, total.y, total.z);
}
