//! A cloud of coloured points, as structure from motion produces it.

use glam::DVec3;

/// N points in one frame. Both arrays have N entries.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud {
    /// Positions in the world frame, scene units.
    pub positions: Vec<[f32; 3]>,
    /// Red, green and blue in the encoding of the images (sRGB).
    pub colors: Vec<[u8; 3]>,
}

impl PointCloud {
    /// The number N of points.
    pub fn len(&self) -> usize {
        self.positions.len()
    }

    /// True if there are no points.
    pub fn is_empty(&self) -> bool {
        self.positions.is_empty()
    }

    /// The median of the positions, per axis: a centre that is robust against outliers. `None` without points.
    pub fn median(&self) -> Option<DVec3> {
        let axis = |k: usize| {
            let mut values: Vec<f32> = self.positions.iter().map(|p| p[k]).collect();
            let middle = values.len() / 2;
            (!values.is_empty()).then(|| f64::from(*values.select_nth_unstable_by(middle, f32::total_cmp).1))
        };
        Some(DVec3::new(axis(0)?, axis(1)?, axis(2)?))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_median_of_each_axis() {
        let positions = vec![[1.0, 5.0, -1.0], [2.0, 4.0, 1e9], [3.0, 3.0, 0.0]];
        let cloud = PointCloud { colors: vec![[0; 3]; 3], positions };
        assert_eq!((cloud.median(), cloud.len()), (Some(DVec3::new(2.0, 4.0, 0.0)), 3));
        assert!(PointCloud::default().median().is_none() && PointCloud::default().is_empty());
    }
}
