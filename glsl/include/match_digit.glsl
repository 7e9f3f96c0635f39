// Ranks of equal digits within a subgroup.

// 0 = one shuffle per lane: a single instruction each on lavapipe, where ballots are loops. 1 = one ballot per bit,
// whose cost does not grow with the subgroup.
layout(constant_id = 2) const uint MATCH_BY_BALLOT = 1;

// Among the lanes with `in_list` set: the number of lower lanes with the same digit, and of all lanes with it.
uvec2 match_digit(uint digit, bool in_list) {
    uvec2 rank_and_count = uvec2(0);
    uint tagged = in_list ? digit : 0xFFFFFFFF;
    uint by_ballot = MATCH_BY_BALLOT;
    if (by_ballot == 0) {
        [[unroll]] for (uint other_lane = 0; other_lane < SUBGROUP_SIZE; ++other_lane) {
            uint same = subgroupShuffle(tagged, other_lane) == tagged ? 1 : 0;
            rank_and_count.x += other_lane < gl_SubgroupInvocationID ? same : 0;
            rank_and_count.y += same;
        }
    } else {
        uvec4 peers = subgroupBallot(in_list);
        [[unroll]] for (uint bit = 0; bit < RADIX_BITS; ++bit) {
            bool set = ((digit >> bit) & 1) != 0;
            uvec4 ballot = subgroupBallot(set);
            peers &= set ? ballot : ~ballot;
        }
        rank_and_count = uvec2(subgroupBallotExclusiveBitCount(peers), subgroupBallotBitCount(peers));
    }
    return rank_and_count;
}
