#version 460
// Backward pass of the blend: replays each tile front to back and sums the contributions of its pixels to each splat.
//
// One subgroup owns an 8x8 block, as in `tile_blend`, and walks the same list by the same rules, by shuffles or, without
// `TRANSPOSE`, through shared memory. A pixel keeps T and
// the sum over the splats still to come of weight times value, where value = (colour, 1) . g with g the cotangent by
// rgb and by alpha minus background. With it dL/dalpha = T value - rest / (1 - alpha), without divisions of T.
//
// - Reads `splats` (40 bytes), `emission_from_isect` and `slot_from_emission` (8) per list entry; `colors` and
//   `cotangents` (32 bytes a pixel).
// - Writes `isect_moments`: 36 bytes per list entry and 8x8 block of its tile, at the emission index: entries of one
//   splat are adjacent there, and each has one writer. No atomics, so results are reproducible bit for bit. Entries
//   that no live pixel has reached get zeros.
// - Grid: one subgroup per 8x8 block.
// - Sums over lanes halve with each step: of two sums, lanes without the step's bit keep the first and get the partner's
//   share of it, the others the second. With `TRANSPOSE` the two are of two splats, `SUBGROUP_SIZE` splats are summed at
//   once, and at the end lane j holds splat j. Without, they are two of the nine sums of one splat, which takes 12 shuffles
//   at 32 lanes, and at the end lane k holds sum k. Either way a sum is added up in the same order.
//
// Twin: `instgs_reference::tile_blend_backward`. Test: `tests/kernels/backward.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "splat.glsl"
#include "blend.glsl"
#include "staging.glsl"
#include "gradients.glsl"

layout(scalar, binding = 0) readonly buffer Splats { Splat splats[]; };                            // projected splats by slot
layout(scalar, binding = 1) readonly buffer IsectEmissions { uint emission_from_isect[]; };        // emission indices, sorted by tile then depth
layout(scalar, binding = 2) readonly buffer EmissionSlots { uint slot_from_emission[]; };          // slot by emission index
layout(scalar, binding = 3) readonly buffer TileRanges { uvec2 tile_ranges[]; };                   // first and end intersection per tile
layout(scalar, binding = 4) readonly buffer Colors { vec4 colors[]; };                             // the picture: rgb over the background, and alpha
layout(scalar, binding = 5) readonly buffer Cotangents { vec4 cotangents[]; };                     // gradient of the loss by rgb and alpha
layout(scalar, binding = 6) writeonly buffer IsectMoments { SplatMoments isect_moments[]; };       // by emission index times blocks of a tile plus block
layout(scalar, push_constant) uniform TileBlendBackwardParams {
    vec3 background;  // colour behind everything
    uvec2 size_px;    // image width and height
    uvec2 tiles;      // tile columns and rows
};

// 1 = sums over lanes of SUBGROUP_SIZE splats at once, which takes the fewest shuffles; 0 = of each splat alone, since the
// registers of GPUs do not hold the sums of so many.
layout(constant_id = 4) const uint TRANSPOSE = 1;

// Splats whose code is unrolled without TRANSPOSE; a divisor of SUBGROUP_SIZE.
layout(constant_id = 5) const uint SPLATS_UNROLLED = 4;

struct Pixel {
    vec4 g;      // dL/drgb; dL/dalpha minus that of the background it hides
    float t;     // transmittance while the pixel is live, 0 once the stop rule has fired
    float rest;  // sum over the splats not yet visited of weight times (colour, 1) . g
};

float merged(float low, float high, uint mask) {
    bool upper = (gl_SubgroupInvocationID & mask) != 0;
    return mix(low, high, upper) + subgroupShuffle(mix(high, low, upper), gl_SubgroupInvocationID ^ mask);
}

// Both lanes that `mask` joins get the sum of their shares.
float complete(float share, uint mask) {
    return share + subgroupShuffle(share, gl_SubgroupInvocationID ^ mask);
}

vec3 merged(vec3 low, vec3 high, uint mask) {
    return vec3(merged(low.x, high.x, mask), merged(low.y, high.y, mask), merged(low.z, high.z, mask));
}

