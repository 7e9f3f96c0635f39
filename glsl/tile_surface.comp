#version 460
// The id buffer: for every pixel, the Gaussian whose splat brings the transmittance below one half. For picking, for
// outlines of selected instances, and for views of instances, templates and offsets; runs only if one of these is
// needed.
//
// It replays `tile_blend` without colours, and ends when all pixels of a block have their surface.
//
// - Reads per 8x8 block: 40 bytes a splat and 4 a list entry, up to the last surface; after the first depth slab, the
//   state of the pixels.
// - Writes `surfaces`, 8 bytes a pixel: the instance and the index in its template. Before the last slab, the slot and
//   the transmittance so far, from which the next slab continues.
// - Grid: one subgroup per 8x8 block of every tile.
// - The background's instance is one more than the last. Local indices count an instance's Gaussians in the rows before.
//
// Twin: `instgs_reference::tile_surface`. Test: `tests/kernels/tile_surface.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "scene.glsl"
#include "splat.glsl"
#include "surface.glsl"
#include "blend.glsl"

layout(scalar, binding = 0) readonly buffer Splats { Splat splats[]; };              // projected splats by slot
layout(scalar, binding = 1) readonly buffer IsectValues { uint isect_values[]; };    // slots, sorted by tile then depth
layout(scalar, binding = 2) readonly buffer TileRanges { uvec2 tile_ranges[]; };     // first and end intersection per tile
layout(scalar, binding = 3) readonly buffer WorkItems { WorkItem work_items[]; };    // visible chunks
layout(scalar, binding = 4) buffer Surfaces { uvec2 surfaces[]; };                   // by pixel: instance or NO_INSTANCE, and local index; between slabs slot and bits of T
layout(scalar, binding = 5) readonly buffer Footprints { Footprint footprints[]; };  // extents by slot, for local indices
layout(scalar, binding = 6) readonly buffer Counters { uint counters[]; };           // COUNTER_*
layout(scalar, binding = 7) readonly buffer Instances { Instance instances[]; };      // rows of instances
layout(scalar, push_constant) uniform TileSurfaceParams {
    uvec2 size_px;    // image width and height
    uvec2 tiles;      // tile columns and rows
    uint chunk_size;  // slots of a work item
};

// Transmittance below which a pixel has found its surface.
const float T_SURFACE = 0.5;
const uint NO_SLOT = 0xFFFFFFFF;

// Instance, and local index in its level that is shown; own Gaussians come after those of the template.
uvec2 point_of(uint slot) {
    if (slot == NO_SLOT) return uvec2(NO_INSTANCE, 0);
    Instance row = instances[work_items[slot / chunk_size].instance];
    return uvec2(row.owner, row.local_before + footprints[slot].local);
}

void main() {
    Block block = block_of_subgroup();
    if (block.tile >= tiles.x * tiles.y) return;
    uint lane = gl_SubgroupInvocationID;
    uint blocks_per_tile = BLOCKS_PER_TILE;
    uvec2 origin = block_origin(block, tiles.x);
    uvec2 corner = origin + lane_in_block();
    uvec2 range = tile_ranges[block.tile];
    bool first_slab = counters[COUNTER_SLAB_BEGIN] == 0;
    bool last_slab = counters[COUNTER_SLAB_END] == counters[COUNTER_VISIBLE];

    float t[PIXELS_PER_LANE];
    uint found[PIXELS_PER_LANE];
    [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) {
        uvec2 at = corner + pixel_step(p);
        bool inside = all(lessThan(at, size_px));
        uint i = min(at.y, size_px.y - 1) * size_px.x + min(at.x, size_px.x - 1);
        // Pixels outside the image need no surface.
        t[p] = float(inside);
        found[p] = NO_SLOT;
        if (!first_slab) {
            t[p] *= uintBitsToFloat(surfaces[i].y);
            found[p] = surfaces[i].x;
        }
    }

    vec2 center = vec2(corner) + 0.5;
    for (uint base = range.x; base < range.y; base += SUBGROUP_SIZE) {
        uint slot = isect_values[min(base + lane, range.y - 1)];
        Splat stored = splats[slot];
        Splat mine = with_conic_for_exp2(stored);
        uvec4 reaching = subgroupBallot(BLOCKS_PER_TILE == 1 || reaches_block(stored, origin));
        // The same arithmetic as in tile_blend, bit for bit.
        mine.b.y = mix(0.0, mine.b.y, base + lane < range.y);
        [[unroll]] for (uint j = 0; j < SUBGROUP_SIZE; ++j) {
            if (blocks_per_tile != 1 && !subgroupBallotBitExtract(reaching, j)) continue;
            vec2 delta = center - vec2(subgroupShuffle(mine.a.x, j), subgroupShuffle(mine.a.y, j));
            float opacity = subgroupShuffle(mine.b.y, j);
            vec3 conic = subgroupShuffle(conic_for_exp2(mine), j);
            uint slot_j = subgroupShuffle(slot, j);
            [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) {
                float q = exponent(conic, delta + vec2(pixel_step(p)));
                float alpha = min(ALPHA_MAX, opacity * exp2(q));
                bool hit = all(bvec3(alpha >= ALPHA_MIN, q <= 0.0, t[p] >= T_SURFACE));
                float t_next = t[p] * (1.0 - alpha);
                found[p] = mix(found[p], slot_j, all(bvec2(hit, t_next < T_SURFACE)));
                t[p] = mix(t[p], t_next, hit);
            }
        }
        float live = 0.0;
        [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) live = max(live, t[p]);
        if (!subgroupAny(live >= T_SURFACE)) break;
    }

    [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) {
        uvec2 at = corner + pixel_step(p);
        if (all(lessThan(at, size_px))) {
            uint i = at.y * size_px.x + at.x;
            surfaces[i] = last_slab ? point_of(found[p]) : uvec2(found[p], floatBitsToUint(t[p]));
        }
    }
}
