//! Points sorted along a Morton curve, the depth-first order of an octree: neighbours in the order are close in space.

use rayon::prelude::*;

/// Bits of a Morton code per axis: three axes fill 63 of 64 bits.
const MORTON_BITS: u32 = 21;

/// Point indices along a Morton curve. The curve's box leaves out the outermost percent of points on each side of each
/// axis; points outside are clamped to its faces, so that a few outliers do not coarsen the curve. Coordinates that are not
/// finite do not count for the box; NaN is taken for its lower face.
pub fn morton_order(means: &[[f32; 3]]) -> Vec<u32> {
    let bounds: [(f64, f64); 3] = std::array::from_fn(|axis| {
        let mut values: Vec<f32> = means.iter().map(|m| m[axis]).filter(|v| v.is_finite()).collect();
        values.sort_unstable_by(f32::total_cmp);
        let at = |rank: usize| values.get(rank).map_or(0.0, |&v| f64::from(v));
        (at(values.len() / 100), at(values.len() - values.len().min(1 + values.len() / 100)))
    });
    // One cell size for all axes, so that cells are cubes.
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

/// The low 21 bits of `value`, each followed by two zero bits.
fn spread_bits(value: u64) -> u64 {
    (0..MORTON_BITS).fold(0, |out, bit| out | (value >> bit & 1) << (3 * bit))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coordinates_that_are_not_finite_keep_their_points_and_the_order_of_the_others() {
        let line: Vec<[f32; 3]> = (0..50).map(|k| [(49 - k) as f32, 0.0, 0.0]).collect();
        let of_line: Vec<u32> = (0..50).rev().collect();
        assert_eq!(morton_order(&line), of_line);
        for poison in [f32::NAN, -f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            let mut means = line.clone();
            means.extend([[poison; 3]; 3]);
            let order = morton_order(&means);
            let finite: Vec<u32> = order.iter().copied().filter(|&i| i < 50).collect();
            assert_eq!((order.len(), finite), (53, of_line.clone()), "{poison}");
            assert_eq!(morton_order(&[[poison; 3]; 2]), [0, 1]);
        }
        assert!(morton_order(&[]).is_empty());
    }
}
