#version 460
// Draws single splats as marks: every pixel gets the colour of the nearest splat whose mark covers it, darker towards
// the mark's rim. For inspecting Gaussians one by one; runs only if marks are shown.
//
// A mark is the ellipse of one standard deviation of the projected Gaussian, dilation included: within it the splat has
// at least 61 % of its opacity, and ellipses of neighbours on a surface hardly overlap, whereas the whole footprint
// (3.3 standard deviations where opaque) would hide all but the nearest. Or it is a disc of 1.5 pixels around the
// centre. Either ends where the splat's alpha falls below a bound, so that large faint splats before the camera do not
// hide all else; the least bound is 1/255, where the tiles' lists end.
//
// - Reads per 8x8 block: 40 bytes a splat and 4 a list entry, until all pixels of the block have a mark.
// - Writes `marks`, 4 bytes a pixel, from which the next slab continues.
// - Grid: one subgroup per 8x8 block of every tile.
//
// Twin: `instgs_reference::tile_marks`. Test: `tests/kernels/tile_marks.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "splat.glsl"
#include "blend.glsl"
#include "mark.glsl"

layout(scalar, binding = 0) readonly buffer Splats { Splat splats[]; };            // projected splats by slot
layout(scalar, binding = 1) readonly buffer IsectValues { uint isect_values[]; };  // slots, sorted by tile then depth
layout(scalar, binding = 2) readonly buffer TileRanges { uvec2 tile_ranges[]; };   // first and end intersection per tile
layout(scalar, binding = 3) readonly buffer Counters { uint counters[]; };         // COUNTER_*
layout(scalar, binding = 4) buffer Marks { uint marks[]; };                        // by pixel: red, green, blue and 255 from the lowest byte; 0 = no mark
layout(scalar, push_constant) uniform TileMarksParams {
    uvec2 size_px;    // image width and height
    uvec2 tiles;      // tile columns and rows
    uint shape;       // MARK_*
    float alpha_min;  // marks end where their splat's alpha falls below this; at least 1/255, where the tiles' lists end
};

const uint NO_SLOT = 0xFFFFFFFF;

uint color_of(uint slot, float part) {
    Splat splat = splats[slot];
    vec3 color = clamp(vec3(splat.b.zw, splat.c.x), 0.0, 1.0) * (1.0 - (1.0 - RIM) * part);
    uvec3 level = uvec3(color * 255.0 + 0.5);
    return level.r | level.g << 8 | level.b << 16 | 0xFF000000;
}

void main() {
    Block block = block_of_subgroup();
    if (block.tile >= tiles.x * tiles.y) return;
    uint lane = gl_SubgroupInvocationID;
    uvec2 corner = block_corner(block, tiles.x);
    uvec2 range = tile_ranges[block.tile];
    bool first_slab = counters[COUNTER_SLAB_BEGIN] == 0;

    bool open[PIXELS_PER_LANE];   // inside the image and without a mark
    uint found[PIXELS_PER_LANE];  // slot of the mark
    float part[PIXELS_PER_LANE];  // squared distance from its centre; 1 at the rim
    [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) {
        uvec2 at = corner + pixel_step(p);
        bool inside = all(lessThan(at, size_px));
        open[p] = inside;
        uint i = min(at.y, size_px.y - 1) * size_px.x + min(at.x, size_px.x - 1);
        if (!first_slab) open[p] = all(bvec2(inside, marks[i] == 0));
        found[p] = NO_SLOT;
        part[p] = 0.0;
    }

    vec2 center = vec2(corner) + 0.5;
    for (uint base = range.x; base < range.y; base += SUBGROUP_SIZE) {
        uint slot = isect_values[min(base + lane, range.y - 1)];
        Splat mine = with_conic_for_exp2(splats[slot]);
        mine.b.y = mix(0.0, mine.b.y, base + lane < range.y);
        [[unroll]] for (uint j = 0; j < SUBGROUP_SIZE; ++j) {
            vec2 delta = center - vec2(subgroupShuffle(mine.a.x, j), subgroupShuffle(mine.a.y, j));
            float opacity = subgroupShuffle(mine.b.y, j);
            vec3 conic = subgroupShuffle(conic_for_exp2(mine), j);
            uint slot_j = subgroupShuffle(slot, j);
            [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) {
                vec2 d = delta + vec2(pixel_step(p));
                float q = exponent(conic, d);
                float square = q / (-0.5 * LOG2_E);
                bool there = all(bvec2(q <= 0.0, opacity * exp2(q) >= alpha_min));
                float reach = shape == MARK_POINTS ? dot(d, d) / (POINT_RADIUS_PX * POINT_RADIUS_PX) : square;
                bool hit = all(bvec3(open[p], there, reach <= 1.0));
                found[p] = mix(found[p], slot_j, hit);
                part[p] = mix(part[p], reach, hit);
                open[p] = all(bvec2(open[p], !hit));
            }
        }
        bool any_open = false;
        [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) any_open = any_open || open[p];
        if (!subgroupAny(any_open)) break;
    }

    [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) {
        uvec2 at = corner + pixel_step(p);
        uint i = at.y * size_px.x + at.x;
        if (!all(lessThan(at, size_px))) continue;
        if (found[p] != NO_SLOT) {
            marks[i] = color_of(found[p], part[p]);
        } else if (first_slab) {
            marks[i] = 0;
        }
    }
}
