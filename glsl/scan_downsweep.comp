#version 460
// Last of the three passes of an exclusive scan: writes `offsets[i]`, the sum of all elements before i.
//
// Elements, gathering and the begin are those of `scan_reduce`. Each thread owns `BLOCK_SIZE / WORKGROUP_SIZE`
// consecutive elements: it sums them, gets its prefix within the work-group, adds the block's, and walks its elements
// again.
//
// - Reads `values` and `indices` (as `scan_reduce`), `block_sums` (by block: exclusive prefixes), `counters`.
// - Writes `offsets` (by element). An element before the begin gets 0.
// - Grid: as `scan_reduce`, one work-group per block.
// - Bytes per element: 4 read (8 with `GATHER`) twice, the second time mostly from the cache; 4 written. All three
//   passes together: 12 read, 4 written.
// - Guarantees: equal to a sequential saturating sum, whatever the work-group and subgroup sizes. Elements past the
//   end are neither read nor written, so buffers may be longer than the count.
//
// Twin: `instgs_reference::scan`. Tests: `tests/kernels/scan.rs` (lengths around block and work-group sizes, gather, begin).
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "workgroup_scan.glsl"
#include "scan_values.glsl"

layout(scalar, binding = 3) readonly buffer BlockSums { uint block_sums[]; };  // exclusive prefix per block
layout(scalar, binding = 4) writeonly buffer Offsets { uint offsets[]; };      // exclusive prefix per element

void main() {
    const uint per_thread = BLOCK_SIZE / WORKGROUP_SIZE;
    uint n = scan_length();
    uint block = group_index();
    uint first = block * BLOCK_SIZE + subgroup_thread() * per_thread;
    uint sum = 0;
    for (uint k = 0; k < per_thread; ++k) sum = add_saturating(sum, scan_value(first + k, n));
    uint total;
    uint running = workgroup_exclusive_sum(sum, total);
    if (block * BLOCK_SIZE < n) running = add_saturating(running, block_sums[block]);
    for (uint k = 0; k < per_thread; ++k) {
        if (first + k < n) offsets[first + k] = running;
        running = add_saturating(running, scan_value(first + k, n));
    }
}
