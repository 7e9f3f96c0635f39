//! Central differences of a rendered scene with respect to any of its parameters, in f64: the reference for the
//! backward twins.
//!
//! The loss is sum(cotangent * (r, g, b, alpha)) over all pixels. It is smooth only while no discrete decision changes:
//! the same pairs in the same order in every pixel that has a cotangent (so that it ends at the same splat), the same
//! pairs clamped to 0.99, the same branches of the projection. `derivative` compares all of these at -h, 0 and +h and
//! returns `None` if any differs.

use std::ops::Range;

use glam::DVec3;
use rayon::prelude::*;

use crate::gather_gradients::{CloudGradient, SceneGradient};
use crate::in_depth_order;
use crate::poses::rotation_of_vector;
use crate::preprocess_instance_expand::{CullLimits, ProjectedSplat, SourceGaussian, project, sources};
use crate::preprocess_instance_expand_backward::{ProjectionBranches, projection_branches};
use crate::tile_blend::{ALPHA_MAX, BlendedPair, blend_row_with_pairs, candidate_boxes};
use crate::view::View;
use instgs_vk::math::covariance::{quat_from_rotation, quat_multiply};
use instgs_vk::math::sh::ShRotation;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::instanced_scene::InstancedScene;
use instgs_vk::scene::parameters::{Owner, Parameter};

/// The step h of a parameter: 2^-19, about 1.9e-6, in its own unit. The error of the difference is h^2 f''' / 6, and
/// f''' / f' reaches 10^6 where a splat close to the camera moves a thousand pixels per unit; f64's rounding, 1e-16 per
/// pixel divided by h, is far smaller. It is a power of two because transforms are f32: entries up to 32 in magnitude
/// move by exactly h, and for larger ones the difference is divided by the actual movement.
pub const STEP: f64 = 1.0 / 524_288.0;

/// The clouds of a scene that have parameters.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cloud {
    /// The cloud `InstancedScene::templates`.
    Templates,
    /// The cloud `InstancedScene::own`.
    Own,
    /// The cloud `InstancedScene::background`.
    Background,
}

/// The parameter tensors of a scene, for C SH coefficients, M offset records and K instances.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tensor {
    /// Centres of N Gaussians, N x 3.
    Means(Cloud),
    /// Quaternions as stored, N x 4.
    Quats(Cloud),
    /// Logarithms of the standard deviations, N x 3.
    LogScales(Cloud),
    /// Logits of the opacities, N x 1.
    OpacityLogits(Cloud),
    /// SH coefficients, N x (C * 3).
    Sh(Cloud),
    /// Offsets or colour matrices, or nothing: rows of the parameter, all coefficients of a record together.
    PerInstance(Parameter),
    /// Instance transforms, K x 12: rows of (A | t).
    WorldFromTemplate,
    /// Pose steps of instances, K x 7: see `poses`.
    Poses,
}

impl Tensor {
    /// Every tensor, each once.
    pub const ALL: [Self; 24] = [
        Self::Means(Cloud::Templates),
        Self::Quats(Cloud::Templates),
        Self::LogScales(Cloud::Templates),
        Self::OpacityLogits(Cloud::Templates),
        Self::Sh(Cloud::Templates),
        Self::Means(Cloud::Own),
        Self::Quats(Cloud::Own),
        Self::LogScales(Cloud::Own),
        Self::OpacityLogits(Cloud::Own),
        Self::Sh(Cloud::Own),
        Self::Means(Cloud::Background),
        Self::Quats(Cloud::Background),
        Self::LogScales(Cloud::Background),
        Self::OpacityLogits(Cloud::Background),
        Self::Sh(Cloud::Background),
        Self::PerInstance(Parameter::OffsetMeans),
        Self::PerInstance(Parameter::OffsetShDc),
        Self::PerInstance(Parameter::OffsetOpacityLogits),
        Self::PerInstance(Parameter::OffsetShRest),
        Self::PerInstance(Parameter::OffsetLogScales),
        Self::PerInstance(Parameter::OffsetQuats),
        Self::WorldFromTemplate,
        Self::Poses,
        Self::PerInstance(Parameter::ColorFromTemplate),
    ];

