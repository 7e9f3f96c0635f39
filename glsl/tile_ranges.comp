#version 460
// Finds each tile's run in the intersections sorted by tile.
//
// - Reads `tile_keys` (by sorted intersection) and `counters`.
// - Writes `tile_ranges` (by tile): first intersection and one past the last.
// - Grid: one thread per intersection, indirect (`FAMILY_INTERSECTIONS`, `ARGS_THREADS`).
// - Bytes per intersection: 12 read (a key and its two neighbours, which the cache mostly holds); per tile that has
//   any, 8 written.
// - Guarantees: the first intersection of a run writes the start and the last one the end, so every word has one
//   writer. Tiles without intersections keep the zeros that the buffer is filled with before, an empty run. Keys
//   outside the image (see `emit_intersections`) are skipped.
//
// Twin: `instgs_reference::tile_ranges`. Test: `tests/kernels/intersections.rs` (the runs against the sorted keys).
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"

layout(scalar, binding = 0) readonly buffer TileKeys { uint tile_keys[]; };       // sorted tiles
layout(scalar, binding = 1) readonly buffer Counters { uint counters[]; };        // COUNTER_*
layout(scalar, binding = 2) writeonly buffer TileRanges { uvec2 tile_ranges[]; };  // first and end intersection per tile
layout(scalar, push_constant) uniform TileRangesParams {
    uint tile_count;  // tiles of the image
};

void main() {
    uint i = thread_index();
    uint n = counters[COUNTER_SLAB_INTERSECTIONS];
    if (i >= n) return;
    uint tile = tile_keys[i];
    uint before = i > 0 ? tile_keys[i - 1] : 0xFFFFFFFF;
    uint after = i + 1 < n ? tile_keys[i + 1] : 0xFFFFFFFF;
    if (tile >= tile_count) return;
    if (tile != before) tile_ranges[tile].x = i;
    if (tile != after) tile_ranges[tile].y = i + 1;
}
