//! Central differences of a rendered scene by any of its parameters, in f64: what the backward twins are held against.
//!
//! The loss is sum(cotangent * (r, g, b, alpha)) over all pixels. It is smooth only as long as no rule decides
//! otherwise: the same pairs in the same order in every pixel that has a cotangent, the same ones clamped to 0.99, the
//! same branches of the projection. `derivative` compares all of that at -h, 0 and +h and gives `None` where it differs.

use rayon::prelude::*;

use crate::math::similarity::Similarity;
use crate::reference::gather_gradients::{CloudGradient, SceneGradient};
use crate::reference::preprocess_instance_expand::{CullLimits, SourceGaussian, sources};
use crate::reference::preprocess_instance_expand_backward::{ProjectionBranches, projection_branches};
use crate::reference::splats_in_depth_order;
use crate::reference::tile_blend::{ALPHA_MAX, blend_row_with_pairs, candidate_boxes};
use crate::reference::view::View;
use crate::scene::instanced_scene::InstancedScene;

/// How far a parameter is moved: 2^-19, about 1.9e-6, in its own unit. The error of the difference is step^2 f''' / 6,
/// and f''' / f' reaches 10^6 where a splat close to the camera moves a thousand pixels per unit; the rounding of f64,
/// 1e-16 per pixel over the step, is far below. A power of two, since transforms are f32: their entries up to 32
/// in magnitude move by exactly this, and larger ones by what is then divided by.
pub const STEP: f64 = 1.0 / 524_288.0;

/// The two clouds of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Cloud {
    /// `InstancedScene::templates`.
    Templates,
    /// `InstancedScene::background`.
    Background,
}

/// The tensors of a scene.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Tensor {
    /// N x 3.
    Means(Cloud),
    /// N x 4.
    Quats(Cloud),
    /// N x 3.
    LogScales(Cloud),
    /// N x 1.
    OpacityLogits(Cloud),
    /// N x (C * 3).
    Sh(Cloud),
    /// M x 3.
    OffsetMeans,
    /// M x 3.
    OffsetShDc,
    /// M x 1.
    OffsetOpacityLogits,
    /// K x 12: rows of (A | t).
    WorldFromTemplate,
}

impl Tensor {
    /// Every tensor once.
    pub const ALL: [Self; 14] = [
        Self::Means(Cloud::Templates),
        Self::Quats(Cloud::Templates),
        Self::LogScales(Cloud::Templates),
        Self::OpacityLogits(Cloud::Templates),
        Self::Sh(Cloud::Templates),
        Self::Means(Cloud::Background),
        Self::Quats(Cloud::Background),
        Self::LogScales(Cloud::Background),
        Self::OpacityLogits(Cloud::Background),
        Self::Sh(Cloud::Background),
        Self::OffsetMeans,
        Self::OffsetShDc,
        Self::OffsetOpacityLogits,
        Self::WorldFromTemplate,
    ];

    /// Numbers per row.
    pub fn row_len(self, scene: &InstancedScene) -> usize {
        match self {
            Self::Means(_) | Self::LogScales(_) | Self::OffsetMeans | Self::OffsetShDc => 3,
            Self::Quats(_) => 4,
            Self::OpacityLogits(_) | Self::OffsetOpacityLogits => 1,
            Self::Sh(Cloud::Templates) => 3 * scene.templates.sh_coefficients(),
            Self::Sh(Cloud::Background) => 3 * scene.background.sh_coefficients(),
            Self::WorldFromTemplate => 12,
        }
    }

    /// The gradient of this tensor, flattened: entry `row * row_len + column`.
    pub fn of(self, gradient: &SceneGradient) -> &[f64] {
        let cloud = |cloud: Cloud| -> &CloudGradient {
            match cloud {
                Cloud::Templates => &gradient.templates,
                Cloud::Background => &gradient.background,
            }
        };
        match self {
            Self::Means(c) => cloud(c).means.as_flattened(),
            Self::Quats(c) => cloud(c).quats.as_flattened(),
            Self::LogScales(c) => cloud(c).log_scales.as_flattened(),
            Self::OpacityLogits(c) => &cloud(c).opacity_logits,
            Self::Sh(c) => cloud(c).sh.as_flattened(),
            Self::OffsetMeans => gradient.offsets.means.as_flattened(),
            Self::OffsetShDc => gradient.offsets.sh_dc.as_flattened(),
            Self::OffsetOpacityLogits => &gradient.offsets.opacity_logits,
            Self::WorldFromTemplate => gradient.instances.as_flattened().as_flattened(),
        }
    }
}

/// What is rendered, at one point of the parameter space.
#[derive(Debug)]
struct Evaluation {
    /// Per pixel; 0 without a cotangent.
    losses: Vec<f64>,
    /// Per pixel with a cotangent, front to back: flat index, and whether alpha is clamped.
    pairs: Vec<Vec<(u32, bool)>>,
    /// Of every projected source: flat index and branches.
    branches: Vec<(u32, ProjectionBranches)>,
}

/// Differentiates one scene in one view.
pub struct FiniteDifferences<'a> {
    scene: &'a InstancedScene,
    view: &'a View,
    cotangents: &'a [[f64; 4]],
    sources: Vec<SourceGaussian>,
    base: Evaluation,
}

