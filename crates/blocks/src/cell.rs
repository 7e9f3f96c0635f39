//! The ground, and the parts of it that blocks own.

use glam::DVec3;
use serde::{Deserialize, Serialize};

/// Two horizontal directions and the up axis: orthonormal, world frame.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Ground {
    /// Unit vectors of the world frame along the two coordinates on the ground, at right angles to each other and to `up`.
    pub axes: [[f64; 3]; 2],
    /// The ground's normal, upwards or towards the cameras: a unit vector of the data set's world frame.
    pub up: [f64; 3],
}

impl Ground {
    /// The ground perpendicular to `up` (a unit vector), its first axis along the largest extent of the points.
    pub fn of_points(up: DVec3, points: &[DVec3]) -> Self {
        let first = up.any_orthonormal_vector();
        let of_axis =
            |axis: DVec3| Self { axes: [axis, up.cross(axis)].map(|axis| axis.to_array()), up: up.to_array() };
        let plain = of_axis(first);
        let flat: Vec<[f64; 2]> = points.iter().map(|&p| plain.flat(p)).collect();
        let count = flat.len().max(1) as f64;
        let mean = flat.iter().fold([0.0; 2], |sum, p| [sum[0] + p[0], sum[1] + p[1]]).map(|sum| sum / count);
        let (mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0);
        for [x, y] in &flat {
            let (dx, dy) = (x - mean[0], y - mean[1]);
            (xx, xy, yy) = (xx + dx * dx, xy + dx * dy, yy + dy * dy);
        }
        // Direction of the larger eigenvalue of the 2x2 covariance.
        let angle = 0.5 * f64::atan2(2.0 * xy, xx - yy);
        of_axis(first * angle.cos() + up.cross(first) * angle.sin())
    }

    /// The two coordinates of a world point on the ground, scene units.
    pub fn flat(&self, point_world: DVec3) -> [f64; 2] {
        self.axes.map(|axis| DVec3::from(axis).dot(point_world))
    }

    /// The height of a world point, scene units.
    pub fn height(&self, point_world: DVec3) -> f64 {
        DVec3::from(self.up).dot(point_world)
    }
}

/// A rectangle on the ground; a side that borders on no other block is open. A point on a side between two blocks belongs to
/// the one above it, so that every point of the ground has one owner.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Cell {
    /// Least coordinate by axis; `None` if there is no bound.
    pub low: [Option<f64>; 2],
    /// Bound of the coordinates by axis, which does not belong to the cell; `None` if there is none.
    pub high: [Option<f64>; 2],
}

impl Cell {
    /// True if the cell owns a point of the ground.
    pub fn owns(&self, at: [f64; 2]) -> bool {
        (0..2).all(|axis| {
            self.low[axis].is_none_or(|low| at[axis] >= low) && self.high[axis].is_none_or(|high| at[axis] < high)
        })
    }

    /// How far a point lies within the cell, scene units: the distance to its nearest side, negative outside of it. Infinite
    /// if the cell is all of the ground.
    pub fn depth(&self, at: [f64; 2]) -> f64 {
        let of_axis = |axis: usize| {
            let from_low = self.low[axis].map_or(f64::INFINITY, |low| at[axis] - low);
            let from_high = self.high[axis].map_or(f64::INFINITY, |high| high - at[axis]);
            from_low.min(from_high)
        };
        of_axis(0).min(of_axis(1))
    }

    /// The cell with all bounded sides moved outwards, scene units by axis.
    pub fn grown(&self, margin: [f64; 2]) -> Self {
        let grown = |side: [Option<f64>; 2], sign: f64| {
            [0, 1].map(|axis: usize| side[axis].map(|bound| bound + sign * margin[axis]))
        };
        Self { low: grown(self.low, -1.0), high: grown(self.high, 1.0) }
    }

    /// The two parts of the cell below and above a coordinate along an axis.
    pub(crate) fn cut(self, axis: usize, at: f64) -> [Self; 2] {
        let (mut below, mut above) = (self, self);
        below.high[axis] = Some(at);
        above.low[axis] = Some(at);
        [below, above]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_point_has_one_owner() {
        let [left, right] = Cell::default().cut(0, 1.0);
        let [lower, upper] = right.cut(1, -2.0);
        let cells = [left, lower, upper];
        for at in [[1.0, -2.0], [0.999, 5.0], [1.0, -2.1], [9.0, 9.0], [-1e9, 0.0]] {
            assert_eq!(cells.iter().filter(|cell| cell.owns(at)).count(), 1, "{at:?}");
        }
        assert_eq!(upper.depth([3.0, -1.5]), 0.5);
        assert_eq!(upper.depth([0.5, 3.0]), -0.5);
        assert_eq!(Cell::default().depth([0.0, 0.0]), f64::INFINITY);
        assert!(!upper.owns([0.9, 0.0]) && upper.grown([0.2, 0.0]).owns([0.9, 0.0]));
    }

    /// Points along a slanted line: the first axis is that line, and the axes are orthonormal.
    #[test]
    fn the_first_axis_follows_the_points() {
        let along = DVec3::new(3.0, 4.0, 0.0) / 5.0;
        let points: Vec<DVec3> = (0..50).map(|i| along * f64::from(i) + DVec3::Z * f64::from(i % 3)).collect();
        let ground = Ground::of_points(DVec3::Z, &points);
        let [first, second] = ground.axes.map(DVec3::from);
        assert!(first.dot(along).abs() > 0.999_999);
        assert!(first.dot(second).abs() < 1e-12 && second.dot(DVec3::Z).abs() < 1e-12);
        assert_eq!(ground.height(DVec3::new(7.0, 8.0, 9.0)), 9.0);
    }
}
