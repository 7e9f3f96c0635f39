// Prefix sums within a work-group of any number of subgroups; saturating at 2^32 - 1.

shared uint subgroup_totals[64];

// Index of the thread in the order of the sums. Vulkan does not guarantee that gl_LocalInvocationID has the same order.
uint subgroup_thread() {
    return gl_SubgroupID * SUBGROUP_SIZE + gl_SubgroupInvocationID;
}

// Exclusive prefix of `value` within the subgroup: log steps by shuffle.
uint subgroup_exclusive_sum(uint value) {
    uint lane = gl_SubgroupInvocationID;
    uint inclusive = value;
    [[unroll]] for (uint step = 1; step < SUBGROUP_SIZE; step *= 2) {
        uint other = subgroupShuffle(inclusive, max(lane, step) - step);
        inclusive = lane >= step ? add_saturating(inclusive, other) : inclusive;
    }
    uint previous = subgroupShuffle(inclusive, max(lane, 1) - 1);
    return lane == 0 ? 0 : previous;
}

// Exclusive prefix of `value` within the work-group, and the group's total. Every thread calls it.
uint workgroup_exclusive_sum(uint value, out uint total) {
    uint exclusive = subgroup_exclusive_sum(value);
    uint subgroups = WORKGROUP_SIZE / SUBGROUP_SIZE;
    if (subgroups == 1) {
        total = subgroupShuffle(add_saturating(exclusive, value), SUBGROUP_SIZE - 1);
        return exclusive;
    }
    barrier();  // earlier calls have finished reading subgroup_totals
    if (gl_SubgroupInvocationID == SUBGROUP_SIZE - 1) subgroup_totals[gl_SubgroupID] = add_saturating(exclusive, value);
    barrier();
    uint before = 0;
    total = 0;
    for (uint s = 0; s < WORKGROUP_SIZE / SUBGROUP_SIZE; ++s) {
        before = add_saturating(before, s < gl_SubgroupID ? subgroup_totals[s] : 0);
        total = add_saturating(total, subgroup_totals[s]);
    }
    return add_saturating(before, exclusive);
}
