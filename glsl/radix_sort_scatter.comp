#version 460
// Last pass of a radix sort step: moves every key and its value to their place by one digit.
//
// Each subgroup owns a contiguous run of its block's keys and walks it in rounds of one key per lane. A table in
// shared memory holds the next free place per subgroup and digit; within a round, a lane's rank is the number of lower
// lanes with the same digit (by shuffles or ballots: `Variant::match_by_ballot`).
//
// With `STAGE_KEYS` a block is first sorted in shared memory, and neighbours are then written by neighbours: of 32 keys in
// their old order, nearly every one has a digit and so a memory transaction of its own. Without, keys are written where
// their round finds them.
//
// - Reads `keys_in` and `values_in` (by old index), `earlier_blocks` (`digit * blocks + block`: keys with that digit in
//   earlier blocks), `digit_totals`, `counters`.
// - Writes `keys_out` and `values_out` (by new index).
// - Grid: one work-group per block, indirect (`ARGS_BLOCKS` of the keys' family).
// - Bytes per key: 8 read (12 without `STAGE_KEYS` and with more than one subgroup, which count their own digits first) and
//   0.5 of counts; 8 written. Shared memory: 1 KiB per subgroup, with `STAGE_KEYS` 8 KiB at least, and 1 KiB.
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
#include "workgroup_scan.glsl"

layout(scalar, binding = 0) readonly buffer KeysIn { uint keys_in[]; };            // keys
layout(scalar, binding = 1) readonly buffer ValuesIn { uint values_in[]; };        // values
layout(scalar, binding = 2) readonly buffer Counters { uint counters[]; };         // COUNTER_*
layout(scalar, binding = 3) readonly buffer EarlierBlocks { uint earlier_blocks[]; };  // keys with the digit in earlier blocks
layout(scalar, binding = 6) readonly buffer DigitTotals { uint digit_totals[]; };  // keys by digit
layout(scalar, binding = 4) writeonly buffer KeysOut { uint keys_out[]; };         // keys, sorted by the digit
layout(scalar, binding = 5) writeonly buffer ValuesOut { uint values_out[]; };     // values, moved along
layout(scalar, push_constant) uniform RadixSortScatterParams {
    uint count_slot;  // counter that holds the number of keys
    uint shift;       // lowest bit of the digit
};

// 1 = a block is sorted in shared memory first; needs more than one subgroup.
layout(constant_id = 3) const uint STAGE_KEYS = 0;

const uint SUBGROUPS = WORKGROUP_SIZE / SUBGROUP_SIZE;
const uint KEYS_PER_SUBGROUP = BLOCK_SIZE / SUBGROUPS;
const uint STAGED_ROUNDS = STAGE_KEYS * (KEYS_PER_SUBGROUP / SUBGROUP_SIZE - 1) + 1;  // one without staging
const uint TABLES = SUBGROUPS * RADIX_SIZE;
const uint MORE_FOR_BLOCK = STAGE_KEYS * ((BLOCK_SIZE - TABLES % BLOCK_SIZE) % BLOCK_SIZE);  // 0 where the tables are as long
// By subgroup and digit: keys so far, later the next free place. With STAGE_KEYS in the end the sorted block's keys, then values.
shared uint places[TABLES + MORE_FOR_BLOCK];
// By digit: the place of the block's first key.
shared uint digit_places[RADIX_SIZE];

uint digit_of(uint key) {
    return (key >> shift) & (RADIX_SIZE - 1);
}

// Where a key of this round goes by `places`, which then point behind it. All lanes call it.
uint take_place(uint table, uint digit, bool in_list) {
    uvec2 rank_and_count = match_digit(digit, in_list);
    uint place = places[table + digit] + rank_and_count.x;
    subgroupMemoryBarrierShared();
    subgroupBarrier();
    if (in_list && rank_and_count.x + 1 == rank_and_count.y) places[table + digit] = place + 1;
    subgroupMemoryBarrierShared();
    subgroupBarrier();
    return place;
}

// Sets `digit_places`: all keys with smaller digits, and those of earlier blocks with the same. Ends without a barrier.
void find_digit_places(uint block, uint blocks) {
    uint smaller = 0;
    for (uint first = 0; first < RADIX_SIZE; first += WORKGROUP_SIZE) {
        uint digit = first + subgroup_thread();
        uint at = min(digit, RADIX_SIZE - 1);
        uint total;
        uint before = workgroup_exclusive_sum(digit < RADIX_SIZE ? digit_totals[at] : 0, total);
        uint earlier = block < blocks ? earlier_blocks[at * blocks + block] : 0;
        if (digit < RADIX_SIZE) digit_places[digit] = smaller + before + earlier;
        smaller += total;
    }
}

