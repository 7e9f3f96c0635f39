//! Twin of pass `gather_gradients`: gradients of the scene's parameters from those of every pair (instance, Gaussian).
//!
//! Shared parameters get the *sum* of the gradients of all instances; offsets get that of their own instance. Every
//! parameter enters as template + offset (of the kinds that a scene has), so both get the same contribution.

use glam::DVec3;
use rayon::prelude::*;

use crate::poses::{PoseStep, pose_gradient};
use crate::preprocess_instance_expand::{CullLimits, SourceGaussian, sources};
use crate::preprocess_instance_expand_backward::{SourceGradient, project_backward};
use crate::splats_in_depth_order;
use crate::tile_blend_backward::{SplatGradient, blend_backward};
use crate::view::View;
use instgs_vk::scene::gaussians::Gaussians;
use instgs_vk::scene::instanced_scene::InstancedScene;
use instgs_vk::scene::parameters::{Owner, Parameter, ParameterSet};

/// Gradients in the layout of `scene::Gaussians`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CloudGradient {
    /// Degree of `sh`, the same as the cloud's.
    pub sh_degree: u32,
    /// With respect to the centres.
    pub means: Vec<[f64; 3]>,
    /// With respect to the quaternions (w, x, y, z) as they are stored.
    pub quats: Vec<[f64; 4]>,
    /// With respect to the logarithms of the standard deviations.
    pub log_scales: Vec<[f64; 3]>,
    /// With respect to the opacity logits.
    pub opacity_logits: Vec<f64>,
    /// With respect to the SH coefficients `[Gaussian][coefficient][rgb]`, flattened: entry `i * C + c`.
    pub sh: Vec<[f64; 3]>,
}

/// Gradients of all parameters of a scene.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SceneGradient {
    /// Gradients of the templates, summed over their instances.
    pub templates: CloudGradient,
    /// Gradients of instances' own Gaussians, in the frames of their templates.
    pub own: CloudGradient,
    /// Gradients of the background, in the world frame.
    pub background: CloudGradient,
    /// By parameter, flattened, of offsets (zero for records that no instance uses) and colour matrices. Empty where the scene
    /// has none, and for parameters of source Gaussians.
    pub per_instance: ParameterSet<Vec<f64>>,
    /// Per instance, rows of (dL/dA | dL/dt), every entry independent.
    pub instances: Vec<[[f64; 4]; 3]>,
    /// Per instance: with respect to a shift, a rotation vector and the logarithm of the scale, in the template's frame
    /// (see `poses`).
    pub poses: Vec<PoseStep>,
}

impl CloudGradient {
    /// Zero gradients in the shape of a cloud.
    pub fn zeros(cloud: &Gaussians) -> Self {
        Self {
            sh_degree: cloud.sh_degree,
            means: vec![[0.0; 3]; cloud.len()],
            quats: vec![[0.0; 4]; cloud.len()],
            log_scales: vec![[0.0; 3]; cloud.len()],
            opacity_logits: vec![0.0; cloud.len()],
            sh: vec![[0.0; 3]; cloud.sh.len()],
        }
    }

    /// Adds the contribution of one pair (instance, Gaussian) to Gaussian `i`.
    pub fn add(&mut self, i: usize, gradient: &SourceGradient) {
        add(&mut self.means[i], gradient.mean_template.to_array());
        add(&mut self.quats[i], gradient.quat);
        add(&mut self.log_scales[i], gradient.log_scales.to_array());
        self.opacity_logits[i] += gradient.opacity_logit;
        let first = i * gradient.sh.len();
        for (sum, value) in self.sh[first..].iter_mut().zip(&gradient.sh) {
            add(sum, value.to_array());
        }
    }
}