    /// Number of values per row.
    pub fn row_len(self, scene: &InstancedScene) -> usize {
        match self {
            Self::Means(_) | Self::LogScales(_) => 3,
            Self::Quats(_) => 4,
            Self::OpacityLogits(_) => 1,
            Self::Sh(Cloud::Templates) => 3 * scene.templates.sh_coefficients(),
            Self::Sh(Cloud::Own) => 3 * scene.own.sh_coefficients(),
            Self::Sh(Cloud::Background) => 3 * scene.background.sh_coefficients(),
            Self::PerInstance(Parameter::OffsetShRest) => 3 * scene.offsets.rest_coefficients(),
            Self::PerInstance(parameter) => parameter.width(),
            Self::WorldFromTemplate => 12,
            Self::Poses => 7,
        }
    }

    /// The gradient of this tensor, flattened: entry `row * row_len + column`.
    pub fn of(self, gradient: &SceneGradient) -> &[f64] {
        let cloud = |cloud: Cloud| -> &CloudGradient {
            match cloud {
                Cloud::Templates => &gradient.templates,
                Cloud::Own => &gradient.own,
                Cloud::Background => &gradient.background,
            }
        };
        match self {
            Self::Means(c) => cloud(c).means.as_flattened(),
            Self::Quats(c) => cloud(c).quats.as_flattened(),
            Self::LogScales(c) => cloud(c).log_scales.as_flattened(),
            Self::OpacityLogits(c) => &cloud(c).opacity_logits,
            Self::Sh(c) => cloud(c).sh.as_flattened(),
            Self::PerInstance(parameter) => &gradient.per_instance[parameter],
            Self::WorldFromTemplate => gradient.instances.as_flattened().as_flattened(),
            Self::Poses => gradient.poses.as_flattened(),
        }
    }
}

/// One row of pixels, rendered with one set of parameters.
#[derive(Clone, Debug, PartialEq)]
struct Row {
    /// Loss per pixel; 0 without a cotangent.
    losses: Vec<f64>,
    /// Per pixel with a cotangent, its pairs front to back: flat index, and whether alpha is clamped.
    pairs: Vec<Vec<(u32, bool)>>,
}

/// The splats of the scene after one parameter was moved.
struct Moved {
    /// All splats, in depth order.
    splats: Vec<ProjectedSplat>,
    /// Flat index and branches of each drawn source that depends on the parameter.
    branches: Vec<(u32, ProjectionBranches)>,
    /// Actual movement of the parameter.
    by: f64,
}

/// Differentiates the rendering of one scene in one view.
pub struct FiniteDifferences<'a> {
    scene: &'a InstancedScene,
    view: &'a View,
    cotangents: &'a [[f64; 4]],
    sources: Vec<SourceGaussian>,
    /// Projection of every source; `None` if it is culled.
    projected: Vec<Option<ProjectedSplat>>,
    rows: Vec<Row>,
}

impl<'a> FiniteDifferences<'a> {
    /// Prepares derivatives in `view`. `cotangents` are as in `blend_backward`; they should be 0 where a picture is not
    /// robust, or many derivatives will be `None`.
    pub fn new(scene: &'a InstancedScene, view: &'a View, cotangents: &'a [[f64; 4]]) -> Self {
        let sources = sources(scene);
        let projected: Vec<_> = sources.iter().map(|s| project(view, s, &CullLimits::exact(view))).collect();
        let mut out = Self { scene, view, cotangents, sources, projected, rows: Vec::new() };
        let splats = in_depth_order(out.projected.iter().flatten().cloned().collect());
        out.rows = out.render_rows(&splats, 0..view.height);
        out
    }