// Lanes without `mask` keep and complete `low`, the other lanes `high`.
SplatMoments merged(SplatMoments low, SplatMoments high, uint mask) {
    return SplatMoments(vec3[](merged(low.sums[0], high.sums[0], mask), merged(low.sums[1], high.sums[1], mask),
                               merged(low.sums[2], high.sums[2], mask)));
}

// What this lane's pixels say about a splat, which is blended into them.
SplatMoments sums_of_splat(Splat splat, vec2 center, inout Pixel pixels[PIXELS_PER_LANE]) {
    vec2 delta = center - splat.a.xy;
    float opacity = splat.b.y;
    vec3 color = vec3(splat.b.zw, splat.c.x);
    vec3 conic = conic_for_exp2(splat);
    vec3 by_color = vec3(0.0);
    // Of each column of this lane's pixels: s, s d.y and s d.y^2, with s = dL/dalpha alpha.
    vec3 column_sums[COLUMNS_PER_LANE];
    [[unroll]] for (uint c = 0; c < COLUMNS_PER_LANE; ++c) column_sums[c] = vec3(0.0);
    [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) {
        vec2 d = delta + vec2(pixel_step(p));
        float q = exponent(conic, d);
        float alpha = alpha_where_hit(q, opacity);
        float t = pixels[p].t;
        float t_next = t * (1.0 - alpha);
        bool live = t_next >= T_STOP;
        float weight = mix(0.0, alpha * t, live);
        float value = dot(color, pixels[p].g.rgb) + pixels[p].g.a;
        float rest = pixels[p].rest - weight * value;
        // dL/dalpha; a clamped alpha has no gradient by opacity and shape.
        float by_alpha = t * value - rest / (1.0 - alpha);
        float s = mix(0.0, by_alpha * alpha, all(bvec2(live, opacity * exp2(q) <= ALPHA_MAX)));
        pixels[p].rest = rest;
        pixels[p].t = mix(0.0, t_next, live);
        float sy = s * d.y;
        by_color += weight * pixels[p].g.rgb;
        column_sums[p % COLUMNS_PER_LANE] += vec3(s, sy, sy * d.y);
    }
    // All pixels of a column have the same d.x.
    SplatMoments sum = SplatMoments(vec3[](by_color, vec3(0.0), vec3(0.0)));
    [[unroll]] for (uint c = 0; c < COLUMNS_PER_LANE; ++c) {
        float x = delta.x + float(c);
        float sx = column_sums[c].x * x;
        sum.sums[1] += vec3(column_sums[c].x, sx, column_sums[c].y);
        sum.sums[2] += vec3(sx * x, column_sums[c].y * x, column_sums[c].z);
    }
    return sum;
}

const uint SUMS = 9;  // of a splat

// Sums of one splat over lanes, scattered: lane l holds sum l + m SUBGROUP_SIZE in element m. Steps with literal bounds, which
// compilers unroll.
float[SUMS] scattered(SplatMoments sum) {
    uint size = SUBGROUP_SIZE;
    float v[SUMS];
    [[unroll]] for (uint k = 0; k < SUMS; ++k) v[k] = sum.sums[k / 3][k % 3];
    // The last of an odd number of sums has no other to be merged with: all lanes get it.
    [[unroll]] for (uint k = 0; k < 4; ++k) v[k] = merged(v[2 * k], v[2 * k + 1], 1);
    v[4] = complete(v[8], 1);
    [[unroll]] for (uint k = 0; k < 2; ++k) v[k] = merged(v[2 * k], v[2 * k + 1], 2);
    v[2] = complete(v[4], 2);
    if (size > 4) {
        v[0] = merged(v[0], v[1], 4);
        v[1] = complete(v[2], 4);
    }
    if (size > 8) v[0] = merged(v[0], v[1], 8);
    if (size > 16) v[0] = complete(v[0], 16);
    if (size > 32) v[0] = complete(v[0], 32);
    return v;
}

void store(uint at, float v[SUMS]) {
    [[unroll]] for (uint m = 0; m < 3; ++m) {
        uint sum = gl_SubgroupInvocationID + m * SUBGROUP_SIZE;
        if (sum < SUMS) isect_moments[at].sums[sum / 3][sum % 3] = v[m];
    }
}

