#version 460
// Chooses the depths at which a frame's layers begin: the second of two passes.
//
// Each layer but the first gets as many chunks as all before it: with 4 layers the first takes an eighth of the chunks, the last
// half of them. So if the front of a scene hides what is behind, little of it has been expanded before that is known.
//
// - Reads `layer_bins` (by bin): chunks by depth.
// - Writes to `counters`, from `COUNTER_LAYER_BEGIN` on, the bits of the depths at which the layers begin, and of the end of the
//   last: the first is 0, the last infinity.
// - Grid: one work-group, which scans the bins.
// - Bytes: 4 read per bin.
// - Guarantees: bounds ascend. Layers may be empty, if many chunks are equally far.
//
// Twin: `instgs_reference::layers`. Test: `tests/kernels/layers.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "workgroup_scan.glsl"

layout(scalar, binding = 0) readonly buffer LayerBins { uint layer_bins[]; };  // chunks by depth
layout(scalar, binding = 1) writeonly buffer Counters { uint counters[]; };   // COUNTER_*

void main() {
    uint each = LAYER_BINS / WORKGROUP_SIZE;
    uint first = subgroup_thread() * each;
    uint own = 0;
    for (uint b = first; b < first + each; ++b) own += layer_bins[b];
    uint total;
    uint before = workgroup_exclusive_sum(own, total);
    for (uint b = first; b < first + each; ++b) {
        uint after = before + layer_bins[b];
        for (uint layer = 1; layer < LAYERS; ++layer) {
            uint wanted = max(total >> (LAYERS - layer), 1);
            // Exactly one bin brings the sum to `wanted`: the layer begins behind it.
            if (before < wanted && wanted <= after) counters[COUNTER_LAYER_BEGIN + layer] = (b + 1) * LAYER_BIN_BITS;
        }
        before = after;
    }
    if (gl_LocalInvocationID.x != 0) return;
    counters[COUNTER_LAYER_BEGIN] = 0;
    counters[COUNTER_LAYER_BEGIN + LAYERS] = 0x7F800000;
    if (total != 0) return;
    for (uint layer = 1; layer < LAYERS; ++layer) counters[COUNTER_LAYER_BEGIN + layer] = 0x7F800000;
}