/// Adds what one (instance, Gaussian) pair contributes to row `row` of everything that `owner` has.
fn add_per_instance(sums: &mut ParameterSet<Vec<f64>>, owner: Owner, row: usize, gradient: &SourceGradient) {
    // A record has a mean of three numbers, and three for each SH coefficient above 0 that has offsets.
    let rest = sums[Parameter::OffsetShRest].len() / sums[Parameter::OffsetMeans].len().max(1);
    let flat = |colors: &[DVec3]| colors.iter().flat_map(|color| color.to_array()).collect();
    for (parameter, sums) in sums.iter_mut().filter(|(parameter, _)| parameter.owner() == owner) {
        let values: Vec<f64> = match parameter {
            Parameter::OffsetMeans => gradient.mean_template.to_array().into(),
            Parameter::OffsetShDc => flat(&gradient.sh[..1]),
            Parameter::OffsetOpacityLogits => vec![gradient.opacity_logit],
            Parameter::OffsetShRest => flat(&gradient.sh[1..=rest]),
            Parameter::OffsetLogScales => gradient.log_scales.to_array().into(),
            Parameter::OffsetQuats => gradient.quat.into(),
            Parameter::ColorFromTemplate => gradient.color_from_template.as_flattened().into(),
            _ => Vec::new(),
        };
        sums.iter_mut().skip(row * values.len()).zip(values).for_each(|(sum, value)| *sum += value);
    }
}

fn add<const N: usize>(sum: &mut [f64; N], value: [f64; N]) {
    sum.iter_mut().zip(value).for_each(|(s, v)| *s += v);
}

/// Gradient of every source, in the order of `sources`; `None` if it is culled. `cotangents` are as in
/// `blend_backward`.
pub fn source_gradients(
    sources: &[SourceGaussian],
    view: &View,
    cotangents: &[[f64; 4]],
) -> Vec<Option<SourceGradient>> {
    let per_splat = splat_gradients(sources, view, cotangents);
    sources.par_iter().zip(per_splat).map(|(source, splat)| Some(project_backward(view, source, &splat?))).collect()
}

/// Gradient of every source's splat, in the order of `sources`, whose flat indices are their positions; `None` if it is
/// culled.
pub fn splat_gradients(sources: &[SourceGaussian], view: &View, cotangents: &[[f64; 4]]) -> Vec<Option<SplatGradient>> {
    let splats = splats_in_depth_order(sources, view, &CullLimits::exact(view));
    let mut out = vec![None; sources.len()];
    for (splat, gradient) in splats.iter().zip(blend_backward(view, &splats, cotangents)) {
        out[splat.flat_index as usize] = Some(gradient);
    }
    out
}

/// Sums the gradients of all pairs (instance, Gaussian), in flat order, into those of the scene's parameters.
pub fn gather_gradients(scene: &InstancedScene, gradients: &[Option<SourceGradient>]) -> SceneGradient {
    assert_eq!(gradients.len() as u64, scene.expanded_len(), "one gradient per Gaussian in flat order");
    let mut out = SceneGradient {
        templates: CloudGradient::zeros(&scene.templates),
        background: CloudGradient::zeros(&scene.background),
        own: CloudGradient::zeros(&scene.own),
        per_instance: ParameterSet::from_fn(|parameter| match parameter.owner() {
            Owner::Source | Owner::ShBand(_) => Vec::new(),
            Owner::Offset | Owner::Instance => vec![0.0; scene.parameter(parameter).len()],
        }),
        instances: vec![[[0.0; 4]; 3]; scene.instances.len()],
        poses: Vec::new(),
    };
    let mut in_flat_order = gradients.iter();
    for (k, (instance, d_placement)) in scene.instances.iter().zip(&mut out.instances).enumerate() {
        let range = scene.template_ranges[instance.template as usize];
        for local in 0..range.count {
            let Some(Some(gradient)) = in_flat_order.next() else { continue };
            out.templates.add((range.first + local) as usize, gradient);
            d_placement.iter_mut().zip(gradient.world_from_template).for_each(|(sum, row)| add(sum, row));
            add_per_instance(&mut out.per_instance, Owner::Instance, k, gradient);
            if let Some(first) = instance.first_offset {
                add_per_instance(&mut out.per_instance, Owner::Offset, (first + local) as usize, gradient);
            }
        }
        for i in scene.own_range(k).indices() {
            let Some(Some(gradient)) = in_flat_order.next() else { continue };
            out.own.add(i, gradient);
            d_placement.iter_mut().zip(gradient.world_from_template).for_each(|(sum, row)| add(sum, row));
        }
    }
    for (i, gradient) in in_flat_order.enumerate() {
        if let Some(gradient) = gradient {
            out.background.add(i, gradient);
        }
    }
    let placed = scene.instances.iter().zip(&out.instances);
    out.poses = placed.map(|(instance, gradient)| pose_gradient(&instance.world_from_template, gradient)).collect();
    out
}

