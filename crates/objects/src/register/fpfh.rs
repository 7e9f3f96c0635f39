//! Fast point feature histograms (Rusu, Blodow and Beetz 2009): descriptors of the surface around a point, invariant to
//! rotation and translation.

use glam::DVec3;
use rayon::prelude::*;

use super::surface::Surface;
use instgs_vk::math::nearest::Neighbour;

/// Number of bins for each of the three angles.
const BINS: usize = 11;
/// Number of values in a feature.
pub(super) const FEATURE_LEN: usize = 3 * BINS;
/// Radius of the neighbourhood, voxels: large enough to tell edges from corners.
const RADIUS: f64 = 5.0;
/// Largest number of neighbours; a plane has pi times the squared radius of them.
const MOST_NEIGHBOURS: usize = 100;
/// Sum over the bins of one angle.
const TOTAL: f64 = 100.0;

/// Histograms of the three angles, one after another. Each sums up to 200: 100 of the point's own and 100 of its
/// neighbours'.
pub(super) type Feature = [f32; FEATURE_LEN];

/// One feature per point, whose normals must be unit vectors; all 0 where a point has no neighbours.
pub(super) fn features(surface: &Surface) -> Vec<Feature> {
    let radius = RADIUS * surface.voxel;
    let neighbours = |i: usize| -> Vec<Neighbour> {
        let near = surface.set.nearest(surface.positions[i].as_vec3().to_array(), MOST_NEIGHBOURS + 1);
        near.into_iter().filter(|n| n.index as usize != i && n.squared_distance <= radius * radius).collect()
    };
    let near: Vec<Vec<Neighbour>> = (0..surface.len()).into_par_iter().map(neighbours).collect();
    let simple: Vec<[f64; FEATURE_LEN]> =
        near.par_iter().enumerate().map(|(i, near)| simple_feature(surface, i, near)).collect();
    let feature = |(i, near): (usize, &Vec<Neighbour>)| {
        let around = weighted_mean(&simple, near);
        std::array::from_fn(|k| (simple[i][k] + around[k]) as f32)
    };
    near.par_iter().enumerate().map(feature).collect()
}

/// Histograms of the angles between a point and its neighbours (SPFH).
fn simple_feature(surface: &Surface, i: usize, near: &[Neighbour]) -> [f64; FEATURE_LEN] {
    let point = |i: usize| OrientedPoint { position: surface.positions[i], normal: surface.normals[i] };
    let mut out = [0.0; FEATURE_LEN];
    for n in near {
        let Some(parts) = pair_angles(point(i), point(n.index as usize)) else { continue };
        for (k, part) in parts.into_iter().enumerate() {
            out[k * BINS + ((part * BINS as f64) as usize).min(BINS - 1)] += TOTAL / near.len() as f64;
        }
    }
    out
}

/// Mean of the neighbours' histograms, weighted by 1 / squared distance; each angle sums up to [`TOTAL`].
fn weighted_mean(simple: &[[f64; FEATURE_LEN]], near: &[Neighbour]) -> [f64; FEATURE_LEN] {
    let mut out = [0.0; FEATURE_LEN];
    for n in near.iter().filter(|n| n.squared_distance > 0.0) {
        for (sum, value) in out.iter_mut().zip(&simple[n.index as usize]) {
            *sum += value / n.squared_distance;
        }
    }
    for angle in out.chunks_mut(BINS) {
        let sum: f64 = angle.iter().sum();
        if sum > 0.0 {
            angle.iter_mut().for_each(|value| *value *= TOTAL / sum);
        }
    }
    out
}

/// A point of a surface.
struct OrientedPoint {
    position: DVec3,
    /// Of length 1.
    normal: DVec3,
}

