#version 460
// Blends each tile's splats front to back: colour, alpha, expected depth.
//
// One subgroup owns an 8x8 block of pixels, `64 / SUBGROUP_SIZE` pixels a lane. Its lanes load one splat each, and the
// subgroup walks them by shuffle or through its part of the shared memory: no work-group barrier. Where the whole walk is
// unrolled the shuffles have constant lanes. Of a tile with several blocks each takes the splats that reach it. Pixel rules:
// alpha < 1/255 or sigma < 0 is skipped, alpha is clamped at 0.99, and the splat that would bring T below 1e-4 ends the pixel
// and is not blended.
//
// - Reads: 40 bytes a splat and 4 a list entry, once per 8x8 block; the tile's range; counters.
// - Writes: 24 bytes a pixel. Between depth slabs they hold the exact fp32 state, so slabs do not change a bit. In training
//   there are no depths.
// - Grid: one subgroup per 8x8 block of every tile.
//
// Twin: `instgs_reference::tile_blend`. Tests: `tests/kernels/forward.rs`, `overflow.rs`, `poison.rs`. What else was tried,
// and how long it took, is in `docs/measurements.md`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "splat.glsl"

layout(scalar, binding = 0) readonly buffer Splats { Splat splats[]; };               // projected splats by slot
layout(scalar, binding = 1) readonly buffer IsectValues { uint isect_values[]; };     // slots, sorted by tile then depth; TRAINING: emission indices
layout(scalar, binding = 6) readonly buffer EmissionSlots { uint slot_from_emission[]; };  // TRAINING: slot by emission index
layout(scalar, binding = 2) readonly buffer TileRanges { uvec2 tile_ranges[]; };      // first and end intersection per tile
layout(scalar, binding = 3) readonly buffer Counters { uint counters[]; };            // COUNTER_*
layout(scalar, binding = 4) buffer Colors { vec4 colors[]; };                         // rgb over the background, and alpha; between slabs rgb alone, and Pixel.t
layout(scalar, binding = 5) buffer Depths { vec2 depths[]; };                         // expected view depth (between slabs its weighted sum), live T
layout(scalar, push_constant) uniform TileBlendParams {
    vec3 background;  // colour behind everything
    uvec2 size_px;    // image width and height
    uvec2 tiles;      // tile columns and rows
};

#include "blend.glsl"
#include "staging.glsl"

layout(constant_id = 4) const uint TRAINING = 0;

// Splats whose code is unrolled; a divisor of SUBGROUP_SIZE.
layout(constant_id = 5) const uint SPLATS_UNROLLED = 8;

struct Pixel {
    vec3 color;  // sum of w c
    float depth; // sum of w z; unused in training
    float t;     // transmittance T = 1 - sum of w while the pixel is live, -T once the stop rule has fired
};

// Blends a splat into this lane's pixels, the first of which is at `center`.
void blend(Splat splat, vec2 center, inout Pixel pixels[PIXELS_PER_LANE]) {
    vec2 delta = center - splat.a.xy;
    float opacity = splat.b.y;
    vec3 color = vec3(splat.b.zw, splat.c.x);
    float depth = splat.c.y;
    vec3 conic = conic_for_exp2(splat);
    [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) {
        float q = exponent(conic, delta + vec2(pixel_step(p)));
        float alpha = alpha_where_hit(q, opacity);
        // Of a pixel that has ended it is not positive. A splat that would bring T below the limit ends the pixel and is not blended.
        float t_next = pixels[p].t * (1.0 - alpha);
        bool live = t_next >= T_STOP;
        float weight = mix(0.0, alpha * pixels[p].t, live);
        pixels[p].t = mix(-abs(pixels[p].t), t_next, live);
        pixels[p].color += weight * color;
        if (TRAINING == 0) pixels[p].depth += weight * depth;
    }
}