// Every key to its place in the list.
void scatter(uint block, uint blocks, uint n) {
    uint table = gl_SubgroupID * RADIX_SIZE;
    uint first = block * BLOCK_SIZE + gl_SubgroupID * KEYS_PER_SUBGROUP;
    uint subgroups = SUBGROUPS;
    if (subgroups > 1) {
        for (uint d = gl_SubgroupInvocationID; d < RADIX_SIZE; d += SUBGROUP_SIZE) places[table + d] = 0;
        barrier();
        for (uint k = gl_SubgroupInvocationID; k < KEYS_PER_SUBGROUP; k += SUBGROUP_SIZE) {
            if (first + k < n) atomicAdd(places[table + digit_of(keys_in[first + k])], 1);
        }
    }
    barrier();
    for (uint d = gl_LocalInvocationID.x; d < RADIX_SIZE; d += WORKGROUP_SIZE) {
        uint place = digit_places[d];
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
        uint place = take_place(table, digit_of(key), in_list);
        if (in_list) {
            keys_out[place] = key;
            values_out[place] = values_in[i];
        }
    }
}

// By round, the place of a lane's key: first among its subgroup's keys of the digit, then in the sorted block. Two to a word: a
// place is below BLOCK_SIZE, and it is here that 16 lanes of an Intel GPU run out of registers.
const uint RANK_BITS = 16;
uint ranks[(STAGED_ROUNDS + 1) / 2];

void add_rank(uint round, uint more) {
    ranks[round / 2] += more << (RANK_BITS * (round % 2));
}

uint rank_of(uint round) {
    return ranks[round / 2] >> (RANK_BITS * (round % 2)) & ((1u << RANK_BITS) - 1);
}

// The same by way of shared memory.
void sort_and_scatter(uint block, uint n) {
    uint table = gl_SubgroupID * RADIX_SIZE;
    uint first = block * BLOCK_SIZE + gl_SubgroupID * KEYS_PER_SUBGROUP + gl_SubgroupInvocationID;
    uint keys[STAGED_ROUNDS];
    [[unroll]] for (uint r = 0; r < STAGED_ROUNDS; ++r) {
        uint i = first + r * SUBGROUP_SIZE;
        keys[r] = i < n ? keys_in[i] : 0;
    }
    for (uint d = gl_SubgroupInvocationID; d < RADIX_SIZE; d += SUBGROUP_SIZE) places[table + d] = 0;
    subgroupMemoryBarrierShared();
    subgroupBarrier();
    [[unroll]] for (uint r = 0; r < STAGED_ROUNDS; ++r) {
        if (r % 2 == 0) ranks[r / 2] = 0;
        add_rank(r, take_place(table, digit_of(keys[r]), first + r * SUBGROUP_SIZE < n));
    }
    barrier();
    // From counts to places in the sorted block, and from the places of digits to how far they are from those.
    uint smaller = 0;
    for (uint first_digit = 0; first_digit < RADIX_SIZE; first_digit += WORKGROUP_SIZE) {
        uint digit = first_digit + subgroup_thread();
        uint d = min(digit, RADIX_SIZE - 1);
        uint count = 0;
        // Unrolled, the counts of all subgroups would be read at once, into registers that are not there.
        [[dont_unroll]] for (uint s = 0; s < SUBGROUPS; ++s) count += places[s * RADIX_SIZE + d];
        uint total;
        uint place = smaller + workgroup_exclusive_sum(digit < RADIX_SIZE ? count : 0, total);
        smaller += total;
        if (digit < RADIX_SIZE) {
            digit_places[d] -= place;
            [[dont_unroll]] for (uint s = 0; s < SUBGROUPS; ++s) {
                uint in_subgroup = places[s * RADIX_SIZE + d];
                places[s * RADIX_SIZE + d] = place;
                place += in_subgroup;
            }
        }
    }
    barrier();
    [[unroll]] for (uint r = 0; r < STAGED_ROUNDS; ++r) add_rank(r, places[table + digit_of(keys[r])]);
    barrier();
    // The table has been read: its room is the block's.
    [[unroll]] for (uint r = 0; r < STAGED_ROUNDS; ++r) {
        if (first + r * SUBGROUP_SIZE < n) places[rank_of(r)] = keys[r];
    }
    barrier();
    [[unroll]] for (uint r = 0; r < STAGED_ROUNDS; ++r) keys[r] = places[r * WORKGROUP_SIZE + gl_LocalInvocationID.x];
    barrier();
    [[unroll]] for (uint r = 0; r < STAGED_ROUNDS; ++r) {
        uint i = first + r * SUBGROUP_SIZE;
        // Read no earlier, or they would take registers from the first round on.
        if (i < n) places[rank_of(r)] = values_in[i];
    }
    barrier();
    uint end = min(n - min(n, block * BLOCK_SIZE), BLOCK_SIZE);
    [[unroll]] for (uint r = 0; r < STAGED_ROUNDS; ++r) {
        uint k = r * WORKGROUP_SIZE + gl_LocalInvocationID.x;
        if (k < end) {
            uint place = digit_places[digit_of(keys[r])] + k;
            keys_out[place] = keys[r];
            values_out[place] = places[k];
        }
    }
}

void main() {
    uint n = counters[count_slot];
    uint block = group_index();
    uint blocks = divide_up(n, BLOCK_SIZE);
    find_digit_places(block, blocks);
    uint stage_keys = STAGE_KEYS;
    if (stage_keys != 0) {
        sort_and_scatter(block, n);
    } else {
        scatter(block, blocks, n);
    }
}
