#version 460
// Finds the tiles whose pixels have all been ended by the stop rule, between two depth layers.
//
// - Reads `depths` (by pixel): the live transmittance, 0 where the pixel has ended.
// - Writes `closed_runs` (by tile, row major): how many closed tiles follow each other from this one to the right; 0 for an open
//   tile. So a rectangle of tiles is tested with one read a row.
// - Grid: one work-group per row of tiles, which walks the row from right to left, `WORKGROUP_SIZE` tiles at a time.
// - Bytes: 4 read of 8 per pixel (fewer in open tiles), 4 written per tile.
// - Guarantees: pixels outside the image do not keep a tile open.
//
// Twin: `instgs_reference::layers`. Test: `tests/kernels/layers.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "splat.glsl"

layout(scalar, binding = 0) readonly buffer Depths { vec2 depths[]; };            // weighted sum of depths, live T
layout(scalar, binding = 1) writeonly buffer ClosedRuns { uint closed_runs[]; };  // closed tiles to the right
layout(scalar, push_constant) uniform CloseTilesParams {
    uvec2 size_px;  // image width and height
    uvec2 tiles;    // tile columns and rows
};

shared uint closed[WORKGROUP_SIZE];

bool is_closed(uvec2 tile) {
    uvec2 first = tile * TILE_SIZE;
    uvec2 end = min(first + TILE_SIZE, size_px);
    for (uint y = first.y; y < end.y; ++y) {
        for (uint x = first.x; x < end.x; ++x) {
            if (depths[y * size_px.x + x].y != 0.0) return false;
        }
    }
    return true;
}

void main() {
    uint row = group_index();
    if (row >= tiles.y) return;
    uint lane = gl_LocalInvocationID.x;
    uint run = 0;
    for (uint part = divide_up(tiles.x, WORKGROUP_SIZE); part > 0; --part) {
        uint first = (part - 1) * WORKGROUP_SIZE;
        uint column = first + lane;
        closed[lane] = column < tiles.x && is_closed(uvec2(column, row)) ? 1 : 0;
        barrier();
        if (lane == 0) {
            for (uint k = min(WORKGROUP_SIZE, tiles.x - first); k > 0; --k) {
                run = closed[k - 1] != 0 ? run + 1 : 0;
                closed_runs[row * tiles.x + first + k - 1] = run;
            }
        }
        barrier();
    }
}
