//! Colour agreement of aligned surfaces.

use glam::DVec3;

use super::icp::INLIER_VOXELS;
use super::pose::Pose;
use super::sample::{BASE, FINE, ObjectSurface};

/// Standard deviation of colours, of the range 0..1, below which differences are noise.
const COLOR_NOISE: f64 = 0.02;

/// Part of the target's colour variation (root of the variance) that the reference's colours, with a gain >= 0 and a
/// bias per channel, do not explain; 0..=1. Since liveries differ, a low value is evidence for a pose, and a high one
/// is no evidence against it.
pub(super) fn unexplained_color(reference: &ObjectSurface, target: &ObjectSurface, pose: &Pose) -> f64 {
    let (fine, base) = (&reference.levels[FINE], &target.levels[BASE]);
    let mut pairs: Vec<(DVec3, DVec3)> = Vec::new();
    for (position, color) in base.positions.iter().zip(&base.colors) {
        if let Some((j, distance)) = fine.nearest(pose.apply_inverse(*position))
            && distance * pose.scale <= INLIER_VOXELS * base.voxel
        {
            pairs.push((fine.colors[j], *color));
        }
    }
    residual(&pairs)
}

/// Unexplained part over all channels, for pairs (reference colour, target colour).
fn residual(pairs: &[(DVec3, DVec3)]) -> f64 {
    let count = pairs.len().max(1) as f64;
    let sums = pairs.iter().fold((DVec3::ZERO, DVec3::ZERO), |(a, b), (x, y)| (a + *x, b + *y));
    let (x_mean, y_mean) = (sums.0 / count, sums.1 / count);
    let (mut xx, mut xy, mut yy) = (DVec3::ZERO, DVec3::ZERO, DVec3::ZERO);
    for (x, y) in pairs {
        let (x, y) = (*x - x_mean, *y - y_mean);
        (xx, xy, yy) = (xx + x * x, xy + x * y, yy + y * y);
    }
    let noise = DVec3::splat(COLOR_NOISE * COLOR_NOISE * count);
    let explained = xy.max(DVec3::ZERO).powf(2.0) / (xx + noise);
    let all = (yy + noise).element_sum();
    ((all - explained.element_sum()).max(0.0) / all).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;

    #[test]
    fn gains_and_biases_are_explained_and_inverted_or_other_colours_are_not() {
        let mut rng = Rng::new(1);
        let colors: Vec<DVec3> = (0..300).map(|_| 0.5 + 0.2 * rng.normal_vector()).collect();
        let of = |map: &dyn Fn(DVec3) -> DVec3| residual(&colors.iter().map(|&c| (c, map(c))).collect::<Vec<_>>());
        assert!(of(&|c| DVec3::new(0.3, 2.0, 1.0) * c + DVec3::new(0.4, -0.2, 0.0)) < 0.2);
        assert!(of(&|c| 1.0 - c) > 0.99);
        assert!(of(&|c| DVec3::new(c.y, c.z, c.x)) > 0.9);
        assert!(residual(&[]) == 1.0 && of(&|_| DVec3::splat(0.3)) == 1.0);
    }
}
