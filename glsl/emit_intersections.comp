#version 460
// Writes one (tile, slot) pair per tile that a splat of the slab touches, in depth order.
//
// - Reads `slot_from_order` and `isect_offsets` (by index in depth order), `footprints` and `tile_counts` (by slot),
//   and `counters` for the slab's begin and end.
// - Writes `tile_keys` (row-major tile index) and `slot_from_isect`, both by intersection,
//   `0..COUNTER_SLAB_INTERSECTIONS`. TRAINING: the latter are emission indices, and it writes `slot_from_emission`, and
//   `emission_ranges` by slot, for the backward pass.
// - Grid: one thread per splat of the slab, indirect (`FAMILY_SLAB_SPLATS`, `ARGS_THREADS`).
// - Bytes per splat: 44 read (slot 4, offset 4, count 4, footprint 32); 8 written per intersection.
// - Guarantees: pairs are in depth order, within a splat by ascending tile, so the stable sort by tile leaves every
//   tile's list in depth order. Tiles are found by the functions that counted them (`tile_rows` and `tile_columns` in
//   `glsl/include/splat.glsl`, `precise`) on the same stored bits; a thread writes exactly the counted number of pairs
//   and never past `capacity`. If the two ever differed, the remaining pairs would get a tile outside the image, which
//   `tile_ranges` skips.
// - A tile row takes the columns whose rectangle of pixel centres meets the ellipse alpha >= 1/255: tighter than the
//   bounding box, and never short of a pixel that the splat reaches.
//
// - LAYERED: only open tiles, as they were counted.
//
// Twin: `instgs_reference::emit_intersections`; which tiles a splat hits: `instgs_reference::preprocess_instance_expand::tiles_hit`.
// Test: `tests/kernels/intersections.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "splat.glsl"

layout(scalar, binding = 0) readonly buffer Footprints { Footprint footprints[]; };     // extents by slot
layout(scalar, binding = 1) readonly buffer SplatOrder { uint slot_from_order[]; };     // slots in depth order
layout(scalar, binding = 2) readonly buffer IsectOffsets { uint isect_offsets[]; };     // scan of tile counts from the slab's begin
layout(scalar, binding = 3) readonly buffer TileCounts { uint tile_counts[]; };         // tiles by slot
layout(scalar, binding = 4) readonly buffer Counters { uint counters[]; };              // COUNTER_*
layout(scalar, binding = 5) writeonly buffer TileKeys { uint tile_keys[]; };            // tile of the intersection
layout(scalar, binding = 6) writeonly buffer IsectValues { uint isect_values[]; };      // slot of the intersection; TRAINING: its emission index
layout(scalar, binding = 7) writeonly buffer EmissionSlots { uint slot_from_emission[]; };  // TRAINING: slot of the intersection before the sort
layout(scalar, binding = 8) writeonly buffer EmissionRanges { EmissionRange emission_ranges[]; };  // TRAINING: by slot
layout(scalar, binding = 9) readonly buffer ClosedRuns { uint closed_runs[]; };          // LAYERED: closed tiles to the right
layout(scalar, push_constant) uniform EmitParams {
    uvec2 tiles;    // tile columns and rows
    uint capacity;  // elements of tile_keys
};

#include "layers.glsl"

// 1 = the sort carries emission indices, so that the backward pass finds where each intersection adds to its splat.
layout(constant_id = 3) const uint TRAINING = 0;

void put(uint emission, uint tile, uint slot) {
    uint training = TRAINING;
    tile_keys[emission] = tile;
    isect_values[emission] = training != 0 ? emission : slot;
    if (training != 0) slot_from_emission[emission] = slot;
}

void main() {
    uint training = TRAINING;
    uint order = counters[COUNTER_SLAB_BEGIN] + thread_index();
    if (order >= counters[COUNTER_SLAB_END]) return;
    uint slot = slot_from_order[order];
    Footprint f = footprints[slot];
    uint next = min(isect_offsets[order], capacity);
    uint end = next + min(tile_counts[slot], capacity - next);
    if (training != 0) emission_ranges[slot] = EmissionRange(next, end);
    uvec2 rows = tile_rows(f, tiles.y);
    for (uint row = rows.x; row < rows.y; ++row) {
        uvec2 columns = tile_columns(f, row, tiles.x);
        uint key = row * tiles.x + columns.x;
        if (LAYERED != 0) {
            uint last = row * tiles.x + columns.y;
            while (key < last && next < end) {
                uint closed = closed_runs[key];
                if (closed == 0) put(next++, key, slot);
                key += max(closed, 1);
            }
            continue;
        }
        uint stop = min(next + max(columns.y, columns.x) - columns.x, end);
        for (; next < stop; ++next, ++key) put(next, key, slot);
    }
    // Count and emit agree bit for bit; if they ever differed, remaining pairs would get a tile outside the image.
    for (; next < end; ++next) put(next, tiles.x * tiles.y, slot);
}
