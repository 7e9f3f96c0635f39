//! Twin of `layer_histogram`, `plan_layers`, `close_tiles` and `next_layer`: the depth layers of a frame, and what happens between
//! two of them.

use instgs_vk::gpu::interface::constants::*;

/// Counts by bin of depth of chunks whose nearest splats have these depths; what is not finite or behind the camera is near.
pub fn layer_bins(nearest: &[f32]) -> Vec<u32> {
    let mut bins = vec![0; LAYER_BINS as usize];
    for &depth in nearest {
        let depth = if depth.is_finite() { depth.max(0.0) } else { 0.0 };
        bins[(depth.to_bits() / LAYER_BIN_BITS) as usize] += 1;
    }
    bins
}

/// Bits of the depths at which the layers begin, and of the end of the last: each but the first has as many chunks as all before
/// it, rounded to whole bins.
pub fn layer_bounds(bins: &[u32]) -> Vec<u32> {
    let total: u32 = bins.iter().sum();
    let bound = |layer: u32| {
        let wanted = (total >> (LAYERS - layer)).max(1);
        let mut sum = 0;
        let reached = bins.iter().position(|count| {
            sum += count;
            sum >= wanted
        });
        reached.map_or(f32::INFINITY.to_bits(), |bin| (bin as u32 + 1) * LAYER_BIN_BITS)
    };
    [0].into_iter().chain((1..LAYERS).map(bound)).chain([f32::INFINITY.to_bits()]).collect()
}

/// By tile, row by row: how many tiles from this one to the right have no live pixel. `live` is the live transmittance by pixel.
pub fn closed_runs(live: &[f32], size_px: [u32; 2], tile_size: u32) -> Vec<u32> {
    let [width, height] = size_px;
    let tiles = size_px.map(|side| side.div_ceil(tile_size));
    let is_closed = |column: u32, row: u32| {
        let end = |tile: u32, side: u32| ((tile + 1) * tile_size).min(side);
        (row * tile_size..end(row, height))
            .all(|y| (column * tile_size..end(column, width)).all(|x| live[(y * width + x) as usize] == 0.0))
    };
    let run = |column: u32, row: u32| (column..tiles[0]).take_while(|&c| is_closed(c, row)).count() as u32;
    (0..tiles[1]).flat_map(|row| (0..tiles[0]).map(move |column| (column, row))).map(|(c, r)| run(c, r)).collect()
}

/// The counters (`COUNTER_*`) after a layer has been drawn into buffers for `capacities` candidates and work items.
pub fn next_layer(mut counters: Vec<u32>, capacities: [u32; 2]) -> Vec<u32> {
    let count = |slot: u32| counters[slot as usize];
    let fits = count(COUNTER_CANDIDATES_NEEDED) <= capacities[0]
        && count(COUNTER_WORK_ITEMS_NEEDED) <= capacities[1]
        && count(COUNTER_SLAB_END) >= count(COUNTER_VISIBLE);
    let needed = [COUNTER_WORK_ITEMS_NEEDED, COUNTER_VISIBLE, COUNTER_INTERSECTIONS].map(count);
    let log = (COUNTER_LAYER_LOG + LAYER_LOG_LENGTH * count(COUNTER_LAYER)) as usize;
    counters[log..][..needed.len()].copy_from_slice(&needed);
    counters[COUNTER_LAYER as usize] += 1;
    counters[COUNTER_INCOMPLETE as usize] |= u32::from(!fits);
    counters
}
