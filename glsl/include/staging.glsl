// How the lanes of a subgroup see each other's splats.

// 1 = through shared memory, 0 = by shuffles, of which a splat takes ten. CPU drivers read shared memory lane by lane.
layout(constant_id = 6) const uint STAGE_SPLATS = 0;

const uint STAGED_SPLATS = STAGE_SPLATS * (WORKGROUP_SIZE - 1) + 1;  // nothing to speak of without staging
shared vec4 staged_a[STAGED_SPLATS];
shared vec4 staged_b[STAGED_SPLATS];
shared vec2 staged_c[STAGED_SPLATS];

// Hands the lanes' splats to the subgroup in the order of the lanes, those with `wanted` before the others; returns their
// number. All lanes call it, after the last use of the splats before.
uint stage(Splat mine, bool wanted) {
    uvec4 ballot = subgroupBallot(wanted);
    uint count = subgroupBallotBitCount(ballot);
    uint before = subgroupBallotExclusiveBitCount(ballot);
    uint place = mix(count + gl_SubgroupInvocationID - before, before, wanted);
    uint at = gl_SubgroupID * SUBGROUP_SIZE + place;
    subgroupBarrier();
    staged_a[at] = mine.a;
    staged_b[at] = mine.b;
    staged_c[at] = mine.c;
    subgroupMemoryBarrierShared();
    subgroupBarrier();
    return count;
}

// The splat in `place` of those staged last, a number that all lanes agree on.
Splat staged_splat(uint place) {
    uint at = gl_SubgroupID * SUBGROUP_SIZE + place;
    return Splat(staged_a[at], staged_b[at], staged_c[at]);
}

// The splat of lane `from`, a number that all lanes agree on.
Splat splat_of_lane(Splat mine, uint from) {
    return Splat(subgroupShuffle(mine.a, from), subgroupShuffle(mine.b, from), subgroupShuffle(mine.c, from));
}
