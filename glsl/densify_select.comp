#version 460
// Lets the Gaussians with the largest mean screen gradients grow, up to the cap on expanded Gaussians.
//
// - Reads `order` (Gaussians by descending gradient, ties by index), `gains`, `gains_expanded` and the exclusive scan of the
//   latter in that order, and `counters[COUNTER_KEPT]`. A Gaussian grows if it and all before it fit.
// - Updates `counts` (number of Gaussians that it becomes, those of instances' own not counted) and `growths`; adds to `COUNTER_CLONED` and `COUNTER_SPLIT`
//   (integer atomics: the order does not matter).
// - Grid: one thread per index in the order. Bytes per Gaussian: 24 read, 8 written.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "strategy.glsl"

layout(scalar, binding = 0) readonly buffer Order { uint order[]; };          // Gaussians by descending gradient, ties by index
layout(scalar, binding = 1) readonly buffer Gains { uint gains[]; };          // additional Gaussians with growth
layout(scalar, binding = 2) readonly buffer GainsBefore { uint gains_before[]; };  // exclusive scan of gains_expanded in that order
layout(scalar, binding = 3) buffer Counts { uint counts[]; };                 // in: 1 if it stays; out: number of Gaussians that it becomes
layout(scalar, binding = 4) buffer Growths { uint growths[]; };               // GROWTH_*, NONE for Gaussians that do not fit
layout(scalar, binding = 5) buffer Counters { uint counters[]; };             // COUNTER_*
layout(scalar, binding = 6) readonly buffer GainsExpanded { uint gains_expanded[]; };  // additional expanded Gaussians with growth
layout(scalar, push_constant) uniform DensifySelectParams {
    uint count;         // Gaussians
    uint max_expanded;  // largest number of expanded Gaussians afterwards
};

void main() {
    uint place = thread_index();
    bool in_list = place < count;
    uint i = order[in_list ? place : 0];
    uint gain = gains[i];
    // Both sums saturate, so a sum that exceeds 32 bits counts as too large.
    uint after = add_saturating(add_saturating(counters[COUNTER_KEPT], gains_before[in_list ? place : 0]), gains_expanded[i]);
    uint growth = after <= max_expanded ? growths[i] : GROWTH_NONE;
    if (in_list) {
        growths[i] = growth;
        counts[i] += growth != GROWTH_NONE ? gain : 0;
    }
    uint cloned = subgroupBallotBitCount(subgroupBallot(in_list && growth == GROWTH_CLONE));
    uint split = subgroupBallotBitCount(subgroupBallot(in_list && growth == GROWTH_SPLIT));
    if (subgroupElect() && cloned > 0) atomicAdd(counters[COUNTER_CLONED], cloned);
    if (subgroupElect() && split > 0) atomicAdd(counters[COUNTER_SPLIT], split);
}
