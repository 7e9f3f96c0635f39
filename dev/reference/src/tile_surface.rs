//! Twin of kernel `tile_surface`: the id buffer, the Gaussian at the surface of every pixel, with transmittance in f64.

use crate::preprocess_instance_expand::ProjectedSplat;
use crate::tile_blend::{ALPHA_MAX, BlendedPair, BlendedPixel, blend_row_with_pairs, candidate_boxes};
use crate::view::View;
use instgs_vk::scene::InstancedScene;

/// The surface of a pixel is the first splat behind which its transmittance is below this.
const T_SURFACE: f64 = 0.5;
/// A pixel is not robust if its transmittance is within this part of [`T_SURFACE`]: f32 products of dozens of factors
/// have errors of 1e-6.
const MARGIN: f64 = 1e-4;

/// The Gaussian at a pixel's surface.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SurfacePoint {
    /// Index of the instance; for the background, one more than the last.
    pub instance: u32,
    /// Index of the Gaussian in its template, after all of these among the instance's own, or in the background.
    pub local: u32,
}

/// The id buffer's entry for one pixel.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Surface {
    /// The surface; `None` if at least half of the light passes all splats.
    pub point: Option<SurfacePoint>,
    /// Whether f32 must take the same decisions.
    pub robust: bool,
}

/// The id buffer of the view, row by row. `splats` are in depth order.
pub fn surfaces(view: &View, splats: &[ProjectedSplat], scene: &InstancedScene) -> Vec<Surface> {
    let firsts = first_flat(scene);
    let boxes = candidate_boxes(view, splats);
    let surface_of = |(pixel, pairs): &(BlendedPixel, Vec<BlendedPair>)| {
        let mut out = Surface { point: None, robust: pixel.robust };
        let mut transmittance = 1.0;
        for pair in pairs {
            transmittance *= 1.0 - pair.alpha_raw.min(ALPHA_MAX);
            out.robust &= (transmittance / T_SURFACE - 1.0).abs() > MARGIN;
            if transmittance < T_SURFACE {
                let flat = splats[pair.splat].flat_index;
                let instance = firsts.partition_point(|&first| first <= flat) - 1;
                out.point = Some(SurfacePoint { instance: instance as u32, local: flat - firsts[instance] });
                break;
            }
        }
        out
    };
    let row = |y| blend_row_with_pairs(view, splats, &boxes, y).iter().map(surface_of).collect::<Vec<_>>();
    (0..view.height).flat_map(row).collect()
}

/// First flat index of every instance, and of the background at the end. The Gaussians of an instance's template come before
/// its own.
fn first_flat(scene: &InstancedScene) -> Vec<u32> {
    let mut first = 0;
    let mut out = Vec::new();
    for (k, instance) in scene.instances.iter().enumerate() {
        out.push(first);
        first += scene.template_ranges[instance.template as usize].count + scene.own_range(k).count;
    }
    out.push(first);
    out
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::preprocess_instance_expand::sources;
    use crate::tile_blend::relaxed_limits;
    use crate::{RenderOptions, splats_in_depth_order};
    use instgs_vk::math::similarity::Similarity;
    use instgs_vk::scene::{Camera, Gaussians, Instance, SourceRange};

    /// An opaque Gaussian at each of some depths, on the view axis.
    fn opaque(depths: &[f32]) -> Gaussians {
        let mut cloud = Gaussians::with_capacity(0, depths.len());
        for &z in depths {
            cloud.means.push([0.0, 0.0, z]);
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            cloud.log_scales.push([0.3f32.ln(); 3]);
            cloud.opacity_logits.push(4.0);
            cloud.sh.push([0.0; 3]);
        }
        cloud
    }

    /// Every Gaussian of a scene whose instances have own ones, brought to the front in turn, is the surface at the centre.
    #[test]
    fn own_gaussians_count_after_those_of_the_template() {
        let instance = |template| Instance { template, world_from_template: Similarity::IDENTITY, first_offset: None };
        let range = |first, count| SourceRange { first, count };
        let scene = InstancedScene {
            templates: opaque(&[5.0, 6.0, 7.0]),
            template_ranges: vec![range(0, 2), range(2, 1)],
            instances: vec![instance(0), instance(1), instance(0)],
            own: opaque(&[8.0, 9.0, 10.0]),
            own_ranges: vec![range(0, 2), range(0, 0), range(2, 1)],
            background: opaque(&[11.0, 12.0]),
            ..InstancedScene::default()
        };
        scene.validate().unwrap();
        let camera = Camera::look_at("view", DVec3::ZERO, DVec3::Z, DVec3::NEG_Y, 1.0, (9, 9));
        let view = View::device(&camera, &RenderOptions::default());
        let with_in_front = |cloud_of: fn(&mut InstancedScene) -> &mut Gaussians, i: usize| {
            let mut scene = scene.clone();
            cloud_of(&mut scene).means[i][2] = 2.0;
            let splats = splats_in_depth_order(&sources(&scene), &view, &relaxed_limits(&view));
            surfaces(&view, &splats, &scene)[40].point.map(|point| [point.instance, point.local])
        };
        // Of two instances that show the same Gaussian at the same depth, the first is in front.
        assert_eq!([0, 1, 2].map(|i| with_in_front(|s| &mut s.templates, i)), [[0, 0], [0, 1], [1, 0]].map(Some));
        assert_eq!([0, 1, 2].map(|i| with_in_front(|s| &mut s.own, i)), [[0, 2], [0, 3], [2, 2]].map(Some));
        assert_eq!([0, 1].map(|i| with_in_front(|s| &mut s.background, i)), [[3, 0], [3, 1]].map(Some));
    }

    /// Two Gaussians on the view axis that pass 0.7 and 0.6 of the light at the centre: the second one is the surface
    /// there.
    #[test]
    fn the_surface_is_where_half_of_the_light_is_gone() {
        let mut cloud = Gaussians::with_capacity(0, 2);
        for (z, opacity) in [(1.0, 0.3f32), (2.0, 0.4)] {
            cloud.means.push([0.0, 0.0, z]);
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            cloud.log_scales.push([0.3f32.ln(); 3]);
            cloud.opacity_logits.push((opacity / (1.0 - opacity)).ln());
            cloud.sh.push([0.0; 3]);
        }
        let surface_of = |scene: &InstancedScene| {
            let camera = Camera::look_at("view", DVec3::ZERO, DVec3::Z, DVec3::NEG_Y, 1.0, (9, 9));
            let view = View::device(&camera, &RenderOptions::default());
            let splats = splats_in_depth_order(&sources(scene), &view, &relaxed_limits(&view));
            surfaces(&view, &splats, scene)
        };
        let both = surface_of(&InstancedScene::from_cloud(cloud.clone()));
        assert_eq!(both[40], Surface { point: Some(SurfacePoint { instance: 0, local: 1 }), robust: true });
        assert_eq!(both[0].point, None, "the corner");
        let front = surface_of(&InstancedScene::from_cloud(cloud.filtered(|i| i == 0)));
        assert!(front.iter().all(|s| s.point.is_none()));
    }
}
