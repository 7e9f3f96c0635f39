#version 460
// Second pass of a radix sort step: moves every key and its value to their place by one digit.
//
// Each subgroup owns a contiguous run of its block's keys and walks it in rounds of one key per lane. A table in
// shared memory holds the next free place per subgroup and digit; within a round, a lane's rank is the number of lower
// lanes with the same digit (by shuffles or ballots: `Variant::match_by_ballot`).
//
// - Reads `keys_in` and `values_in` (by old index), `digit_offsets` (`digit * blocks + block`: the scanned histogram),
//   `counters`.
// - Writes `keys_out` and `values_out` (by new index).
// - Grid: one work-group per block, indirect (`ARGS_BLOCKS` of the keys' family).
// - Bytes per key: 8 read (12 with more than one subgroup, which count their own digits first) and 0.5 of offsets; 8
//   written. Shared memory: 1 KiB per subgroup.
// - Guarantees: stable: equal digits keep their order across lanes, rounds, subgroups and blocks. A permutation: every
//   key is written once, to a place of its own. Deterministic: the atomics are integer counts in shared memory, and
//   nothing is appended in the order of arrival.
//
// Twin: `instgs_reference::radix_sort`. Tests: `tests/kernels/radix_sort.rs` (lengths, key widths, equal keys, variants);
// also the start-up self-test in `render/self_test.rs`, since some drivers miscompile some subgroup sizes.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "match_digit.glsl"

layout(scalar, binding = 0) readonly buffer KeysIn { uint keys_in[]; };            // keys
layout(scalar, binding = 1) readonly buffer ValuesIn { uint values_in[]; };        // values
layout(scalar, binding = 2) readonly buffer Counters { uint counters[]; };         // COUNTER_*
layout(scalar, binding = 3) readonly buffer DigitOffsets { uint digit_offsets[]; };  // exclusive scan of the histogram
layout(scalar, binding = 4) writeonly buffer KeysOut { uint keys_out[]; };         // keys, sorted by the digit
layout(scalar, binding = 5) writeonly buffer ValuesOut { uint values_out[]; };     // values, moved along
layout(scalar, push_constant) uniform RadixSortScatterParams {
    uint count_slot;  // counter that holds the number of keys
    uint shift;       // lowest bit of the digit
};

const uint SUBGROUPS = WORKGROUP_SIZE / SUBGROUP_SIZE;
const uint KEYS_PER_SUBGROUP = BLOCK_SIZE / SUBGROUPS;
// Next free place per subgroup and digit.
shared uint places[SUBGROUPS * RADIX_SIZE];

uint digit_of(uint key) {
    return (key >> shift) & (RADIX_SIZE - 1);
}

void main() {
    uint n = counters[count_slot];
    uint block = group_index();
    uint blocks = divide_up(n, BLOCK_SIZE);
    uint table = gl_SubgroupID * RADIX_SIZE;
    uint first = block * BLOCK_SIZE + gl_SubgroupID * KEYS_PER_SUBGROUP;
    uint subgroups = SUBGROUPS;
    if (subgroups > 1) {
        for (uint d = gl_SubgroupInvocationID; d < RADIX_SIZE; d += SUBGROUP_SIZE) places[table + d] = 0;
        barrier();
        for (uint k = gl_SubgroupInvocationID; k < KEYS_PER_SUBGROUP; k += SUBGROUP_SIZE) {
            if (first + k < n) atomicAdd(places[table + digit_of(keys_in[first + k])], 1);
        }
        barrier();
    }
    for (uint d = gl_LocalInvocationID.x; d < RADIX_SIZE; d += WORKGROUP_SIZE) {
        uint place = block < blocks ? digit_offsets[d * blocks + block] : 0;
        for (uint s = 0; s < SUBGROUPS; ++s) {
            uint count = subgroups > 1 ? places[s * RADIX_SIZE + d] : 0;
            places[s * RADIX_SIZE + d] = place;
            place += count;
        }
    }
    barrier();
    for (uint k = 0; k < KEYS_PER_SUBGROUP; k += SUBGROUP_SIZE) {
        uint i = first + k + gl_SubgroupInvocationID;
        bool in_list = i < n;
        uint key = in_list ? keys_in[i] : 0;
        uint digit = digit_of(key);
        uvec2 rank_and_count = match_digit(digit, in_list);
        uint place = places[table + digit] + rank_and_count.x;
        subgroupMemoryBarrierShared();
        subgroupBarrier();
        if (in_list && rank_and_count.x + 1 == rank_and_count.y) places[table + digit] = place + 1;
        subgroupMemoryBarrierShared();
        subgroupBarrier();
        if (in_list) {
            keys_out[place] = key;
            values_out[place] = values_in[i];
        }
    }
}
