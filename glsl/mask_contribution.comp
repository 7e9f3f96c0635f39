#version 460
// Contribution of every Gaussian to every mask of a view: `A[i, m] = sum over pixels with mask m of alpha_i T_i`, the
// derivative of those pixels' colours by the Gaussian's colour, for all masks at once (paper, Eq. 2-3).
//
// It replays `tile_blend` for the pixels of one *unit*: an 8x8 block and one of the mask ids in it. Most blocks have
// one or two ids. A unit has one entry for each element of its tile's list, and each entry has one writer: no atomics,
// and no table that could overflow. The host lists the units (`render::contributions`) and sums the entries of a
// Gaussian.
//
// - Reads per unit: 40 bytes a splat, 4 of its footprint and 4 a list entry; ids and, after the first depth slab,
//   transmittances of its pixels.
// - Writes `contributions`: 8 bytes an entry, the source Gaussian and its sum; (0, 0) once all pixels have ended.
// - Grid: one subgroup per unit.
// - Sums are fixed point, 2^-24 of a pixel: an entry is below 64 * 2^24 = 2^30, and the least weight that is blended,
//   1e-4 / 255, is 6 units, so a Gaussian that is drawn never sums to 0. Integers add up to the same in any order:
//   tile size, subgroup size, depth slabs and batches change nothing as long as alpha and T have the same bits.
// - For plain clouds, where a Gaussian's index in its template is its index in the pool of sources.
//
// Twin: `instgs_reference::mask_contribution`. Test: `tests/kernels/mask_contribution.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "splat.glsl"
#include "blend.glsl"
#include "mask_unit.glsl"

layout(scalar, binding = 0) readonly buffer Splats { Splat splats[]; };                      // projected splats by slot
layout(scalar, binding = 1) readonly buffer Footprints { Footprint footprints[]; };          // local: the index in the plain cloud
layout(scalar, binding = 2) readonly buffer IsectValues { uint isect_values[]; };            // slots, sorted by tile then depth
layout(scalar, binding = 3) readonly buffer TileRanges { uvec2 tile_ranges[]; };             // first and end intersection per tile
layout(scalar, binding = 4) readonly buffer LiveDepths { vec2 live_depths[]; };              // y: live T after the previous depth slab
layout(scalar, binding = 5) readonly buffer PixelIds { uint pixel_ids[]; };                  // mask id by pixel
layout(scalar, binding = 6) readonly buffer MaskUnits { MaskUnit units[]; };                 // block and mask id of each subgroup
layout(scalar, binding = 7) writeonly buffer Contributions { uvec2 contributions[]; };       // source Gaussian, sum in CONTRIBUTION_ONE
layout(scalar, push_constant) uniform MaskContributionParams {
    uvec2 size_px;    // image width and height
    uvec2 tiles;      // tile columns and rows
    uint unit_count;  // elements of units
    uint first_slab;  // 1 = nothing lies in front, live_depths is not read
};

void main() {
    uint unit_index = group_index() * (WORKGROUP_SIZE / SUBGROUP_SIZE) + gl_SubgroupID;
    if (unit_index >= unit_count) return;
    MaskUnit unit = units[unit_index];
    Block block = Block(unit.block / BLOCKS_PER_TILE, unit.block % BLOCKS_PER_TILE);
    uint lane = gl_SubgroupInvocationID;
    uvec2 corner = block_corner(block, tiles.x);
    uvec2 range = tile_ranges[block.tile];

    float t[PIXELS_PER_LANE];  // transmittance while the pixel is live, 0 once the stop rule has fired
    [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) {
        uvec2 at = corner + pixel_step(p);
        uint i = min(at.y, size_px.y - 1) * size_px.x + min(at.x, size_px.x - 1);
        bool inside = all(bvec2(all(lessThan(at, size_px)), pixel_ids[i] == unit.id));
        // Pixels with other ids are ignored: the subgroup ends when the pixels of its id have ended.
        t[p] = float(inside);
        if (first_slab == 0) t[p] *= live_depths[i].y;
    }

    vec2 center = vec2(corner) + 0.5;
    uint base = range.x;
    for (; base < range.y; base += SUBGROUP_SIZE) {
        uint i = min(base + lane, range.y - 1);
        uint slot = isect_values[i];
        Splat mine = with_conic_for_exp2(splats[slot]);
        mine.b.y = mix(0.0, mine.b.y, base + lane < range.y);
        uint own = 0;
        [[unroll]] for (uint j = 0; j < SUBGROUP_SIZE; ++j) {
            vec2 delta = center - vec2(subgroupShuffle(mine.a.x, j), subgroupShuffle(mine.a.y, j));
            float opacity = subgroupShuffle(mine.b.y, j);
            vec3 conic = subgroupShuffle(conic_for_exp2(mine), j);
            uint sum = 0;
            [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) {
                float q = exponent(conic, delta + vec2(pixel_step(p)));
                float alpha = alpha_where_hit(q, opacity);
                float t_next = t[p] * (1.0 - alpha);
                bool live = t_next >= T_STOP;
                sum += uint(mix(0.0, alpha * t[p], live) * float(CONTRIBUTION_ONE));
                t[p] = mix(0.0, t_next, live);
            }
            // Integers: the sum does not depend on the order.
            [[unroll]] for (uint mask = 1; mask < SUBGROUP_SIZE; mask *= 2) sum += subgroupShuffleXor(sum, mask);
            own = mix(own, sum, lane == j);
        }
        if (base + lane < range.y) contributions[unit.first_entry + i - range.x] = uvec2(footprints[slot].local, own);
        float live = 0.0;
        [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) live = max(live, t[p]);
        if (!subgroupAny(live > 0.0)) break;
    }
    // Entries that no live pixel has reached.
    for (uint i = base + SUBGROUP_SIZE + lane; i < range.y; i += SUBGROUP_SIZE) {
        contributions[unit.first_entry + i - range.x] = uvec2(0);
    }
}
