//! Evenly spread points on an object's surface, at several resolutions.

use glam::DVec3;

use super::cells::{Cells, Near};
use instgs_vk::math::nearest::PointSet;

/// A point drawn on a Gaussian.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Sample {
    /// Position in the local frame: world axes, origin at the object's centroid.
    pub position: DVec3,
    /// Normal towards the cameras; its length, 0..=1, is the flatness of the Gaussian.
    pub normal: DVec3,
    /// Base colour (SH band 0), rgb.
    pub color: DVec3,
}

/// Points about one voxel apart.
pub(super) struct Surface {
    /// Edge of a voxel, scene units.
    pub voxel: f64,
    /// Positions in the local frame.
    pub positions: Vec<DVec3>,
    /// Mean normals of the samples: shorter than 1 where these disagree or come from round Gaussians.
    pub normals: Vec<DVec3>,
    /// Base colours (SH band 0), rgb.
    pub colors: Vec<DVec3>,
    /// Search among `positions` from anywhere.
    pub set: PointSet,
    /// Search from places near the surface; `None` if the points are too scattered.
    cells: Option<Cells>,
}

impl Surface {
    /// One mean sample per occupied voxel, in order of voxels. Samples must be finite.
    pub(super) fn new(samples: &[Sample], voxel: f64) -> Self {
        let key = |p: DVec3| {
            let cell = (p / voxel).floor();
            (cell.x as i64, cell.y as i64, cell.z as i64)
        };
        let mut order: Vec<((i64, i64, i64), usize)> =
            samples.iter().enumerate().map(|(i, s)| (key(s.position), i)).collect();
        order.sort_unstable();
        let (mut positions, mut normals, mut colors) = (Vec::new(), Vec::new(), Vec::new());
        for cell in order.chunk_by(|a, b| a.0 == b.0) {
            let mean = |of: fn(&Sample) -> DVec3| {
                cell.iter().map(|&(_, i)| of(&samples[i])).sum::<DVec3>() / cell.len() as f64
            };
            positions.push(mean(|s| s.position));
            normals.push(mean(|s| s.normal));
            colors.push(mean(|s| s.color));
        }
        Self::of_points(voxel, positions, normals, colors)
    }

    /// A surface of given points with one normal and colour each.
    pub(super) fn of_points(voxel: f64, positions: Vec<DVec3>, normals: Vec<DVec3>, colors: Vec<DVec3>) -> Self {
        let places: Vec<[f32; 3]> = positions.iter().map(|p| p.as_vec3().to_array()).collect();
        let (set, cells) = (PointSet::new(&places), Cells::new(&places, voxel));
        Self { voxel, positions, normals, colors, set, cells }
    }

    /// Number of points in the surface.
    pub(super) fn len(&self) -> usize {
        self.positions.len()
    }

    /// The point nearest to `position` and its distance; `None` if there are no points.
    pub(super) fn nearest(&self, position: DVec3) -> Option<(usize, f64)> {
        match self.near(position.as_vec3().to_array(), f64::INFINITY) {
            Near::Place(near) => Some((near.neighbour.index as usize, near.neighbour.squared_distance.sqrt())),
            Near::Beyond(_) => None,
        }
    }

    /// The point nearest to a place, and how far all others are at least; `Beyond` if there are no points, and in most cases if none
    /// is within `reach`.
    fn near(&self, position: [f32; 3], reach: f64) -> Near {
        match self.cells.as_ref().map(|cells| cells.nearest_place(position)) {
            Some(Near::Beyond(least)) if least > reach => Near::Beyond(least),
            Some(Near::Place(near)) => Near::Place(near),
            _ => self.set.nearest_place(position).map_or(Near::Beyond(f64::INFINITY), Near::Place),
        }
    }

    /// The points as samples, for another resolution.
    pub(super) fn samples(&self) -> Vec<Sample> {
        let parts = self.positions.iter().zip(&self.normals).zip(&self.colors);
        parts.map(|((&position, &normal), &color)| Sample { position, normal, color }).collect()
    }
}

/// Nearest points for points that move a little at a time. While a point moves less than the margin to the second
/// nearest, the nearest stays the nearest, and no search is needed.
pub(super) struct Followed<'a> {
    surface: &'a Surface,
    /// By point: position of the last search and its result.
    found: Vec<Option<(DVec3, Near)>>,
}

