// How the lanes of a subgroup see each other's splats.

// 1 = through shared memory, 0 = by shuffles, of which a splat takes ten.
layout(constant_id = 6) const uint STAGE_SPLATS = 0;

const uint STAGED_SPLATS = STAGE_SPLATS * (WORKGROUP_SIZE - 1) + 1;  // nothing to speak of without staging
shared vec4 staged_a[STAGED_SPLATS];
shared vec4 staged_b[STAGED_SPLATS];
shared vec2 staged_c[STAGED_SPLATS];

// Hands this lane's splat to the subgroup. All lanes call it, after the last use of the splats before.
void stage(Splat mine) {
    uint stage_splats = STAGE_SPLATS;
    if (stage_splats == 0) return;
    uint at = gl_SubgroupID * SUBGROUP_SIZE + gl_SubgroupInvocationID;
    subgroupBarrier();
    staged_a[at] = mine.a;
    staged_b[at] = mine.b;
    staged_c[at] = mine.c;
    subgroupBarrier();
}

// The splat of lane `from`, a number that all lanes agree on.
Splat splat_of_lane(Splat mine, uint from) {
    uint stage_splats = STAGE_SPLATS;
    if (stage_splats == 0) {
        return Splat(subgroupShuffle(mine.a, from), subgroupShuffle(mine.b, from), subgroupShuffle(mine.c, from));
    }
    uint at = gl_SubgroupID * SUBGROUP_SIZE + from;
    return Splat(staged_a[at], staged_b[at], staged_c[at]);
}
