#version 460
// Finds each tile's run in the sorted intersections; tiles without any keep the zeros they were filled with.
// Grid: one thread per intersection (indirect).
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
