#version 460
// First of the three passes of an exclusive scan (reduce, then scan): sums blocks of `BLOCK_SIZE` values.
//
// The elements are `values[i]`, or `values[indices[i]]` with the spec constant `GATHER` = 1. Their number is a counter.
// Elements before `scan.begin_slot` add 0.
//
// - Reads `values` (by element, or by index with `GATHER`), `indices` (by element, only with `GATHER`), `counters`.
// - Writes `block_sums` (by block).
// - Grid: one work-group per block, direct where the host knows the count, else indirect (`ARGS_BLOCKS`).
// - Bytes per element: 4 read (8 with `GATHER`), 4 / 2048 written.
// - Guarantees: sums saturate at 2^32 - 1. Saturating addition of counts is associative, so the result does not depend
//   on work-group or subgroup sizes, nor on order. Any number of subgroups per work-group, up to 64.
// - `BLOCK_SIZE` = 2048: 8 values per thread of 256; 2^32 elements would be 2^21 blocks, so one level of block sums
//   with a looping spine is enough.
//
// Twin: `instgs_reference::scan`. Tests: `tests/kernels/scan.rs`; also part of the start-up self-test in
// `render/self_test.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "workgroup_scan.glsl"
#include "scan_values.glsl"

layout(scalar, binding = 3) writeonly buffer BlockSums { uint block_sums[]; };  // sum per block

void main() {
    uint n = scan_length();
    uint block = group_index();
    uint sum = 0;
    for (uint k = gl_LocalInvocationID.x; k < BLOCK_SIZE; k += WORKGROUP_SIZE) {
        sum = add_saturating(sum, scan_value(block * BLOCK_SIZE + k, n));
    }
    uint total;
    workgroup_exclusive_sum(sum, total);
    if (gl_LocalInvocationID.x == 0 && block * BLOCK_SIZE < n) block_sums[block] = total;
}
