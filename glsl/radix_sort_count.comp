#version 460
// First pass of a radix sort step: how often each digit occurs in each block of `BLOCK_SIZE` keys.
//
// A sort goes from the least significant digit to the highest that keys can have (`render/sort.rs`); every step is
// this kernel, `radix_sort_scan` and `radix_sort_scatter`. Depth keys take 4 steps; tile keys 1 up to 255
// tiles, 2 up to 65535, then 3.
//
// - Reads `keys` (by index in the list) and `counters`.
// - Writes `histogram`, digit-major: `digit * blocks + block`.
// - Grid: one work-group per block, indirect (`ARGS_BLOCKS` of the keys' family).
// - Bytes per key: 4 read, 0.5 written (256 counts of 4 bytes per 2048 keys). Shared memory: 1 KiB.
// - Guarantees: counts do not depend on order: integer atomics in shared memory, or, where one subgroup is the whole
//   work-group, one addition per distinct digit and round, found as in `radix_sort_scatter`. Keys past the count are
//   not read.
// - `RADIX_BITS` = 8 and so `RADIX_SIZE` = 256 counts; `BLOCK_SIZE` = 2048 keys keep the histogram an eighth of the
//   keys.
//
// Twin: `instgs_reference::radix_sort`. Tests: `tests/kernels/radix_sort.rs`; also the start-up self-test in
// `render/self_test.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "match_digit.glsl"

layout(scalar, binding = 0) readonly buffer Keys { uint keys[]; };               // keys
layout(scalar, binding = 1) readonly buffer Counters { uint counters[]; };       // COUNTER_*
layout(scalar, binding = 2) writeonly buffer Histogram { uint histogram[]; };    // counts, digit * blocks + block
layout(scalar, push_constant) uniform RadixSortCountParams {
    uint count_slot;  // counter that holds the number of keys
    uint shift;       // lowest bit of the digit
};

shared uint digit_counts[RADIX_SIZE];

void main() {
    uint n = counters[count_slot];
    uint block = group_index();
    uint blocks = divide_up(n, BLOCK_SIZE);
    for (uint d = gl_LocalInvocationID.x; d < RADIX_SIZE; d += WORKGROUP_SIZE) digit_counts[d] = 0;
    barrier();
    uint subgroups = WORKGROUP_SIZE / SUBGROUP_SIZE;
    for (uint k = gl_LocalInvocationID.x; k < BLOCK_SIZE; k += WORKGROUP_SIZE) {
        uint i = block * BLOCK_SIZE + k;
        bool in_list = i < n;
        uint digit = in_list ? (keys[i] >> shift) & (RADIX_SIZE - 1) : 0;
        if (subgroups == 1) {
            // A single subgroup needs no atomics, which a CPU driver locks one by one.
            uvec2 rank_and_count = match_digit(digit, in_list);
            uint before = digit_counts[digit];
            bool last_of_digit = in_list && rank_and_count.x + 1 == rank_and_count.y;
            if (last_of_digit) digit_counts[digit] = before + rank_and_count.y;
            subgroupMemoryBarrierShared();
            subgroupBarrier();
        } else if (in_list) {
            atomicAdd(digit_counts[digit], 1);
        }
    }
    barrier();
    for (uint d = gl_LocalInvocationID.x; d < RADIX_SIZE; d += WORKGROUP_SIZE) {
        if (block < blocks) histogram[d * blocks + block] = digit_counts[d];
    }
}
