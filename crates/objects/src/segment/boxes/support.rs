//! Removes the ground from objects: a box that a person draws reaches into it, and boxes in photos cannot separate it
//! from the object's lower end. A plane that is not part of the object lies around its foot; Gaussians of the object on
//! or below that plane are removed.

use std::collections::BTreeMap;

use glam::DVec3;
use rayon::prelude::*;

use instgs_vk::math::covariance::sigmoid;
use instgs_vk::math::plane::{Plane, PlaneDraws};
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::widened;
use instgs_vk::math::statistics::{median, percentile};
use instgs_vk::scene::Gaussians;

/// Radius of the surroundings, in radii of the object.
const RING: f64 = 2.0;
/// Part of the object's Gaussians ignored as strays at each end when foot, head and radius are measured.
const STRAY_PART: f64 = 0.05;
/// The plane is searched down to this part of the object's size below its foot and ...
const BELOW: f64 = 0.5;
/// ... up to this part above it: carving leaves some ground to the object or removes its lowest end.
const ABOVE: f64 = 0.4;
/// Gaussians within this part of the object's size belong to the plane. The wheels of a car are a sixth of its size.
const THICKNESS: f64 = 0.03;
/// Cosine of the steepest slope: 26 degrees.
const FLAT: f64 = 0.9;
/// Gaussians of lower opacity are haze and support nothing.
const MIN_OPACITY: f64 = 0.1;
/// Least number of Gaussians in the plane, and ...
const MIN_INLIERS: usize = 10;
/// ... their least part of the surroundings, which contain other objects, too.
const INLIER_PART: f64 = 0.2;
/// At most this many times the plane's Gaussians lie below it: trained ground is uneven. A plane through the crown of a
/// tree has all of the ground below it.
const BELOW_PART: f64 = 0.8;
/// Random planes that are tried. If the ground is a third of the surroundings, 1 in 27 lies in it, and none of 400 does
/// with a probability of 3e-7.
const DRAWS: usize = 400;
/// Gaussians of the surroundings used at most, evenly sampled.
const MAX_SURROUNDINGS: usize = 2000;
/// Stream of the random planes, derived from the seed.
const STREAM: u64 = 0x5099;

/// What lies on or below the support of each object.
pub(super) struct Supports {
    /// By object, indices of its Gaussians there; `None` where no support was found.
    pub under: BTreeMap<u16, Option<Vec<u32>>>,
}

impl Supports {
    /// Of the objects that `labels` above 0 name, which stand on what is below them along `up`, a unit vector of the world.
    pub(super) fn below(cloud: &Gaussians, labels: &[u16], up: DVec3, seed: u64) -> Self {
        let mut members: BTreeMap<u16, Vec<u32>> = BTreeMap::new();
        for (i, &label) in (0..).zip(labels).filter(|(i, label)| **label != 0 && cloud.is_finite(*i as usize)) {
            members.entry(label).or_default().push(i);
        }
        let is_solid = |i: &usize| cloud.is_finite(*i) && sigmoid(f64::from(cloud.opacity_logits[*i])) >= MIN_OPACITY;
        let solid: Vec<(u16, DVec3)> =
            (0..cloud.len()).filter(is_solid).map(|i| (labels[i], widened(cloud.means[i]))).collect();
        let of_object = |(&object, own): (&u16, &Vec<u32>)| {
            // Other objects count as surroundings: a vase stands on a table.
            let others = solid.iter().filter(|(label, _)| *label != object).map(|(_, place)| *place);
            let places: Vec<DVec3> = own.iter().map(|&i| widened(cloud.means[i as usize])).collect();
            let rng = Rng::new(seed).fork(STREAM).fork(u64::from(object));
            let is_under = |support: Support| {
                let under = own.iter().zip(&places).filter(|(_, place)| support.is_over(**place));
                under.map(|(i, _)| *i).collect::<Vec<u32>>()
            };
            (object, support_of(&places, others, up, rng).map(is_under))
        };
        Self { under: members.par_iter().map(of_object).collect() }
    }

