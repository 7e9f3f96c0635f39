// A projected Gaussian, and the tiles it touches. Counting and emitting use the same function on the same stored bits.

struct Splat {
    vec4 a;  // mean x, mean y (pixels), conic xx, conic xy (1/px^2)
    vec4 b;  // conic yy, opacity, red, green
    vec2 c;  // blue, view depth
};

struct Footprint {
    vec2 mean_px;      // centre in pixels
    vec2 half_px;      // half extents of the bounding box of alpha >= 1/255 (slightly enlarged)
    float slope;       // cov_xy / cov_yy: the chord at dy is centred at slope * dy
    float chord_px;    // half length of the chord at dy = 0
    float extreme_dy;  // dy at which the ellipse reaches its rightmost point
    uint local;        // index of the Gaussian in its template
};

// The emissions of a splat, which are its tiles in ascending order.
struct EmissionRange {
    uint first;  // emission index
    uint end;    // one past the last
};

layout(constant_id = 2) const uint TILE_SIZE = 8;

// Tile rows [x, y) that the bounding box reaches, of `rows` in the image.
uvec2 tile_rows(Footprint f, uint rows) {
    precise float size = float(TILE_SIZE);
    precise float low = ceil((f.mean_px.y - f.half_px.y + 0.5) / size - 1.0);
    precise float high = floor((f.mean_px.y + f.half_px.y - 0.5) / size) + 1.0;
    float limit = float(rows);
    return uvec2(uint(clamp(low, 0.0, limit)), uint(clamp(high, 0.0, limit)));
}

// Tile columns [x, y) whose rectangle of pixel centres the ellipse meets within tile row `row`; empty ranges have x >= y.
uvec2 tile_columns(Footprint f, uint row, uint columns) {
    precise float size = float(TILE_SIZE);
    precise float top = float(row) * size + 0.5 - f.mean_px.y;
    precise float dy_min = max(top, -f.half_px.y);
    precise float dy_max = min(top + size - 1.0, f.half_px.y);
    precise float dy_right = clamp(f.extreme_dy, dy_min, dy_max);
    precise float dy_left = clamp(-f.extreme_dy, dy_min, dy_max);
    precise float t_right = dy_right / f.half_px.y;
    precise float t_left = dy_left / f.half_px.y;
    precise float right = f.mean_px.x + f.slope * dy_right + f.chord_px * sqrt(max(1.0 - t_right * t_right, 0.0));
    precise float left = f.mean_px.x + f.slope * dy_left - f.chord_px * sqrt(max(1.0 - t_left * t_left, 0.0));
    precise float low = ceil((left + 0.5) / size - 1.0);
    precise float high = floor((right - 0.5) / size) + 1.0;
    float limit = float(columns);
    uvec2 range = uvec2(uint(clamp(low, 0.0, limit)), uint(clamp(high, 0.0, limit)));
    return dy_min <= dy_max ? range : uvec2(0);
}
