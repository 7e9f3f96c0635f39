#version 460
// Draws a live Gaussian for every dead and every new Gaussian, with probability proportional to its weight.
//
// - Reads `weights`, their exclusive scan `before` (by a binary search per draw) and `counters[COUNTER_WEIGHTS]`;
//   random bits are a hash of (seed, steps done, index).
// - Writes `origins`; counts in `copies` and `COUNTER_RELOCATED` (integer atomics: the order does not matter). If all
//   are dead, every Gaussian stays unchanged.
// - Grid: one thread per Gaussian afterwards.
//
// Twin: `instgs_reference::mcmc`. Test: `tests/kernels/mcmc.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "strategy.glsl"
#include "random.glsl"

layout(scalar, binding = 0) readonly buffer Weights { uint weights[]; };    // fixed-point opacities, 0 = dead
layout(scalar, binding = 1) readonly buffer Before { uint before[]; };      // exclusive scan of the weights
layout(scalar, binding = 2) writeonly buffer Origins { uint origins[]; };   // itself, or the Gaussian it joins
layout(scalar, binding = 3) buffer Copies { uint copies[]; };               // number of Gaussians that join, by old Gaussian
layout(scalar, binding = 4) buffer Counters { uint counters[]; };           // COUNTER_*
layout(scalar, push_constant) uniform McmcPickParams {
    uint count;  // Gaussians before
    uint after;  // Gaussians afterwards
    uvec2 seed;  // seed of the run, low word first
    uint time;   // steps done
};

void main() {
    uint j = thread_index();
    bool in_list = j < after;
    bool moves = in_list && (j >= count || weights[min(j, count - 1)] == 0);
    uint total = counters[COUNTER_WEIGHTS];
    uint high, unused;
    umulExtended(random_bits(seed, time, RANDOM_PICK, j, 0), total, high, unused);
    // The last Gaussian that begins at or before the draw; Gaussians of weight 0 end where they begin.
    uint first = 0;
    uint end = count;
    while (end - first > 1) {
        uint middle = (first + end) / 2;
        bool left = before[middle] > high;
        end = left ? middle : end;
        first = left ? first : middle;
    }
    bool picks = moves && total > 0;
    if (in_list) origins[j] = picks ? first : min(j, count - 1);
    if (picks) atomicAdd(copies[first], 1);
    uint relocated = subgroupBallotBitCount(subgroupBallot(moves && j < count));
    if (subgroupElect() && relocated > 0) atomicAdd(counters[COUNTER_RELOCATED], relocated);
}
