//! Decides which object gets a Gaussian that lies in the boxes of several.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};

use instgs_vk::math::covariance::covariance;
use instgs_vk::math::sh::widened;
use instgs_vk::math::statistics::median;
use instgs_vk::scene::{Gaussians, ObjectBox};

/// Gaussians this many times as far from the object's median position as its median Gaussian are dropped; even at the
/// ends of a rod, the longest of shapes, the factor is two.
const FAR: f64 = 4.0;
/// Standard deviations of a Gaussian that must lie in the box to each side: five sixths of it.
const DEVIATIONS: f64 = 1.0;

/// A Gaussian that lies in the box of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Claim {
    /// Index of the Gaussian.
    pub(super) gaussian: u32,
    /// Id of the claiming object.
    pub(super) object: u16,
    /// Depth within the box relative to its size: 1 at its centre, 0 at its faces.
    pub(super) depth: f64,
}

/// Claims of boxes in the world, box by box, on the Gaussians that lie in them. A Gaussian that sticks out too far is
/// not claimed: streaks on the ground can have their centre in a box and most of their visible part outside.
pub(super) fn claims_of_boxes(cloud: &Gaussians, boxes: &[ObjectBox]) -> Vec<Claim> {
    let mut out = Vec::new();
    for object_box in boxes {
        // The reader of boxes has checked the range of ids.
        let Ok(object) = u16::try_from(object_box.id) else { continue };
        let turn = DMat3::from_quat(object_box.world_from_box.inverse());
        for i in 0..cloud.len() {
            let off = (2.0 * object_box.local(widened(cloud.means[i])) / object_box.size).abs();
            if !(cloud.is_finite(i) && off.max_element() <= 1.0) {
                continue;
            }
            let covariance = covariance(cloud.quats[i].map(f64::from), widened(cloud.log_scales[i]));
            let of_box = turn * covariance * turn.transpose();
            let deviations = DVec3::from_array([0, 1, 2].map(|k| of_box.col(k)[k].max(0.0).sqrt()));
            if (off + 2.0 * DEVIATIONS * deviations / object_box.size).max_element() <= 1.0 {
                out.push(Claim { gaussian: i as u32, object, depth: 1.0 - off.max_element() });
            }
        }
    }
    out
}

/// By Gaussian: the object in whose box it lies deepest, the lower id in a tie; 0 without a claim.
pub(super) fn settled(claims: &[Claim], gaussians: usize) -> Vec<u16> {
    let mut best: Vec<Option<Claim>> = vec![None; gaussians];
    for claim in claims {
        let slot = &mut best[claim.gaussian as usize];
        let is_better = |old: &Claim| (claim.depth, old.object) > (old.depth, claim.object);
        if slot.as_ref().is_none_or(is_better) {
            *slot = Some(*claim);
        }
    }
    best.into_iter().map(|claim| claim.map_or(0, |claim| claim.object)).collect()
}

/// Sets the label of Gaussians that are far from the centre of their object to 0; labels above 0 are objects. A
/// Gaussian far behind an object that only few views show can lie in the boxes of all of them by chance. Returns the
/// number of Gaussians.
pub(super) fn leave_out_far(cloud: &Gaussians, labels: &mut [u16]) -> usize {
    let mut members: BTreeMap<u16, Vec<usize>> = BTreeMap::new();
    for (i, &label) in labels.iter().enumerate().filter(|(_, label)| **label != 0) {
        members.entry(label).or_default().push(i);
    }
    let mut far = 0;
    for own in members.values() {
        let along = |k: usize| own.iter().map(|&i| f64::from(cloud.means[i][k])).collect::<Vec<f64>>();
        let middle = DVec3::from_array([0, 1, 2].map(|k| median(&along(k))));
        let distances: Vec<f64> = own.iter().map(|&i| widened(cloud.means[i]).distance(middle)).collect();
        // Where most are at one point, no distance is far.
        let usual = median(&distances);
        let limit = if usual > 0.0 { FAR * usual } else { f64::INFINITY };
        for (&i, _) in own.iter().zip(&distances).filter(|(_, distance)| **distance > limit) {
            labels[i] = 0;
            far += 1;
        }
    }
    far
}

#[cfg(test)]
mod tests {
    use glam::DQuat;

    use super::*;

    #[test]
    fn the_deepest_claim_wins_and_the_lower_id_of_equals() {
        let claim = |gaussian, object, depth| Claim { gaussian, object, depth };
        let claims = [claim(0, 9, 0.2), claim(0, 4, 0.3), claim(2, 9, 0.5), claim(2, 3, 0.5), claim(2, 5, 0.5)];
        assert_eq!(settled(&claims, 4), [4, 0, 3, 0]);
        let reversed: Vec<Claim> = claims.into_iter().rev().collect();
        assert_eq!(settled(&reversed, 4), [4, 0, 3, 0]);
    }

    #[test]
    fn depth_is_relative_to_the_box() {
        let mut cloud = Gaussians::with_capacity(0, 0);
        for x in [0.0, 0.5, 1.9, 2.1, f32::NAN, 1.8] {
            cloud.means.push([x, 0.0, 0.0]);
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            // A long one at 1.8, which sticks out; the others are small.
            cloud.log_scales.push([if x == 1.8 { -0.5 } else { -6.0 }, -6.0, -6.0]);
            cloud.opacity_logits.push(0.0);
            cloud.sh.push([0.0; 3]);
        }
        let of_size = |id, x: f64, size: f64| ObjectBox {
            id,
            category: None,
            center: DVec3::new(x, 0.0, 0.0),
            size: DVec3::splat(size),
            world_from_box: DQuat::IDENTITY,
        };
        let claims = claims_of_boxes(&cloud, &[of_size(1, 0.0, 4.0), of_size(2, 0.5, 1.0)]);
        let depths: Vec<(u32, u16, f64)> = claims.iter().map(|c| (c.gaussian, c.object, c.depth)).collect();
        let want = [(0, 1, 1.0), (1, 1, 0.75), (2, 1, 0.05), (1, 2, 1.0)];
        let near = |a: &(u32, u16, f64), b: &(u32, u16, f64)| (a.0, a.1) == (b.0, b.1) && (a.2 - b.2).abs() < 1e-6;
        assert!(depths.len() == want.len() && depths.iter().zip(&want).all(|(a, b)| near(a, b)), "{depths:?}");
        assert_eq!(settled(&claims, 6), [1, 2, 1, 0, 0, 0]);
    }

    #[test]
    fn what_is_far_from_its_object_is_left_out() {
        let mut cloud = Gaussians::with_capacity(0, 0);
        cloud.means = (0..41).map(|i| [i as f32, 0.0, 0.0]).collect();
        cloud.means.extend([[70.0, 0.0, 0.0], [20.0, 0.0, -39.0]]);
        let mut labels = vec![3; 43];
        // The median distance from the centre, 20, is 10 or 11: up to 40 or 44 is near.
        assert_eq!(leave_out_far(&cloud, &mut labels), 1);
        assert_eq!((labels[41], labels[42], labels[0], labels[40]), (0, 3, 3, 3));
    }
}