    /// dL / d(entry `index` of the flattened tensor), or `None` if a discrete decision changes within the step.
    pub fn derivative(&self, tensor: Tensor, index: usize) -> Option<f64> {
        let row_len = tensor.row_len(self.scene);
        let (row, column) = (index / row_len, index % row_len);
        let users: Vec<usize> = (0..self.sources.len()).filter(|&i| self.depends(i, tensor, row)).collect();
        let [minus, zero, plus] = [-STEP, 0.0, STEP].map(|step| self.moved(&users, tensor, column, step));
        // Rows that none of the moved splats reaches do not change.
        let reached = [&minus, &zero, &plus].map(|moved| self.rows_reached(&moved.splats, &users));
        let rows = reached.iter().map(|r| r.start).min()?..reached.iter().map(|r| r.end).max()?;
        let base = &self.rows[rows.start.min(rows.end) as usize..rows.end as usize];
        let [before, after] = [&minus, &plus].map(|moved| self.render_rows(&moved.splats, rows.clone()));
        let same_pairs = |rows: &[Row]| rows.iter().zip(base).all(|(row, base)| row.pairs == base.pairs);
        let same = minus.branches == zero.branches
            && plus.branches == zero.branches
            && same_pairs(&before)
            && same_pairs(&after);
        // Subtracted per pixel, so that unchanged pixels add no rounding.
        let losses = |rows: Vec<Row>| rows.into_iter().flat_map(|row| row.losses);
        let difference: f64 = losses(after).zip(losses(before)).map(|(a, b)| a - b).sum();
        same.then(|| if users.is_empty() { 0.0 } else { difference / (plus.by - minus.by) })
    }

    /// The splats after one parameter was moved. A shared parameter moves in all instances that use it.
    fn moved(&self, users: &[usize], tensor: Tensor, column: usize, step: f64) -> Moved {
        let mut projected = self.projected.clone();
        let (mut branches, mut by) = (Vec::new(), step);
        for &i in users {
            let mut source = self.sources[i].clone();
            by = move_parameter(&mut source, tensor, column, step);
            projected[i] = project(self.view, &source, &CullLimits::exact(self.view));
            if projected[i].is_some() {
                branches.push((i as u32, projection_branches(self.view, &source)));
            }
        }
        Moved { splats: in_depth_order(projected.into_iter().flatten().collect()), branches, by }
    }

    /// The range of pixel rows to which splats of `users` (ascending) may contribute.
    fn rows_reached(&self, splats: &[ProjectedSplat], users: &[usize]) -> Range<u32> {
        let boxes = candidate_boxes(self.view, splats);
        let reached = splats.iter().zip(boxes).filter(|(s, _)| users.binary_search(&(s.flat_index as usize)).is_ok());
        reached.fold(self.view.height..0, |rows, (_, [_, _, y0, y1])| rows.start.min(y0)..rows.end.max(y1))
    }

    /// Renders rows of pixels and records every discrete decision.
    fn render_rows(&self, splats: &[ProjectedSplat], rows: Range<u32>) -> Vec<Row> {
        let boxes = candidate_boxes(self.view, splats);
        let render_row = |y: u32| {
            let pixels = blend_row_with_pairs(self.view, splats, &boxes, y);
            let cotangents = &self.cotangents[y as usize * self.view.width as usize..];
            let (losses, pairs) = pixels
                .into_iter()
                .zip(cotangents)
                .map(|((pixel, pairs), cotangent)| {
                    let [r, g, b] = pixel.color.to_array();
                    let loss: f64 = [r, g, b, pixel.alpha].iter().zip(cotangent).map(|(v, c)| v * c).sum();
                    let counts = cotangent.iter().any(|&c| c != 0.0);
                    let pair = |p: &BlendedPair| (splats[p.splat].flat_index, p.alpha_raw > ALPHA_MAX);
                    (loss, if counts { pairs.iter().map(pair).collect() } else { Vec::new() })
                })
                .unzip();
            Row { losses, pairs }
        };
        rows.into_par_iter().map(render_row).collect()
    }

