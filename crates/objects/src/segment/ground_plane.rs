//! The plane that objects stand on.

use glam::{DMat3, DVec3};

use instgs_vk::math::plane::{Plane, PlaneDraws};
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::widened;

/// Points used at most: more do not improve the plane.
const MOST_POINTS: usize = 20_000;
/// Planes drawn at random. If a fifth of the points belong to the ground, about 16 draws (a fifth cubed) lie in it.
const DRAWS: usize = 2000;
/// A ground is at most 20 degrees from level (the cosine). The cameras give the up direction.
const LEVEL: f64 = 0.94;
/// Of two level planes the lower one is the ground if it has at least this part of the other's points: tables and
/// ceilings can have more than the floor.
const LOWER_PART: f64 = 0.5;
/// A plane with fewer than this part of all points is no ground: trained scenes have 0.2 to 0.5 of their points there.
const LEAST_PART: f64 = 0.1;
/// Rounds of least squares; two or three suffice.
const ROUNDS: usize = 5;

/// The lowest level plane that enough finite world points are near, within `reach` > 0 world units. `up` is a unit
/// vector, and the normal is one that points up. `None` if there is no such plane. The result is deterministic.
pub(super) fn ground_plane(positions: &[[f32; 3]], up: DVec3, reach: f64) -> Option<Plane> {
    let stride = positions.len().div_ceil(MOST_POINTS).max(1);
    let points: Vec<DVec3> = positions.iter().step_by(stride).map(|&p| widened(p)).collect();
    let (drawn, _) = PlaneDraws { draws: DRAWS, up, level: LEVEL, reach }.best(&points, Rng::new(0))?;
    // The draw from a small table is not level enough to compare its points with those of a lower plane.
    let best = fitted(&points, drawn, reach);
    let plane = fitted(&points, lowest_like(&points, best, reach), reach);
    (plane.count_near(&points, reach) as f64 >= LEAST_PART * points.len() as f64).then_some(plane)
}

/// The lowest plane with the normal of `best` that has enough points near it.
fn lowest_like(points: &[DVec3], best: Plane, reach: f64) -> Plane {
    let mut heights: Vec<f64> = points.iter().map(|&p| best.height(p)).collect();
    heights.sort_unstable_by(f64::total_cmp);
    let enough = LOWER_PART * best.count_near(points, reach) as f64;
    let near = |height: f64| {
        heights.partition_point(|&h| h < height + reach) - heights.partition_point(|&h| h <= height - reach)
    };
    let lowest = heights.iter().find(|&&height| near(height) as f64 >= enough);
    Plane { offset: best.offset + lowest.copied().unwrap_or(0.0), ..best }
}

/// Least squares of vertical distances, repeated over the points within `reach` of the last plane.
fn fitted(points: &[DVec3], start: Plane, reach: f64) -> Plane {
    let mut plane = start;
    for _ in 0..ROUNDS {
        let up = plane.normal;
        let (side, ahead) = up.any_orthonormal_pair();
        let near: Vec<DVec3> = points.iter().copied().filter(|&p| plane.height(p).abs() < reach).collect();
        let middle = near.iter().sum::<DVec3>() / near.len() as f64;
        let (mut matrix, mut right) = (DMat3::ZERO, DVec3::ZERO);
        for from_middle in near.iter().map(|p| *p - middle) {
            let row = DVec3::new(side.dot(from_middle), ahead.dot(from_middle), 1.0);
            matrix += DMat3::from_cols(row * row.x, row * row.y, row * row.z);
            right += row * up.dot(from_middle);
        }
        let slope = matrix.inverse() * right;
        let Some(normal) = (up - side * slope.x - ahead * slope.y).try_normalize() else { return plane };
        plane = Plane { normal, offset: normal.dot(middle + up * slope.z) };
    }
    plane
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A floor 5 degrees off level, a table with more points than the floor, and points everywhere else.
    #[test]
    fn the_floor_is_found_below_a_fuller_table() {
        let mut rng = Rng::new(3);
        let normal = DVec3::new(5f64.to_radians().sin(), 0.0, 5f64.to_radians().cos());
        let (side, ahead) = normal.any_orthonormal_pair();
        let mut points: Vec<[f32; 3]> = Vec::new();
        let mut layer = |count: usize, half: f64, height: f64, noise: f64| {
            for _ in 0..count {
                let [u, v] = [rng.range(-half, half), rng.range(-half, half)];
                let point = side * u + ahead * v + normal * (height + noise * rng.normal());
                points.push(point.as_vec3().to_array());
            }
        };
        layer(3000, 5.0, -1.0, 0.01);
        layer(4000, 1.0, 0.0, 0.01);
        layer(2000, 5.0, 0.0, 2.0);
        let ground = ground_plane(&points, DVec3::Z, 0.1).unwrap();
        assert!(ground.normal.dot(normal) > 0.5f64.to_radians().cos(), "{ground:?}");
        assert!(ground.height(-normal).abs() < 0.02, "{ground:?}");
        assert_eq!(ground_plane(&points, DVec3::Y, 0.1), None, "nothing is level to a wrong vertical");
    }

    #[test]
    fn few_points_and_points_in_one_place_have_no_ground() {
        for points in [vec![], vec![[0.0; 3]; 2], vec![[1.0; 3]; 50]] {
            assert_eq!(ground_plane(&points, DVec3::Z, 0.1), None);
        }
    }
}
