//! The prims of a scene, whatever kind of file they are written to.

use std::ops::Range;

use glam::{DMat3, DMat4};

use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::instanced_scene::{Instance, InstancedScene, SourceRange};
use instgs_vk::scene::{Gaussians, InstanceLabel};

/// Type of the prims that hold Gaussians.
pub(super) const SPLATS: &str = "ParticleField3DGaussianSplat";
/// Name of the class that holds templates, and of the root that is drawn.
pub(super) const TEMPLATES: &str = "templates";
pub(super) const SCENE: &str = "scene";
/// API schema and attribute of a prim's semantic label.
pub(super) const LABEL_SCHEMA: &str = "SemanticsLabelsAPI:class";
pub(super) const LABEL: &str = "semantics:labels:class";
/// The only transform that prims have, and the attribute that names it.
pub(super) const TRANSFORM: &str = "xformOp:transform";
pub(super) const TRANSFORM_ORDER: &str = "xformOpOrder";
/// Attributes of Gaussians.
pub(super) const SH_DEGREE: &str = "radiance:sphericalHarmonicsDegree";
pub(super) const SH: &str = "radiance:sphericalHarmonicsCoefficients";

/// All prims.
pub(super) struct Layer<'a> {
    /// Below `/templates`, a class.
    pub(super) templates: Vec<Prim<'a>>,
    /// Of `/scene`, from its prims to a world with y up.
    pub(super) transform: DMat4,
    /// Below `/scene`.
    pub(super) prims: Vec<Prim<'a>>,
}

/// A prim of Gaussians.
pub(super) struct Prim<'a> {
    pub(super) name: String,
    /// The template below `/templates` that the prim is a reference to.
    pub(super) template: Option<String>,
    /// Semantic label, without control characters.
    pub(super) label: Option<String>,
    /// From the prim's frame to that of `/scene`.
    pub(super) transform: Option<DMat4>,
    /// The prim's own Gaussians, unless it is a reference.
    pub(super) cloud: Option<Rows<'a>>,
}

/// Some Gaussians of a cloud.
pub(super) struct Rows<'a> {
    cloud: &'a Gaussians,
    rows: Range<usize>,
}

/// Every instance's Gaussians in its own frame, offsets and colours included.
pub(super) struct InFrames {
    pub(super) cloud: Gaussians,
    /// First Gaussian of each instance.
    firsts: Vec<usize>,
}

impl InFrames {
    pub(super) fn of(scene: &InstancedScene) -> Self {
        let here = |instance: &Instance| Instance { world_from_template: Similarity::IDENTITY, ..instance.clone() };
        let instances = scene.instances.iter().map(here).collect();
        let cloud = InstancedScene { instances, ..scene.clone() }.flatten();
        let mut firsts = vec![0];
        for (k, instance) in scene.instances.iter().enumerate() {
            let count = scene.template_ranges[instance.template as usize].count + scene.own_range(k).count;
            firsts.push(firsts[k] + count as usize);
        }
        Self { cloud, firsts }
    }
}

fn template_name(template: usize) -> String {
    format!("template_{template}")
}

impl<'a> Layer<'a> {
    /// The prims of a valid scene; `turn` maps its up to +y.
    pub(super) fn of(scene: &'a InstancedScene, local: &'a InFrames, turn: DMat3) -> Self {
        let is_referenced = |template: usize| {
            let mut instances = scene.instances.iter().enumerate();
            instances.any(|(k, instance)| instance.template as usize == template && scene.looks_like_template(k))
        };
        let template = |(template, &SourceRange { first, count }): (usize, &SourceRange)| Prim {
            name: template_name(template),
            template: None,
            label: None,
            transform: None,
            cloud: Some(Rows { cloud: &scene.templates, rows: first as usize..(first + count) as usize }),
        };
        let ranges = scene.template_ranges.iter().enumerate().filter(|&(template, _)| is_referenced(template));
        let labels = scene.instance_labels();
        let mut prims: Vec<Prim<'a>> =
            labels.iter().enumerate().map(|(k, label)| instance(scene, k, label, local)).collect();
        if !scene.background.is_empty() {
            let rows = 0..scene.background.len();
            prims.push(Prim {
                name: "background".into(),
                template: None,
                label: None,
                transform: None,
                cloud: Some(Rows { cloud: &scene.background, rows }),
            });
        }
        Self { templates: ranges.map(template).collect(), transform: DMat4::from_mat3(turn), prims }
    }
}

fn instance<'a>(scene: &'a InstancedScene, k: usize, label: &InstanceLabel, local: &'a InFrames) -> Prim<'a> {
    let kind = label.group.and_then(|group| scene.groups[group].name.as_ref());
    let instance = &scene.instances[k];
    let plain = scene.looks_like_template(k);
    let placement = &instance.world_from_template;
    let mut transform = DMat4::from_mat3(placement.linear());
    transform.w_axis = placement.translation().extend(1.0);
    let rows = local.firsts[k]..local.firsts[k + 1];
    Prim {
        name: format!("instance_{k}"),
        template: plain.then(|| template_name(instance.template as usize)),
        label: kind.map(|kind| kind.chars().filter(|c| !c.is_control()).collect()),
        transform: Some(transform),
        cloud: (!plain).then_some(Rows { cloud: &local.cloud, rows }),
    }
}

impl Rows<'_> {
    pub(super) fn sh_degree(&self) -> u32 {
        self.cloud.sh_degree
    }

    pub(super) fn positions(&self) -> &[[f32; 3]] {
        &self.cloud.means[self.rows.clone()]
    }

    /// Unit quaternions w x y z.
    pub(super) fn orientations(&self) -> Vec<[f32; 4]> {
        let unit = |q: &[f32; 4]| {
            let length = q.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
            q.map(|v| (f64::from(v) / length) as f32)
        };
        self.cloud.quats[self.rows.clone()].iter().map(unit).collect()
    }

    /// Standard deviations along the axes.
    pub(super) fn scales(&self) -> Vec<[f32; 3]> {
        self.cloud.log_scales[self.rows.clone()].iter().map(|s| s.map(f32::exp)).collect()
    }

    /// From 0 to 1.
    pub(super) fn opacities(&self) -> Vec<f32> {
        let sigmoid = |&logit: &f32| (1.0 / (1.0 + (-f64::from(logit)).exp())) as f32;
        self.cloud.opacity_logits[self.rows.clone()].iter().map(sigmoid).collect()
    }

    /// All coefficients of one Gaussian after the other.
    pub(super) fn sh(&self) -> &[[f32; 3]] {
        let c = self.cloud.sh_coefficients();
        &self.cloud.sh[self.rows.start * c..self.rows.end * c]
    }
}

/// The columns of a matrix as rows: USD multiplies rows by matrices.
pub(super) fn rows_of(matrix: &DMat4) -> [[f64; 4]; 4] {
    matrix.to_cols_array_2d()
}
