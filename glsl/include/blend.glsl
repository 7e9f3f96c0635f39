// How subgroups and lanes share the pixels of a tile, and the rules of blending; forward and backward use the same.
//
// Between shuffles nothing may branch by lane: Vulkan does not promise that lanes come together again behind a branch, and
// a shuffle from a lane that has not is undefined. So conditions are joined by all(bvec), which evaluates both, not by &&,
// and values are chosen by mix, not by ?:.

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

// The first pixel of this lane.
uvec2 block_corner(Block block, uint columns) {
    uvec2 origin = uvec2(block.tile % columns, block.tile / columns) * TILE_SIZE;
    origin += uvec2(block.in_tile % BLOCKS_PER_SIDE, block.in_tile / BLOCKS_PER_SIDE) * BLOCK_SIDE;
    uint lane = gl_SubgroupInvocationID;
    return origin + uvec2((lane % LANES_PER_ROW) * COLUMNS_PER_LANE, lane / LANES_PER_ROW);
}

// Offset from a lane's first pixel to its pixel `p`.
uvec2 pixel_step(uint p) {
    return uvec2(p % COLUMNS_PER_LANE, (p / COLUMNS_PER_LANE) * ROW_STEP);
}
