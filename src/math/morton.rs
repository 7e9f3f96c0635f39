//! Points in the order of a Morton curve, the depth-first order of an octree: neighbours in it are neighbours in space.

use rayon::prelude::*;

/// Bits of a Morton code per axis: 64 in all, less one.
const MORTON_BITS: u32 = 21;

/// Point indices along a Morton curve through the box that holds all but the outermost percent on each side of each
/// axis; what is outside counts as on its faces, so that a few stray points do not coarsen the curve.
pub fn morton_order(means: &[[f32; 3]]) -> Vec<u32> {
    let bounds: [(f64, f64); 3] = std::array::from_fn(|axis| {
        let mut values: Vec<f32> = means.iter().map(|m| m[axis]).collect();
        values.sort_unstable_by(f32::total_cmp);
        let at = |rank: usize| values.get(rank).map_or(0.0, |&v| f64::from(v));
        (at(values.len() / 100), at(values.len() - values.len().min(1 + values.len() / 100)))
    });
    // One cell size for all axes: cells are cubes.
    let side = bounds.iter().fold(f64::MIN_POSITIVE, |m, (low, high)| m.max(high - low));
    let cells = f64::from((1u32 << MORTON_BITS) - 1);
    let code = |mean: [f32; 3]| {
        (0..3).fold(0, |code, axis| {
            let (low, high) = bounds[axis];
            let along = (f64::from(mean[axis]).clamp(low, high) - low) / side;
            code | spread_bits((along * cells) as u64) << axis
        })
    };
    let mut order: Vec<(u64, u32)> = means.par_iter().enumerate().map(|(i, &m)| (code(m), i as u32)).collect();
    order.par_sort_unstable();
    order.into_iter().map(|(_, i)| i).collect()
}

/// The low 21 bits, each followed by two zeros.
fn spread_bits(value: u64) -> u64 {
    (0..MORTON_BITS).fold(0, |out, bit| out | (value >> bit & 1) << (3 * bit))
}