void main() {
    uint transpose = TRANSPOSE;
    Block block = block_of_subgroup();
    if (block.tile >= tiles.x * tiles.y) return;
    uint lane = gl_SubgroupInvocationID;
    uvec2 corner = block_corner(block, tiles.x);
    uvec2 range = tile_ranges[block.tile];

    Pixel pixels[PIXELS_PER_LANE];
    [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) {
        uvec2 at = corner + pixel_step(p);
        bool inside = all(lessThan(at, size_px));
        uint i = min(at.y, size_px.y - 1) * size_px.x + min(at.x, size_px.x - 1);
        vec4 color = colors[i];
        vec4 g = mix(vec4(0.0), cotangents[i], bvec4(inside));
        g.a -= dot(background, g.rgb);
        float rest = dot(color.rgb - (1.0 - color.a) * background, g.rgb) + g.a * color.a;
        pixels[p] = Pixel(g, float(inside), rest);
    }

    vec2 center = vec2(corner) + 0.5;
    uint base = range.x;
    for (; base < range.y; base += SUBGROUP_SIZE) {
        uint i = min(base + lane, range.y - 1);
        uint emission = emission_from_isect[i];
        Splat mine = with_conic_for_exp2(splats[slot_from_emission[emission]]);
        mine.b.y = mix(0.0, mine.b.y, base + lane < range.y);
        uint stage_splats = STAGE_SPLATS;
        if (stage_splats != 0 && transpose == 0) stage(mine, true);
        if (transpose == 0) {
            // Partly unrolled: the code of all splats of a subgroup would not fit the instruction caches of GPUs.
            [[dont_unroll]] for (uint first = 0; first < SUBGROUP_SIZE; first += SPLATS_UNROLLED) {
                [[unroll]] for (uint k = 0; k < SPLATS_UNROLLED; ++k) {
                    uint j = first + k;
                    Splat splat = stage_splats != 0 ? staged_splat(j) : splat_of_lane(mine, j);
                    float v[SUMS] = scattered(sums_of_splat(splat, center, pixels));
                    uint of_splat = subgroupShuffle(emission, j);
                    if (base + j < range.y) store(of_splat * BLOCKS_PER_TILE + block.in_tile, v);
                }
            }
        } else {
            SplatMoments sums[64];
            [[unroll]] for (uint j = 0; j < SUBGROUP_SIZE; ++j) sums[j] = sums_of_splat(splat_of_lane(mine, j), center, pixels);
            // One loop per step with constant bounds: drivers do not unroll a loop whose step depends on an outer loop.
            uint size = SUBGROUP_SIZE;
            [[unroll]] for (uint j = 0; j < SUBGROUP_SIZE; j += 2) sums[j] = merged(sums[j], sums[j + 1], 1);
            [[unroll]] for (uint j = 0; j < SUBGROUP_SIZE; j += 4) sums[j] = merged(sums[j], sums[j + 2], 2);
            if (size > 4) {
                [[unroll]] for (uint j = 0; j < SUBGROUP_SIZE; j += 8) sums[j] = merged(sums[j], sums[j + 4], 4);
            }
            if (size > 8) {
                [[unroll]] for (uint j = 0; j < SUBGROUP_SIZE; j += 16) sums[j] = merged(sums[j], sums[j + 8], 8);
            }
            if (size > 16) {
                [[unroll]] for (uint j = 0; j < SUBGROUP_SIZE; j += 32) sums[j] = merged(sums[j], sums[j + 16], 16);
            }
            if (size > 32) sums[0] = merged(sums[0], sums[32], 32);
            if (base + lane < range.y) isect_moments[emission * BLOCKS_PER_TILE + block.in_tile] = sums[0];
        }
        float live = 0.0;
        [[unroll]] for (uint p = 0; p < PIXELS_PER_LANE; ++p) live = max(live, pixels[p].t);
        if (!subgroupAny(live > 0.0)) break;
    }
    // Entries that no live pixel has reached.
    for (uint i = base + SUBGROUP_SIZE + lane; i < range.y; i += SUBGROUP_SIZE) {
        isect_moments[emission_from_isect[i] * BLOCKS_PER_TILE + block.in_tile] = SplatMoments(vec3[](vec3(0.0), vec3(0.0), vec3(0.0)));
    }
}