    /// The same along the normal of what cameras look straight at. It may be that of a wall: then most of a window lies in what it
    /// would stand on, and that is no support.
    pub(super) fn behind(cloud: &Gaussians, labels: &[u16], normal: DVec3, seed: u64) -> Self {
        let mut found = Self::below(cloud, labels, normal, seed);
        let mut sizes: BTreeMap<u16, usize> = BTreeMap::new();
        labels.iter().for_each(|label| *sizes.entry(*label).or_default() += 1);
        for (object, under) in &mut found.under {
            let size = sizes.get(object).copied().unwrap_or_default();
            under.take_if(|under| 2 * under.len() > size);
        }
        found
    }

    /// How many objects have one.
    pub(super) fn count(&self) -> usize {
        self.under.values().flatten().count()
    }
}

/// A flat surface that an object stands on.
#[derive(Clone, Copy, Debug)]
struct Support {
    /// The plane; its normal points up.
    plane: Plane,
    /// Half of the thickness, scene units.
    thickness: f64,
}

impl Support {
    /// Whether a point lies in the support or below it.
    fn is_over(&self, place: DVec3) -> bool {
        self.plane.height(place) < self.thickness
    }
}

/// The plane around the foot of the object at `own` that holds most of the `others` there, if it holds enough.
fn support_of(own: &[DVec3], others: impl Iterator<Item = DVec3>, up: DVec3, rng: Rng) -> Option<Support> {
    let heights: Vec<f64> = own.iter().map(|p| p.dot(up)).collect();
    let [foot, head] = [STRAY_PART, 1.0 - STRAY_PART].map(|part| percentile(&heights, part));
    let sideways = |p: DVec3| p - up * p.dot(up);
    let axis = DVec3::from_array([0, 1, 2].map(|k| median(&own.iter().map(|p| sideways(*p)[k]).collect::<Vec<f64>>())));
    let aside = |p: DVec3| (sideways(p) - axis).length();
    let radius = percentile(&own.iter().map(|p| aside(*p)).collect::<Vec<f64>>(), 1.0 - STRAY_PART);
    let size = radius.max(head - foot);
    let is_near = |p: &DVec3| {
        let height = p.dot(up) - foot;
        height > -BELOW * size && height < ABOVE * size && aside(*p) < RING * radius
    };
    let around: Vec<DVec3> = others.filter(is_near).collect();
    let stride = around.len().div_ceil(MAX_SURROUNDINGS).max(1);
    let around: Vec<DVec3> = around.into_iter().step_by(stride).collect();
    if around.len() < MIN_INLIERS {
        return None;
    }
    let thickness = THICKNESS * size;
    let draws = PlaneDraws { draws: DRAWS, up, level: FLAT, reach: thickness };
    let (plane, inliers) = draws.best(&around, rng)?;
    let below = around.iter().filter(|p| plane.height(**p) < -2.0 * thickness).count();
    let is_enough = inliers as f64 >= (INLIER_PART * around.len() as f64).max(MIN_INLIERS as f64);
    if !is_enough || below as f64 > BELOW_PART * inliers as f64 {
        return None;
    }
    // The plane goes through three Gaussians; the median height of all its Gaussians is more exact.
    let heights = around.iter().map(|p| plane.height(*p)).filter(|height| height.abs() < thickness);
    let plane = Plane { offset: plane.offset + median(&heights.collect::<Vec<f64>>()), ..plane };
    Some(Support { plane, thickness })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A box of points from the ground up to 1, with a metre of ground around and below it, at a slope of a tenth.
    fn on_a_slope(tilt: DVec3) -> (Vec<DVec3>, Vec<DVec3>) {
        let mut rng = Rng::new(4);
        let ground = |p: DVec3| 0.1 * p.x;
        let mut own = Vec::new();
        let mut others = Vec::new();
        for _ in 0..600 {
            let p = DVec3::new(rng.range(-0.5, 0.5), rng.range(-0.5, 0.5), 0.0);
            own.push(p + DVec3::Z * (ground(p) + rng.range(0.05, 1.0)));
            own.push(p + DVec3::Z * (ground(p) + rng.range(-0.01, 0.01)));
            let p = DVec3::new(rng.range(-1.5, 1.5), rng.range(-1.5, 1.5), 0.0);
            if p.abs().max_element() > 0.5 {
                others.push(p + DVec3::Z * ground(p));
            }
            others.push(DVec3::new(rng.range(-2.0, 2.0), rng.range(-2.0, 2.0), rng.range(-0.5, 3.0)));
        }
        let turn = glam::DQuat::from_rotation_arc(DVec3::Z, tilt);
        (own.iter().map(|p| turn * *p).collect(), others.iter().map(|p| turn * *p).collect())
    }

    #[test]
    fn the_ground_under_an_object_is_found_whichever_way_is_up() {
        for up in [DVec3::Z, DVec3::NEG_Y, DVec3::new(0.6, 0.0, 0.8)] {
            let (own, others) = on_a_slope(up);
            let support = support_of(&own, others.iter().copied(), up, Rng::new(1)).unwrap();
            let under: Vec<bool> = own.iter().map(|p| support.is_over(*p)).collect();
            let right = under.iter().enumerate().filter(|(i, under)| **under == (i % 2 == 1)).count();
            assert!(right as f64 > 0.97 * own.len() as f64, "{right} of {}", own.len());
        }
    }

    #[test]
    fn where_nothing_is_flat_nothing_is_found() {
        let (own, mut others) = on_a_slope(DVec3::Z);
        others.iter_mut().for_each(|p| *p += 3.0 * DVec3::Z);
        assert!(support_of(&own, others.iter().copied(), DVec3::Z, Rng::new(1)).is_none(), "a ceiling is no ground");
        assert!(support_of(&own, [].into_iter(), DVec3::Z, Rng::new(1)).is_none());
        let (_, mut floors) = on_a_slope(DVec3::Z);
        let shelf: Vec<DVec3> = floors.iter().filter(|p| p.z.abs() < 0.2).map(|p| *p - 0.3 * DVec3::Z).collect();
        assert!(support_of(&own, floors.iter().copied(), DVec3::Z, Rng::new(1)).is_some());
        floors.extend(shelf);
        let found = support_of(&own, floors.iter().copied(), DVec3::Z, Rng::new(1));
        assert!(
            found.is_none_or(|support| support.plane.height(DVec3::ZERO) > 0.2),
            "what has a floor below it is none"
        );
        let mut rng = Rng::new(2);
        let scattered: Vec<DVec3> = (0..500).map(|_| rng.normal_vector()).collect();
        assert!(support_of(&own, scattered.iter().copied(), DVec3::Z, Rng::new(1)).is_none());
    }

    /// Adds Gaussians with a label, spread over a box from `low` to `high`.
    fn fill(cloud: &mut Gaussians, labels: &mut Vec<u16>, label: u16, [low, high]: [DVec3; 2], count: usize) {
        let mut rng = Rng::new(labels.len() as u64);
        for _ in 0..count {
            let at = [0, 1, 2].map(|axis: usize| rng.range(low[axis], high[axis]) as f32);
            cloud.means.push(at);
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            cloud.log_scales.push([-3.0; 3]);
            cloud.opacity_logits.push(3.0);
            cloud.sh.push([0.3; 3]);
            labels.push(label);
        }
    }

    /// Three boxes on a plane, each with what of it lies below; and three windows in it.
    #[test]
    fn what_stands_on_a_plane_has_a_support_and_what_lies_in_it_none() {
        for (height, is_supported) in [(1.0, true), (0.02, false)] {
            let (mut cloud, mut labels) = (Gaussians::with_capacity(0, 0), Vec::new());
            fill(&mut cloud, &mut labels, 0, [DVec3::new(-3.0, -3.0, -0.01), DVec3::new(13.0, 3.0, 0.01)], 3000);
            for label in 1..=3_u16 {
                let corner = DVec3::X * (5.0 * f64::from(label - 1));
                let top = corner + DVec3::new(1.0, 1.0, height);
                fill(&mut cloud, &mut labels, label, [corner, top], 300);
                fill(&mut cloud, &mut labels, label, [corner, corner + DVec3::new(1.0, 1.0, 0.005)], 60);
            }
            let found = Supports::behind(&cloud, &labels, DVec3::Z, 1).count();
            assert_eq!(found, if is_supported { 3 } else { 0 }, "{height}");
            // Along the north, as on a flight, there is hardly one.
            assert!(Supports::below(&cloud, &labels, DVec3::Y, 1).count() < 2, "{height}");
            let under = Supports::below(&cloud, &labels, DVec3::Z, 1).under;
            assert!(under.values().all(|under| under.as_ref().is_some_and(|under| under.len() >= 60)), "{height}");
        }
    }
}