    /// True if source `i` depends on the given row of the tensor.
    fn depends(&self, i: usize, tensor: Tensor, row: usize) -> bool {
        let source = &self.sources[i];
        let k = source.instance as usize;
        let (instance, local) = (self.scene.instances.get(k), source.local_index as usize);
        let template = instance.map(|i| self.scene.template_ranges[i.template as usize]).unwrap_or_default();
        // After the template's Gaussians come the instance's own.
        let of_own = local.checked_sub(template.count as usize);
        match tensor {
            Tensor::Means(cloud)
            | Tensor::Quats(cloud)
            | Tensor::LogScales(cloud)
            | Tensor::OpacityLogits(cloud)
            | Tensor::Sh(cloud) => match instance {
                Some(_) => match of_own {
                    Some(own) => cloud == Cloud::Own && self.scene.own_range(k).first as usize + own == row,
                    None => cloud == Cloud::Templates && template.first as usize + local == row,
                },
                None => cloud == Cloud::Background && local == row,
            },
            Tensor::PerInstance(parameter) if parameter.owner() == Owner::Offset => {
                let first = instance.and_then(|i| i.first_offset).filter(|_| of_own.is_none());
                first.is_some_and(|first| first as usize + local == row)
            }
            Tensor::PerInstance(_) => instance.is_some() && of_own.is_none() && k == row,
            Tensor::WorldFromTemplate | Tensor::Poses => instance.is_some() && k == row,
        }
    }
}

/// Moves one parameter of a source by about `step`; returns the actual movement.
fn move_parameter(source: &mut SourceGaussian, tensor: Tensor, column: usize, step: f64) -> f64 {
    match tensor {
        Tensor::Means(_) | Tensor::PerInstance(Parameter::OffsetMeans) => source.mean_template[column] += step,
        Tensor::Quats(_) | Tensor::PerInstance(Parameter::OffsetQuats) => source.quat[column] += step,
        Tensor::LogScales(_) | Tensor::PerInstance(Parameter::OffsetLogScales) => source.log_scales[column] += step,
        Tensor::OpacityLogits(_) | Tensor::PerInstance(Parameter::OffsetOpacityLogits) => source.opacity_logit += step,
        Tensor::Sh(_) | Tensor::PerInstance(Parameter::OffsetShDc) => source.sh[column / 3][column % 3] += step,
        Tensor::PerInstance(Parameter::OffsetShRest) => source.sh[1 + column / 3][column % 3] += step,
        Tensor::PerInstance(Parameter::ColorFromTemplate) => {
            source.color_from_template.iter_mut().for_each(|rows| rows.as_flattened_mut()[column] += step);
        }
        Tensor::PerInstance(_) => unreachable!("source Gaussians have other tensors"),
        Tensor::WorldFromTemplate => {
            let mut rows = source.world_from_template.rows();
            let entry = &mut rows.as_flattened_mut()[column];
            let before = f64::from(*entry);
            *entry = (before + step) as f32;
            let exact = f64::from(*entry) - before;
            source.world_from_template = Similarity::from_rows(rows).expect("a small step is still a similarity");
            return exact;
        }
        Tensor::Poses => move_pose(source, column, step),
    }
    step
}