void main() {
    uint training = TRAINING;
    Block block = block_of_subgroup();
    uint tile = block.tile;
    if (tile >= tiles.x * tiles.y) return;
    uint lane = gl_SubgroupInvocationID;
    uvec2 origin = block_origin(block, tiles.x);
    uvec2 corner = origin + lane_in_block();
    uvec2 range = tile_ranges[tile];
    bool first_slab = counters[COUNTER_SLAB_BEGIN] == 0 && counters[COUNTER_LAYER] == 0;
    bool last_slab = counters[COUNTER_SLAB_END] == counters[COUNTER_VISIBLE] && counters[COUNTER_LAYER] == counters[COUNTER_LAST_LAYER];
    // Nothing changes where nothing is blended.
    if (range.x >= range.y && !first_slab && !last_slab) return;

    Pixel pixels[PIXELS_PER_LANE];
    [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) {
        pixels[p] = Pixel(vec3(0.0), 0.0, 1.0);
        uvec2 at = corner + pixel_step(p);
        if (!first_slab) {
            // Lanes outside the image load pixels of its border, which they never write.
            uint i = min(at.y, size_px.y - 1) * size_px.x + min(at.x, size_px.x - 1);
            pixels[p] = Pixel(colors[i].rgb, depths[i].x, colors[i].a);
        }
    }

    vec2 center = vec2(corner) + 0.5;
    for (uint base = range.x; base < range.y; base += SUBGROUP_SIZE) {
        uint i = min(base + lane, range.y - 1);
        uint slot = isect_values[i];
        if (training != 0) slot = slot_from_emission[slot];
        Splat stored = splats[slot];
        Splat mine = with_conic_for_exp2(stored);
        // Past the end of the list: opacity 0 blends nothing.
        bool in_list = base + lane < range.y;
        mine.b.y = mix(0.0, mine.b.y, in_list);
        uint stage_splats = STAGE_SPLATS;
        uint unrolled = SPLATS_UNROLLED;
        if (stage_splats != 0) {
            // Of a larger tile's splats, those that reach this block.
            bool wanted = all(bvec2(in_list, BLOCKS_PER_TILE == 1 || reaches_block(stored, origin)));
            mine.b.y = mix(0.0, mine.b.y, wanted);
            uint count = stage(mine, wanted);
            [[dont_unroll]] for (uint first = 0; first < count; first += SPLATS_UNROLLED) {
                [[unroll]] for (uint k = 0; k < SPLATS_UNROLLED; ++k) blend(staged_splat(first + k), center, pixels);
            }
        } else if (unrolled == SUBGROUP_SIZE) {
            // Shuffles are constant, and the loop's masks are applied once per SUBGROUP_SIZE splats.
            [[unroll]] for (uint j = 0; j < SUBGROUP_SIZE; ++j) blend(splat_of_lane(mine, j), center, pixels);
        } else {
            [[dont_unroll]] for (uint first = 0; first < SUBGROUP_SIZE; first += SPLATS_UNROLLED) {
                [[unroll]] for (uint k = 0; k < SPLATS_UNROLLED; ++k) blend(splat_of_lane(mine, first + k), center, pixels);
            }
        }
        float live = 0.0;
        [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) live = max(live, pixels[p].t);
        if (!subgroupAny(live > 0.0)) break;
    }

    [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) {
        uvec2 at = corner + pixel_step(p);
        Pixel pixel = pixels[p];
        float alpha_or_t = pixel.t;
        if (last_slab) {
            float alpha = 1.0 - abs(pixel.t);
            pixel.color += abs(pixel.t) * background;
            pixel.depth = alpha > 0.0 ? pixel.depth / alpha : 0.0;
            alpha_or_t = alpha;
        }
        if (all(lessThan(at, size_px))) {
            uint i = at.y * size_px.x + at.x;
            colors[i] = vec4(pixel.color, alpha_or_t);
            depths[i] = vec2(pixel.depth, max(pixel.t, 0.0));
        }
    }
}