impl<'a> Followed<'a> {
    /// For `count` moving points.
    pub(super) fn new(surface: &'a Surface, count: usize) -> Self {
        Self { surface, found: vec![None; count] }
    }

    /// [`Surface::nearest`] for the `i`-th point, which is now at `position`; `None` also if no point is within `reach`.
    /// Points beyond that may be given or not.
    pub(super) fn nearest(&mut self, i: usize, position: DVec3, reach: f64) -> Option<(usize, f64)> {
        let rounded = position.as_vec3();
        let place = rounded.as_dvec3();
        match self.found[i] {
            Some((then, Near::Place(near))) => {
                let index = near.neighbour.index as usize;
                let distance = self.surface.positions[index].as_vec3().as_dvec3().distance(place);
                if distance + then.distance(place) < near.others {
                    return Some((index, distance));
                }
            }
            Some((then, Near::Beyond(least))) if least - then.distance(place) > reach => return None,
            _ => (),
        }
        let near = self.surface.near(rounded.to_array(), reach);
        self.found[i] = Some((place, near));
        match near {
            Near::Place(near) => Some((near.neighbour.index as usize, near.neighbour.squared_distance.sqrt())),
            Near::Beyond(_) => None,
        }
    }
}

/// The largest distance of a point from the origin of the local frame; above 0.
pub(super) fn reach_of(surface: &Surface) -> f64 {
    surface.positions.iter().map(|p| p.length()).fold(f64::MIN_POSITIVE, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;

    #[test]
    fn a_voxel_holds_the_mean_of_its_samples() {
        let at = |x: f64, shade: f64| Sample {
            position: DVec3::new(x, 0.5, 0.5),
            normal: DVec3::Z,
            color: DVec3::splat(shade),
        };
        let surface = Surface::new(&[at(0.2, 1.0), at(-0.5, 7.0), at(0.6, 3.0)], 1.0);
        assert_eq!(surface.positions, [DVec3::new(-0.5, 0.5, 0.5), DVec3::new(0.4, 0.5, 0.5)]);
        assert_eq!(surface.colors, [DVec3::splat(7.0), DVec3::splat(2.0)]);
        assert_eq!(surface.nearest(DVec3::new(-2.5, 0.5, 0.5)), Some((0, 2.0)));
        assert!(Surface::new(&[], 1.0).nearest(DVec3::ZERO).is_none());
    }

    /// Random walks give the same results as a search each time.
    #[test]
    fn points_that_are_followed_have_the_nearest_of_a_search() {
        let mut rng = Rng::new(2);
        let draw = |rng: &mut Rng| Sample { position: rng.normal_vector(), normal: DVec3::Z, color: DVec3::ZERO };
        let surface = Surface::new(&(0..2000).map(|_| draw(&mut rng)).collect::<Vec<_>>(), 0.2);
        let mut places: Vec<DVec3> = (0..100).map(|_| 1.5 * rng.normal_vector()).collect();
        let mut followed = Followed::new(&surface, places.len());
        let (mut kept, mut changed, mut kept_away) = (0, 0, 0);
        for step in 0..40 {
            for (i, place) in places.iter_mut().enumerate() {
                *place += rng.normal_vector() * (0.1 * 0.8_f64.powi(step));
                let before = followed.found[i].map(|f| f.0);
                let reach = if i % 2 == 0 { f64::INFINITY } else { 0.3 };
                let near = followed.nearest(i, *place, reach);
                let want = surface.nearest(*place);
                assert!(near == want || near.is_none() && want.is_some_and(|want| want.1 > reach));
                let searched = followed.found[i].map(|f| f.0) != before;
                kept_away += usize::from(!searched && near.is_none());
                (kept, changed) = (kept + usize::from(!searched), changed + usize::from(searched));
            }
        }
        assert!(kept > changed && changed > 200 && kept_away > 100, "{kept} {changed} {kept_away}");
    }

    #[test]
    fn the_order_of_samples_hardly_matters() {
        let mut rng = Rng::new(1);
        let mut draw = || Sample { position: rng.normal_vector(), normal: DVec3::Z, color: DVec3::ZERO };
        let mut samples: Vec<Sample> = (0..500).map(|_| draw()).collect();
        let a = Surface::new(&samples, 0.5);
        samples.reverse();
        let b = Surface::new(&samples, 0.5);
        assert!(a.len() == b.len() && a.len() < 500);
        assert!(a.positions.iter().zip(&b.positions).all(|(p, q)| p.distance(*q) < 1e-14));
    }
}