impl<'a> FiniteDifferences<'a> {
    /// `cotangents` as in `blend_backward`; they should be 0 where a picture is not robust, or many derivatives will
    /// be `None`.
    pub fn new(scene: &'a InstancedScene, view: &'a View, cotangents: &'a [[f64; 4]]) -> Self {
        let sources = sources(scene);
        let base = evaluate(&sources, view, cotangents);
        Self { scene, view, cotangents, sources, base }
    }

    /// dL / d(entry `index` of the flattened tensor), or `None` if a rule decides otherwise within the step.
    pub fn derivative(&self, tensor: Tensor, index: usize) -> Option<f64> {
        let row_len = tensor.row_len(self.scene);
        let (row, column) = (index / row_len, index % row_len);
        let side = |step: f64| {
            let (sources, moved) = self.moved(tensor, row, column, step);
            (evaluate(&sources, self.view, self.cotangents), moved)
        };
        let ((plus, forth), (minus, back)) = (side(STEP), side(-STEP));
        let same = |e: &Evaluation| e.pairs == self.base.pairs && e.branches == self.base.branches;
        // Pixel by pixel, so that those that do not change leave no rounding.
        let difference: f64 = plus.losses.iter().zip(&minus.losses).map(|(p, m)| p - m).sum();
        (same(&plus) && same(&minus)).then(|| difference / (forth - back))
    }

    /// All sources after one parameter was moved, and by how much it was. A parameter that several instances share is
    /// moved in all of them.
    fn moved(&self, tensor: Tensor, row: usize, column: usize, step: f64) -> (Vec<SourceGaussian>, f64) {
        let mut out = self.sources.clone();
        let mut exact = step;
        for source in out.iter_mut().filter(|source| self.depends(source, tensor, row)) {
            match tensor {
                Tensor::Means(_) | Tensor::OffsetMeans => source.mean_template[column] += step,
                Tensor::Quats(_) => source.quat[column] += step,
                Tensor::LogScales(_) => source.log_scales[column] += step,
                Tensor::OpacityLogits(_) | Tensor::OffsetOpacityLogits => source.opacity_logit += step,
                Tensor::Sh(_) | Tensor::OffsetShDc => source.sh[column / 3][column % 3] += step,
                Tensor::WorldFromTemplate => {
                    let mut rows = source.world_from_template.rows();
                    let entry = &mut rows.as_flattened_mut()[column];
                    let before = f64::from(*entry);
                    *entry = (before + step) as f32;
                    exact = f64::from(*entry) - before;
                    source.world_from_template =
                        Similarity::from_rows(rows).expect("a small step is still a similarity");
                }
            }
        }
        (out, exact)
    }

    /// True if the source is made from that row of the tensor.
    fn depends(&self, source: &SourceGaussian, tensor: Tensor, row: usize) -> bool {
        let (instance, local) = (self.scene.instances.get(source.instance as usize), source.local_index as usize);
        match tensor {
            Tensor::Means(cloud)
            | Tensor::Quats(cloud)
            | Tensor::LogScales(cloud)
            | Tensor::OpacityLogits(cloud)
            | Tensor::Sh(cloud) => match instance {
                Some(instance) => {
                    let range = self.scene.template_ranges[instance.template as usize];
                    cloud == Cloud::Templates && range.first as usize + local == row
                }
                None => cloud == Cloud::Background && local == row,
            },
            Tensor::OffsetMeans | Tensor::OffsetShDc | Tensor::OffsetOpacityLogits => {
                instance.and_then(|i| i.first_offset).is_some_and(|first| first as usize + local == row)
            }
            Tensor::WorldFromTemplate => instance.is_some() && source.instance as usize == row,
        }
    }
}

/// Renders and takes down every decision that matters.
fn evaluate(sources: &[SourceGaussian], view: &View, cotangents: &[[f64; 4]]) -> Evaluation {
    let splats = splats_in_depth_order(sources, view, &CullLimits::exact(view));
    let boxes = candidate_boxes(view, &splats);
    let row = |y: u32| {
        let first = y as usize * view.width as usize;
        let pixels = blend_row_with_pairs(view, &splats, &boxes, y);
        pixels.into_iter().zip(&cotangents[first..]).map(|((pixel, pairs), cotangent)| {
            let [r, g, b] = pixel.color.to_array();
            let loss = [r, g, b, pixel.alpha].iter().zip(cotangent).map(|(v, c)| v * c).sum();
            let counts = cotangent.iter().any(|&c| c != 0.0);
            let pairs: Vec<_> = pairs.iter().map(|p| (splats[p.splat].flat_index, p.alpha_raw > ALPHA_MAX)).collect();
            (loss, if counts { pairs } else { Vec::new() })
        })
    };
    let rows: Vec<Vec<(f64, Vec<(u32, bool)>)>> = (0..view.height).into_par_iter().map(|y| row(y).collect()).collect();
    let (losses, pairs) = rows.into_iter().flatten().unzip();
    let branches =
        splats.iter().map(|s| (s.flat_index, projection_branches(view, &sources[s.flat_index as usize]))).collect();
    Evaluation { losses, pairs, branches }
}
