#version 460
// Second pass of a radix sort step: for each digit, how many keys of earlier blocks have it, and how many keys in all.
//
// A digit's counts lie side by side, one per block, so that a work-group sums one digit on its own, in rounds of
// `WORKGROUP_SIZE` blocks, and no pass has to join the sums of work-groups. `radix_sort_scatter` adds those of smaller digits.
//
// - Reads `counters`; reads and writes `histogram` (`digit * blocks + block`): counts in, sums of earlier blocks out.
// - Writes `digit_totals` (by digit).
// - Grid: one work-group per digit, `RADIX_SIZE`.
// - Bytes per key: 1 (256 counts of 4 bytes, read and written, per 2048 keys).
// - Guarantees: sums do not wrap, since there are less than 2^32 keys.
//
// Twin: `instgs_reference::radix_sort`. Tests: `tests/kernels/radix_sort.rs`; also the start-up self-test in
// `render/self_test.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "workgroup_scan.glsl"

layout(scalar, binding = 0) readonly buffer Counters { uint counters[]; };            // COUNTER_*
layout(scalar, binding = 1) buffer Histogram { uint histogram[]; };                   // counts in, sums of earlier blocks out
layout(scalar, binding = 2) writeonly buffer DigitTotals { uint digit_totals[]; };    // keys by digit
layout(scalar, push_constant) uniform RadixSortScanParams {
    uint count_slot;  // counter that holds the number of keys
};

void main() {
    uint digit = group_index();
    uint blocks = divide_up(counters[count_slot], BLOCK_SIZE);
    uint running = 0;
    for (uint first = 0; first < blocks; first += WORKGROUP_SIZE) {
        uint block = first + subgroup_thread();
        uint at = digit * blocks + min(block, blocks - 1);
        uint count = block < blocks ? histogram[at] : 0;
        uint total;
        uint earlier = workgroup_exclusive_sum(count, total);
        if (block < blocks) histogram[at] = running + earlier;
        running += total;
    }
    if (gl_LocalInvocationID.x == 0) digit_totals[digit] = running;
}