/// The three angles of two points with normals, as parts (0..=1) of their ranges: the turn of the second normal about
/// the first, its lean sideways, and the lean of the line between the points. `None` if the points coincide or the line
/// runs along the normal.
fn pair_angles(p: OrientedPoint, q: OrientedPoint) -> Option<[f64; 3]> {
    let line = (q.position - p.position).try_normalize()?;
    let (at_p, at_q) = (p.normal.dot(line), q.normal.dot(line));
    // The source is the point whose normal is nearer to the line, so that the result does not depend on the order.
    let (source, other, line, along) =
        if at_p.abs() >= at_q.abs() { (p.normal, q.normal, line, at_p) } else { (q.normal, p.normal, -line, -at_q) };
    let sideways = line.cross(source).try_normalize()?;
    let third = source.cross(sideways);
    let turn = third.dot(other).atan2(source.dot(other));
    let parts = [0.5 + turn / std::f64::consts::TAU, 0.5 + 0.5 * sideways.dot(other), 0.5 + 0.5 * along];
    parts.iter().all(|v| v.is_finite()).then(|| parts.map(|v| v.clamp(0.0, 1.0)))
}

/// Squared Euclidean distance of two features.
pub(super) fn squared_difference(a: &Feature, b: &Feature) -> f32 {
    // One sum per bin lets the compiler vectorise; it may not reorder a single sum of 33 numbers.
    let mut sums = [0.0; BINS];
    for (a, b) in a.chunks_exact(BINS).zip(b.chunks_exact(BINS)) {
        for k in 0..BINS {
            sums[k] += (a[k] - b[k]) * (a[k] - b[k]);
        }
    }
    sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::register::surface::Sample;
    use glam::DMat3;
    use instgs_vk::math::covariance::rotation_from_quat;
    use instgs_vk::math::rng::Rng;

    /// Points with normals on two sides of a box; the box is rotated.
    fn corner(rotation: DMat3) -> Surface {
        let mut rng = Rng::new(1);
        let mut samples = Vec::new();
        for i in 0..600 {
            let (u, v) = (rng.range(0.0, 10.0), rng.range(0.0, 10.0));
            let (position, normal) =
                if i % 2 == 0 { (DVec3::new(u, v, 0.0), DVec3::Z) } else { (DVec3::new(u, 0.0, -v), DVec3::NEG_Y) };
            samples.push(Sample { position: rotation * position, normal: rotation * normal, color: DVec3::ZERO });
        }
        // Each point keeps its own voxel, so that both clouds have the same points.
        surface_of(samples.iter().map(|s| (s.position, s.normal)).collect())
    }

    fn surface_of(points: Vec<(DVec3, DVec3)>) -> Surface {
        let (positions, normals): (Vec<DVec3>, Vec<DVec3>) = points.into_iter().unzip();
        Surface::of_points(1.0, positions.clone(), normals, positions)
    }

    /// Rotation changes features only by rounding, which can move a pair to the next bin. A point on an edge has a
    /// feature unlike that of a point on a plane.
    #[test]
    fn features_do_not_depend_on_the_frame_and_tell_shapes_apart() {
        let surface = corner(DMat3::IDENTITY);
        let turned = corner(rotation_from_quat(Rng::new(5).rotation_quat()));
        let (a, b) = (features(&surface), features(&turned));
        let l1 = |a: &Feature, b: &Feature| a.iter().zip(b).map(|(x, y)| (x - y).abs()).sum::<f32>();
        let worst = a.iter().zip(&b).map(|(a, b)| l1(a, b)).fold(0.0, f32::max);
        assert!(worst < 1.0, "{worst}");
        let at = |x: f64, y: f64| surface.nearest(DVec3::new(x, y, 0.0)).unwrap().0;
        let (plane, edge, other_edge) = (a[at(5.0, 8.0)], a[at(4.0, 0.1)], a[at(6.0, 0.1)]);
        let (apart, alike) = (l1(&plane, &edge), l1(&edge, &other_edge));
        assert!(apart > 2.0 * alike, "{apart} {alike}");
        let sums: Vec<f32> = plane.chunks(BINS).map(|angle| angle.iter().sum()).collect();
        assert!(sums.iter().all(|s| (s - 200.0).abs() < 1.0), "{sums:?}");
    }

    #[test]
    fn lone_and_coincident_points_have_no_shape() {
        assert!(features(&surface_of(Vec::new())).is_empty());
        let all = features(&surface_of(vec![(DVec3::ONE, DVec3::Z); 5]));
        assert!(all.len() == 5 && all.iter().flatten().all(|v| *v == 0.0));
    }
}
