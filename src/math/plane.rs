//! Planes, and the plane through three of many points that most points are near (RANSAC).

use glam::DVec3;

use super::rng::Rng;

/// The plane `normal . x = offset`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Plane {
    /// Unit normal of the plane.
    pub normal: DVec3,
    /// Distance of the plane from the origin along the normal, units of length.
    pub offset: f64,
}

impl Plane {
    /// Signed distance of a point from the plane, positive on the side of the normal.
    pub fn height(&self, point: DVec3) -> f64 {
        self.normal.dot(point) - self.offset
    }

    /// Number of points whose distance from the plane is below `reach`.
    pub fn count_near(&self, points: &[DVec3], reach: f64) -> usize {
        points.iter().filter(|&&p| self.height(p).abs() < reach).count()
    }
}

/// Options of a RANSAC search for a plane: each draw is a plane through three random points.
#[derive(Clone, Copy, Debug)]
pub struct PlaneDraws {
    /// Number of random draws.
    pub draws: usize,
    /// The direction that normals are oriented to, a unit vector.
    pub up: DVec3,
    /// Least cosine of the angle between a normal and `up`, above 0: steeper planes are rejected.
    pub level: f64,
    /// Points nearer to a plane than this are its inliers, units of length.
    pub reach: f64,
}

impl PlaneDraws {
    /// The plane with most inliers and their number; of equally good planes, the first drawn. `None` for fewer than
    /// three points, or if no draw was level enough. The same points and generator give the same plane.
    pub fn best(&self, points: &[DVec3], mut rng: Rng) -> Option<(Plane, usize)> {
        if points.len() < 3 {
            return None;
        }
        let mut best: Option<(Plane, usize)> = None;
        for _ in 0..self.draws {
            let [a, b, c] = std::array::from_fn(|_| points[rng.index(points.len())]);
            let Some(across) = (b - a).cross(c - a).try_normalize() else { continue };
            let normal = across * across.dot(self.up).signum();
            if normal.dot(self.up) < self.level {
                continue;
            }
            let plane = Plane { normal, offset: normal.dot(a) };
            let count = plane.count_near(points, self.reach);
            if best.is_none_or(|(_, most)| count > most) {
                best = Some((plane, count));
            }
        }
        best
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A level floor, a wall with more points, and scattered points: only the floor is level.
    #[test]
    fn the_fullest_level_plane_is_found() {
        let mut rng = Rng::new(1);
        let mut point = |low: DVec3, high: DVec3| {
            let part = DVec3::new(rng.uniform(), rng.uniform(), rng.uniform());
            low + part * (high - low)
        };
        let mut points: Vec<DVec3> = Vec::new();
        points.extend((0..300).map(|_| point(DVec3::new(-1.0, -1.0, 0.5), DVec3::new(1.0, 1.0, 0.5))));
        points.extend((0..500).map(|_| point(DVec3::new(1.0, -1.0, -1.0), DVec3::new(1.0, 1.0, 1.0))));
        points.extend((0..200).map(|_| point(DVec3::NEG_ONE, DVec3::ONE)));
        let draws = PlaneDraws { draws: 400, up: DVec3::NEG_Z, level: 0.9, reach: 0.01 };
        let (plane, count) = draws.best(&points, Rng::new(2)).unwrap();
        assert!(plane.normal.dot(DVec3::NEG_Z) > 0.999 && plane.height(DVec3::Z * 0.5).abs() < 0.01, "{plane:?}");
        assert!(plane.height(DVec3::ZERO) > 0.4, "the normal points up");
        assert!((300..320).contains(&count) && count == plane.count_near(&points, 0.01), "{count}");
        assert_eq!(draws.best(&points, Rng::new(2)), Some((plane, count)), "another plane of the same draws");
        let steep = PlaneDraws { up: DVec3::X, ..draws };
        let (wall, count) = steep.best(&points, Rng::new(2)).unwrap();
        assert!(wall.height(DVec3::X).abs() < 0.01 && count >= 500, "{wall:?} {count}");
    }

    #[test]
    fn too_few_points_and_points_in_one_place_have_no_plane() {
        let draws = PlaneDraws { draws: 50, up: DVec3::Z, level: 0.9, reach: 0.1 };
        for points in [vec![], vec![DVec3::ZERO; 2], vec![DVec3::ONE; 9]] {
            assert_eq!(draws.best(&points, Rng::new(0)), None);
        }
        let on_a_wall = [DVec3::ZERO, DVec3::Y, DVec3::Z];
        assert_eq!(draws.best(&on_a_wall, Rng::new(0)), None);
    }
}