/// Moves, rotates or scales a source in the template's frame, in f64, since the transform itself would round to f32.
/// The Gaussian's SH is rotated too.
fn move_pose(source: &mut SourceGaussian, column: usize, step: f64) {
    let axis = [DVec3::X, DVec3::Y, DVec3::Z][column % 3];
    match column {
        0..3 => source.mean_template += step * axis,
        3..6 => {
            let rotation = rotation_of_vector(step * axis);
            source.mean_template = rotation * source.mean_template;
            source.quat = quat_multiply(quat_from_rotation(rotation), source.quat);
            source.sh = ShRotation::new(rotation).rotate(&source.sh);
        }
        _ => {
            source.mean_template *= step.exp();
            source.log_scales += step;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::view::RenderOptions;
    use instgs_vk::math::covariance::logit;
    use instgs_vk::math::sh::SH_C0;
    use instgs_vk::scene::camera::Camera;
    use instgs_vk::scene::gaussians::Gaussians;

    /// Gray Gaussians of standard deviation 0.1 in the middle of a 9x9 picture, one behind the other, given as
    /// (opacity, SH coefficient).
    fn scene(gaussians: &[(f64, f64)]) -> InstancedScene {
        let n = gaussians.len();
        InstancedScene::from_cloud(Gaussians {
            sh_degree: 0,
            means: (0..n).map(|i| [0.0, 0.0, 1.0 + 0.1 * i as f32]).collect(),
            quats: vec![[1.0, 0.0, 0.0, 0.0]; n],
            log_scales: vec![[0.1f32.ln(); 3]; n],
            opacity_logits: gaussians.iter().map(|g| logit(g.0) as f32).collect(),
            sh: gaussians.iter().map(|g| [g.1 as f32; 3]).collect(),
        })
    }

    /// The derivative with respect to entry 0 of a tensor of the background.
    fn derivative(scene: &InstancedScene, tensor: Tensor) -> Option<f64> {
        let camera = Camera::look_at("c", DVec3::ZERO, DVec3::Z, DVec3::Y, 1.0, (9, 9));
        let view = View::exact(&camera, &RenderOptions::default());
        FiniteDifferences::new(scene, &view, &[[1.0; 4]; 81]).derivative(tensor, 0)
    }

    /// Each scene is at a discontinuity in one tensor, to the last bit of f32, and is smooth in the other.
    #[test]
    fn edges_give_no_derivative() {
        let (logit, sh) = (Tensor::OpacityLogits(Cloud::Background), Tensor::Sh(Cloud::Background));
        let plain = scene(&[(0.5, 0.3)]);
        assert!(derivative(&plain, logit).is_some() && derivative(&plain, sh).is_some());
        let clamped_alpha = scene(&[(0.99, 0.3)]);
        assert!(derivative(&clamped_alpha, logit).is_none() && derivative(&clamped_alpha, sh).is_some());
        let clamped_color = scene(&[(0.5, -0.5 / SH_C0)]);
        assert!(derivative(&clamped_color, sh).is_none() && derivative(&clamped_color, logit).is_some());
        let skipped = scene(&[(1.0 / 255.0, 0.3)]);
        assert!(derivative(&skipped, logit).is_none());
        // T = 0.5, 0.01 times that, and with opacity 0.98 exactly 1e-4 behind the third.
        let stopped = scene(&[(0.5, 0.3), (0.999, 0.3), (0.98, 0.3), (0.5, 0.3)]);
        assert!(derivative(&stopped, logit).is_none() && derivative(&stopped, sh).is_some());
    }

    /// By hand: without clamping the picture is linear in the SH coefficient, with a slope of C0 times the sum of the
    /// pixels' alpha.
    #[test]
    fn a_linear_parameter_has_its_slope() {
        let plain = scene(&[(0.5, 0.3)]);
        let camera = Camera::look_at("c", DVec3::ZERO, DVec3::Z, DVec3::Y, 1.0, (9, 9));
        let view = View::exact(&camera, &RenderOptions::default());
        let alpha: f64 = crate::render_sources(&sources(&plain), &view).alpha.iter().sum();
        let got = derivative(&plain, Tensor::Sh(Cloud::Background)).unwrap();
        assert!((got - SH_C0 * alpha).abs() < 1e-8, "{got} {alpha}");
    }
}
