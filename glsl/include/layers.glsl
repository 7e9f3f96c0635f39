// Depth layers: a frame is drawn front to back in parts, and what lies behind tiles that the layers before have closed is
// neither expanded nor listed. A tile is closed if the stop rule of the blend has ended all of its pixels: no splat behind
// changes a bit of them. The including file declares the buffers `counters` and `closed_runs` (by tile: closed tiles from this one
// to the right, in its row).
layout(constant_id = 12) const uint LAYERED = 0;  // 1 = the frame is drawn in layers

// True if splats at this depth belong to the layer. Depths are above 0, so their bits have their order.
bool in_layer(float depth, uint layer) {
    uint bits = floatBitsToUint(depth);
    return bits >= counters[COUNTER_LAYER_BEGIN + layer] && bits < counters[COUNTER_LAYER_BEGIN + layer + 1];
}

// Number of open tiles in the columns [x, y) of a row.
uint open_tiles(uvec2 tile_columns, uint row, uint columns) {
    uint open = 0;
    uint column = tile_columns.x;
    while (column < tile_columns.y) {
        uint closed = closed_runs[row * columns + column];
        open += closed == 0 ? 1 : 0;
        column += max(closed, 1);
    }
    return open;
}
