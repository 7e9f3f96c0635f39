//! Which object has a Gaussian that lies in the boxes of several.

use crate::math::sh::widened;
use crate::scene::{Gaussians, ObjectBox};

/// A Gaussian that lies in the box of an object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Claim {
    /// Index of the Gaussian.
    pub(super) gaussian: u32,
    /// Id of the object.
    pub(super) object: u16,
    /// How deep it lies there, relative to the box's size: 1 in its middle, 0 at its faces.
    pub(super) depth: f64,
}

/// The Gaussians whose centres lie in boxes of the world, by box.
pub(super) fn claims_of_boxes(cloud: &Gaussians, boxes: &[ObjectBox]) -> Vec<Claim> {
    let mut out = Vec::new();
    for object_box in boxes {
        // Ids of files are those of masks.
        let Ok(object) = u16::try_from(object_box.id) else { continue };
        for (gaussian, mean) in (0..).zip(&cloud.means) {
            let depth = 1.0 - (2.0 * object_box.local(widened(*mean)) / object_box.size).abs().max_element();
            if cloud.is_finite(gaussian as usize) && depth >= 0.0 {
                out.push(Claim { gaussian, object, depth });
            }
        }
    }
    out
}

/// By Gaussian: the object in whose box it lies deepest, the lower id of equals; 0 without a claim.
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

#[cfg(test)]
mod tests {
    use glam::{DQuat, DVec3};

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
        for x in [0.0, 0.5, 1.9, 2.1, f32::NAN] {
            cloud.means.push([x, 0.0, 0.0]);
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            cloud.log_scales.push([0.0; 3]);
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
        let want = [(0, 1, 1.0), (1, 1, 0.75), (2, 1, 0.05), (0, 2, 0.0), (1, 2, 1.0)];
        let near = |a: &(u32, u16, f64), b: &(u32, u16, f64)| (a.0, a.1) == (b.0, b.1) && (a.2 - b.2).abs() < 1e-6;
        assert!(depths.len() == 5 && depths.iter().zip(&want).all(|(a, b)| near(a, b)), "{depths:?}");
        assert_eq!(settled(&claims, 5), [1, 2, 1, 0, 0]);
    }
}
