//! Twin of pass `mask_contribution`: the contribution of every Gaussian to the pixels of every mask, in f64.
//!
//! A pixel is the sum over its splats of alpha_i T_i c_i, so alpha_i T_i is the derivative of the pixel by the colour
//! c_i, in each channel. Summed over the pixels with mask id m it is A[i, m] (Eq. 2 of the InstGS paper).

use std::collections::BTreeMap;

use rayon::prelude::*;

use crate::preprocess_instance_expand::ProjectedSplat;
use crate::tile_blend::{ALPHA_MAX, blend_row_with_pairs, candidate_boxes};
use crate::view::View;

/// `A[(flat index, mask id)]` in pixels; pairs without a blended pixel are absent. `splats` are in depth order, `ids`
/// has one mask id per pixel, row by row, 0 = no mask.
///
/// # Panics
/// If the length of `ids` is not the view's number of pixels.
pub fn mask_contributions(view: &View, splats: &[ProjectedSplat], ids: &[u16]) -> BTreeMap<(u32, u16), f64> {
    let width = view.width as usize;
    assert_eq!(ids.len(), width * view.height as usize, "one mask id per pixel");
    let boxes = candidate_boxes(view, splats);
    // Rows are summed in order, so that the result does not depend on the number of threads.
    let rows: Vec<BTreeMap<(u32, u16), f64>> = (0..view.height)
        .into_par_iter()
        .map(|y| {
            let mut sums = BTreeMap::new();
            for (x, (_, pairs)) in blend_row_with_pairs(view, splats, &boxes, y).iter().enumerate() {
                let id = ids[y as usize * width + x];
                let mut transmittance = 1.0;
                for pair in pairs {
                    let alpha = pair.alpha_raw.min(ALPHA_MAX);
                    *sums.entry((splats[pair.splat].flat_index, id)).or_default() += alpha * transmittance;
                    transmittance *= 1.0 - alpha;
                }
            }
            sums
        })
        .collect();
    let mut out = BTreeMap::new();
    rows.into_iter().flatten().for_each(|(key, weight)| *out.entry(key).or_default() += weight);
    out
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::tile_blend::relaxed_limits;
    use crate::{RenderOptions, render, splats_in_depth_order};
    use instgs_vk::scene::{Camera, Gaussians, InstancedScene};

    /// Two Gaussians of opacity 0.5 on the view axis, and one beside it.
    fn scene() -> InstancedScene {
        let mut cloud = Gaussians::with_capacity(0, 3);
        for mean in [[0.0, 0.0, 2.0], [0.0, 0.0, 1.0], [0.6, 0.0, 2.0]] {
            cloud.means.push(mean);
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            cloud.log_scales.push([0.1f32.ln(); 3]);
            cloud.opacity_logits.push(0.0);
            cloud.sh.push([0.3; 3]);
        }
        InstancedScene::from_cloud(cloud)
    }

    /// Summed over all masks, a Gaussian's contributions times its colour add up to the picture: they are the
    /// derivative of its sum, and every splat here has the colour 0.5 + 0.3 C0. Measured: 3e-16.
    #[test]
    fn weights_times_colours_make_the_picture() {
        let camera = Camera::look_at("view", DVec3::ZERO, DVec3::Z, DVec3::NEG_Y, 1.0, (15, 11));
        let options = RenderOptions { background: [0.0; 3], ..RenderOptions::default() };
        let view = View::device(&camera, &options);
        let sources = crate::preprocess_instance_expand::sources(&scene());
        let splats = splats_in_depth_order(&sources, &view, &relaxed_limits(&view));
        let ids: Vec<u16> = (0..15 * 11).map(|i| [0, 7, 65535][i % 3]).collect();
        let sums = mask_contributions(&view, &splats, &ids);
        assert_eq!(sums.len(), 9, "three Gaussians in three masks");
        let picture = render(&scene(), &camera, &options);
        let alpha: f64 = picture.alpha.iter().sum();
        assert!((sums.values().sum::<f64>() / alpha - 1.0).abs() < 1e-12);
        for id in [0, 7, 65535] {
            let of_id: f64 = sums.iter().filter(|((_, m), _)| *m == id).map(|(_, w)| w).sum();
            let want: f64 = picture.alpha.iter().zip(&ids).filter(|(_, m)| **m == id).map(|(a, _)| a).sum();
            assert!((of_id / want - 1.0).abs() < 1e-12, "id {id}");
        }
        // The nearer Gaussian on the axis hides a part of the other, which contributes less although its own shape is
        // unchanged.
        let total = |i: u32| sums.iter().filter(|((g, _), _)| *g == i).map(|(_, w)| w).sum::<f64>();
        assert!(total(1) > 3.0 * total(0), "{} {}", total(1), total(0));
    }
}
