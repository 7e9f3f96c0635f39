#version 460
// Marks what costs least: `densify_mark` removes source Gaussians and `densify_offsets` hides records, so that a full cloud gets
// room to grow.
//
// - Reads `order` (source Gaussians, and records behind them, by ascending cost, ties by index), `draws` (see `densify_cost`),
//   and `draws_before`, the exclusive scan of these in that order. Writes `retired` of those that are needed to free `goal`
//   expanded Gaussians; adds to `COUNTER_HIDDEN` (integer atomics: the order does not matter).
// - Grid: one thread per index in the order. Bytes each: 12 read.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/recycle.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "strategy.glsl"

layout(scalar, binding = 0) readonly buffer Order { uint order[]; };               // by ascending cost
layout(scalar, binding = 1) readonly buffer Draws { uint draws[]; };               // expanded Gaussians that leave with each
layout(scalar, binding = 2) readonly buffer DrawsBefore { uint draws_before[]; };  // the same of all before it in that order
layout(scalar, binding = 3) buffer Counters { uint counters[]; };                  // COUNTER_*
layout(scalar, binding = 4) writeonly buffer Retired { uint retired[]; };          // 1 = leaves; by source, then by record
layout(scalar, push_constant) uniform DensifyRetireParams {
    uint count;    // source Gaussians and records
    uint sources;  // source Gaussians
    uint goal;     // expanded Gaussians to be freed
};

void main() {
    uint place = thread_index();
    bool in_list = place < count;
    uint i = order[in_list ? place : 0];
    bool leaves = in_list && draws_before[in_list ? place : 0] < goal && draws[i] > 0;
    if (leaves) retired[i] = 1;
    uint hidden = subgroupBallotBitCount(subgroupBallot(leaves && i >= sources));
    if (subgroupElect() && hidden > 0) atomicAdd(counters[COUNTER_HIDDEN], hidden);
}
