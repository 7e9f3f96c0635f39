// How subgroups and lanes share the pixels of a tile, and the rules of blending; forward and backward use the same.
//
// Between shuffles nothing may branch by lane: Vulkan does not promise that lanes come together again behind a branch, and
// a shuffle from a lane that has not is undefined. So conditions are joined by all(bvec), which evaluates both, not by &&,
// and values are chosen by mix, not by ?:. Branches are left around stores only: without them a lane would need a place to
// write what it does not have.

layout(constant_id = 3) const uint COLUMNS_PER_LANE = 1;  // 2 at subgroup size 4, where a row of 8 has more pixels than lanes

const uint BLOCK_SIDE = 8;  // one subgroup owns a block of this many pixels squared
const uint BLOCKS_PER_SIDE = TILE_SIZE / BLOCK_SIDE;
const uint BLOCKS_PER_TILE = BLOCKS_PER_SIDE * BLOCKS_PER_SIDE;
const uint PIXELS_PER_LANE = BLOCK_SIDE * BLOCK_SIDE / SUBGROUP_SIZE;
const uint LANES_PER_ROW = BLOCK_SIDE / COLUMNS_PER_LANE;
const uint ROW_STEP = SUBGROUP_SIZE / LANES_PER_ROW;  // rows between a lane's pixels
const float LOG2_E = 1.4426950408889634;
const float ALPHA_MIN = 1.0 / 255.0;
const float ALPHA_MAX = 0.99;
const float T_STOP = 1e-4;

struct Block {
    uint tile;      // tile of the image, row major
    uint in_tile;   // block of the tile, row major
};

// The block of this subgroup; its tile may lie past the end.
Block block_of_subgroup() {
    uint unit = group_index() * (WORKGROUP_SIZE / SUBGROUP_SIZE) + gl_SubgroupID;
    return Block(unit / BLOCKS_PER_TILE, unit % BLOCKS_PER_TILE);
}

// The first pixel of a block.
uvec2 block_origin(Block block, uint columns) {
    uvec2 origin = uvec2(block.tile % columns, block.tile / columns) * TILE_SIZE;
    return origin + uvec2(block.in_tile % BLOCKS_PER_SIDE, block.in_tile / BLOCKS_PER_SIDE) * BLOCK_SIDE;
}

// This lane's first pixel, from the first of its block.
uvec2 lane_in_block() {
    uint lane = gl_SubgroupInvocationID;
    return uvec2((lane % LANES_PER_ROW) * COLUMNS_PER_LANE, lane / LANES_PER_ROW);
}

// The first pixel of this lane.
uvec2 block_corner(Block block, uint columns) {
    return block_origin(block, columns) + lane_in_block();
}

// Offset from a lane's first pixel to its pixel `p`.
uvec2 pixel_step(uint p) {
    return uvec2(p % COLUMNS_PER_LANE, (p / COLUMNS_PER_LANE) * ROW_STEP);
}

// A splat as the blends want it: conic times -log2(e) / 2, so that alpha = opacity exp2(q).
Splat with_conic_for_exp2(Splat splat) {
    splat.a.zw *= vec2(-0.5 * LOG2_E, -LOG2_E);
    splat.b.x *= -0.5 * LOG2_E;
    return splat;
}

// Conic of a splat of `with_conic_for_exp2`: xx, xy, yy.
vec3 conic_for_exp2(Splat splat) {
    return vec3(splat.a.zw, splat.b.x);
}

// log2 of alpha / opacity at `d` pixels from a splat's mean, with its conic for exp2. A lane's pixels lie in one column (in two at four
// lanes), and what depends on d.x alone is the same in all of them: two products and two sums a pixel are left.
float exponent(vec3 conic, vec2 d) {
    return conic.x * d.x * d.x + d.y * (conic.y * d.x + conic.z * d.y);
}

// Alpha of a splat at a pixel with this exponent; 0 where it is skipped, which leaves a live T (it is never below T_STOP) as it is.
float alpha_where_hit(float q, float opacity) {
    float alpha = min(ALPHA_MAX, opacity * exp2(q));
    return mix(0.0, alpha, all(bvec2(alpha >= ALPHA_MIN, q <= 0.0)));
}

// False if a splat (as it is stored) has alpha < 1/255 in all pixels of the 8x8 block whose first pixel is `origin`: if the
// least x conic x over the block is above 2 log(255 opacity). The least is on one of the two sides that face the mean. The
// margins are far above the rounding of this and of the blend's own arithmetic, so leaving the splat out changes no bit.
bool reaches_block(Splat splat, uvec2 origin) {
    vec2 low = vec2(origin) + 0.5 - splat.a.xy;
    vec2 high = low + float(BLOCK_SIDE - 1);
    vec2 near = clamp(vec2(0.0), low, high);
    float xx = splat.a.z, xy = splat.a.w, yy = splat.b.x;
    vec2 on_column = vec2(near.x, clamp(-xy * near.x / yy, low.y, high.y));
    vec2 on_row = vec2(clamp(-xy * near.y / xx, low.x, high.x), near.y);
    vec3 column = vec3(xx * on_column.x * on_column.x, 2.0 * xy * on_column.x * on_column.y, yy * on_column.y * on_column.y);
    vec3 row = vec3(xx * on_row.x * on_row.x, 2.0 * xy * on_row.x * on_row.y, yy * on_row.y * on_row.y);
    float least_column = column.x + column.y + column.z - 1e-5 * (column.x + abs(column.y) + column.z);
    float least_row = row.x + row.y + row.z - 1e-5 * (row.x + abs(row.y) + row.z);
    float limit = 2.0 * log(255.0 * splat.b.y) + 1e-3;
    // NaN reaches everything.
    return !(min(least_column, least_row) > limit);
}
