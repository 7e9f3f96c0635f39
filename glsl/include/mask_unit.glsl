// Common to the host and mask_contribution.

// The sum of 64 pixels fits 32 bits, and the least weight that is blended, T_STOP / 255, is 6.
const uint CONTRIBUTION_ONE = 16777216;  // weight 1 of one pixel in fixed-point sums of alpha T: 2^24

// The pixels of one 8x8 block that have one mask id.
struct MaskUnit {
    uint block;        // tile times blocks of a tile plus block in the tile
    uint id;           // mask id, 0 = no mask
    uint first_entry;  // index of its first contribution; one for each element of the tile's list follows
};
