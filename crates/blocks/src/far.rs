//! The points of a block: all of them in and near its cell, fewer and fewer farther away.

use std::collections::HashSet;

use glam::DVec3;

use crate::cell::Ground;

/// Grid cells from the middle of a block to its side, in the contracted space in which far points are thinned.
const STEPS: f64 = 64.0;

/// Where a block is, for thinning what lies around it.
pub(crate) struct Surroundings {
    ground: Ground,
    middle: [f64; 2],
    /// Half of the block's size by axis with its margin, scene units.
    half: [f64; 2],
}

impl Surroundings {
    /// Around a rectangle on the ground between two corners.
    pub(crate) fn new(ground: Ground, low: [f64; 2], high: [f64; 2]) -> Self {
        let of =
            |axis: usize| (0.5 * (low[axis] + high[axis]), (0.5 * (high[axis] - low[axis])).max(f64::MIN_POSITIVE));
        let [(x, half_x), (y, half_y)] = [of(0), of(1)];
        Self { ground, middle: [x, y], half: [half_x, half_y] }
    }

    /// The grid cell of a point in contracted space. Within the rectangle space is as it is, in units of half its size;
    /// beyond, a distance r becomes 2 - 1 / r (the contraction of Mip-NeRF 360, by the maximum norm). So grid cells grow with the
    /// square of the distance, and all of space is at most `4 * STEPS` of them wide.
    fn grid_cell(&self, point: DVec3) -> [i64; 3] {
        let [x, y] = self.ground.flat(point);
        let flat = [(x - self.middle[0]) / self.half[0], (y - self.middle[1]) / self.half[1]];
        let height = self.ground.height(point) / (0.5 * (self.half[0] + self.half[1]));
        let r = flat[0].abs().max(flat[1].abs());
        let scale = if r > 1.0 { (2.0 - 1.0 / r) / r } else { 1.0 };
        [flat[0], flat[1], height].map(|v| (v * scale * STEPS).floor() as i64)
    }

    /// The first point of every grid cell: indices into `points` out of `candidates`, in their order.
    pub(crate) fn thinned(&self, points: &[DVec3], candidates: impl Iterator<Item = usize>) -> Vec<usize> {
        let mut taken = HashSet::new();
        candidates.filter(|&i| taken.insert(self.grid_cell(points[i]))).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A row of points every centimetre to a hundred times the block's half size: as many are kept near the block as its grid
    /// has cells, and farther away fewer per metre.
    #[test]
    fn the_far_field_is_thinner_the_farther_it_is() {
        let ground = Ground { axes: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], up: [0.0, 0.0, 1.0] };
        let around = Surroundings::new(ground, [-1.0; 2], [1.0; 2]);
        let points: Vec<DVec3> = (0..10_000).map(|i| DVec3::new(0.01 * f64::from(i), 0.5, 0.25)).collect();
        let kept = around.thinned(&points, 0..points.len());
        let between = |from: f64, to: f64| kept.iter().filter(|&&i| (from..to).contains(&points[i].x)).count();
        // Beyond 1, y and the height shrink too, which adds a few cells.
        let counts = [between(0.0, 1.0), between(1.0, 2.0), between(2.0, 4.0), between(4.0, 100.0)];
        assert_eq!(counts[0], 64, "{counts:?}");
        assert!(counts[1] < 2 * 32 + 40 && counts[2] < counts[1] && counts[3] < 60 && counts[3] > 5, "{counts:?}");
        assert!(kept.windows(2).all(|pair| pair[0] < pair[1]));
    }
}