/// The whole backward pass: gradients of sum(cotangent * (r, g, b, alpha)) over all pixels.
pub fn scene_gradient(scene: &InstancedScene, view: &View, cotangents: &[[f64; 4]]) -> SceneGradient {
    gather_gradients(scene, &source_gradients(&sources(scene), view, cotangents))
}

#[cfg(test)]
mod tests {
    use glam::DVec2;

    use super::*;
    use instgs_vk::math::similarity::Similarity;
    use instgs_vk::scene::instanced_scene::{Instance, SourceRange};
    use instgs_vk::scene::offsets::Offsets;

    /// A gradient whose entries are all `v`.
    fn constant(v: f64, sh: usize) -> Option<SourceGradient> {
        Some(SourceGradient {
            mean_template: DVec3::splat(v),
            quat: [v; 4],
            log_scales: DVec3::splat(v),
            opacity_logit: v,
            sh: vec![DVec3::splat(v); sh],
            world_from_template: [[v; 4]; 3],
            color_from_template: [[v; 4]; 3],
            mean_px: DVec2::splat(v),
        })
    }

    fn cloud(n: usize, sh_degree: u32) -> Gaussians {
        let mut out = Gaussians { sh_degree, ..Gaussians::default() };
        (out.means, out.quats, out.log_scales) = (vec![[0.0; 3]; n], vec![[1.0; 4]; n], vec![[0.0; 3]; n]);
        (out.opacity_logits, out.sh) = (vec![0.0; n], vec![[0.0; 3]; n * out.sh_coefficients()]);
        out
    }

    /// Templates of 1 and 2 Gaussians; the second twice, with records 1.. of the offsets in its second instance; one
    /// background Gaussian. Every pair has its own power of two, so that a sum shows its terms.
    #[test]
    fn sums_by_owner() {
        let instance =
            |template, first_offset| Instance { template, world_from_template: Similarity::IDENTITY, first_offset };
        let offsets = Offsets {
            means: vec![[0.0; 3]; 3],
            sh_dc: vec![[0.0; 3]; 3],
            opacity_logits: vec![0.0; 3],
            ..Offsets::default()
        };
        let scene = InstancedScene {
            templates: cloud(3, 1),
            template_ranges: vec![SourceRange { first: 0, count: 1 }, SourceRange { first: 1, count: 2 }],
            instances: vec![instance(1, None), instance(0, None), instance(1, Some(1))],
            offsets,
            background: cloud(1, 0),
            ..InstancedScene::default()
        };
        scene.validate().unwrap();
        let mut gradients: Vec<_> = (0..5).map(|i| constant(f64::from(1 << i), 4)).collect();
        gradients.push(constant(32.0, 1));
        let got = gather_gradients(&scene, &gradients);
        assert_eq!(got.templates.opacity_logits, [4.0, 1.0 + 8.0, 2.0 + 16.0]);
        assert_eq!(got.templates.sh[4..8], [[9.0; 3]; 4]);
        assert_eq!((got.templates.means[2], got.templates.quats[2]), ([18.0; 3], [18.0; 4]));
        assert_eq!(got.per_instance[Parameter::OffsetMeans].as_chunks::<3>().0, [[0.0; 3], [8.0; 3], [16.0; 3]]);
        assert_eq!(got.per_instance[Parameter::OffsetShDc], got.per_instance[Parameter::OffsetMeans]);
        assert_eq!(got.per_instance[Parameter::OffsetOpacityLogits], [0.0, 8.0, 16.0]);
        assert_eq!(got.instances, [[[3.0; 4]; 3], [[4.0; 4]; 3], [[24.0; 4]; 3]]);
        assert_eq!((&got.background.means[..], &got.background.sh[..]), (&[[32.0; 3]][..], &[[32.0; 3]][..]));
        // A culled pair adds nothing and shifts no index.
        gradients[1] = None;
        let got = gather_gradients(&scene, &gradients);
        assert_eq!(got.templates.opacity_logits, [4.0, 9.0, 16.0]);
        assert_eq!(got.background.opacity_logits, [32.0]);
    }
}
