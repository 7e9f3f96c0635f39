//! The only scene type: templates, instances with offsets, and a background. A plain cloud has only a background.

use std::borrow::Cow;
use std::collections::BTreeMap;

use crate::math::similarity::Similarity;
use crate::scene::gaussians::{Gaussians, sh_coefficients};
use crate::scene::lod::{FittedLevel, NO_NEXT_CELL};
use crate::scene::near_plane::NearPlane;
use crate::scene::offsets::Offsets;
use crate::scene::pixel_filter::PixelFilter;

/// A range of a pool of Gaussians: a template, or what an instance has of its own.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SourceRange {
    /// Index of its first Gaussian in the pool.
    pub first: u32,
    /// Number of its Gaussians.
    pub count: u32,
}

impl SourceRange {
    /// Indices into the pool.
    pub fn indices(self) -> std::ops::Range<usize> {
        self.first as usize..self.first as usize + self.count as usize
    }

    /// True if the two ranges have a Gaussian in common.
    pub fn overlaps(self, other: Self) -> bool {
        let is_either_empty = self.count == 0 || other.count == 0;
        !is_either_empty && self.first < other.first + other.count && other.first < self.first + self.count
    }
}

/// One placed copy of a template.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Index into `InstancedScene::template_ranges`.
    pub template: u32,
    /// The similarity that maps the template's frame to the world.
    pub world_from_template: Similarity,
    /// Index of the instance's first record in `InstancedScene::offsets`; `None` without offsets.
    pub first_offset: Option<u32>,
}

/// Name and mask ids of a group of instances, as in `groups.json`; kept in files, not used for rendering.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Group {
    /// Index of the template that the group uses.
    pub template_id: u32,
    /// Name of the kind of object, for instance "chair".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Mask ids of the group's instances, in instance order.
    pub instance_ids: Vec<u32>,
}

/// How the colour of an instance follows from that of its template: rows of (M | b), colour = M rgb + b, before the clamp
/// at 0. Like the SH coefficients it is for colours in the encoding of the training images.
pub type ColorMatrix = [[f32; 4]; 3];

/// The matrix that changes no colour.
pub const SAME_COLOR: ColorMatrix = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0]];

/// A tensor that this version does not know; it is preserved when the scene is written again.
#[derive(Clone, Debug, PartialEq)]
pub struct ForeignTensor {
    /// Element type in safetensors' notation, for instance "F32".
    pub dtype: String,
    /// Dimensions of the tensor.
    pub shape: Vec<usize>,
    /// Contents, little-endian, row major.
    pub bytes: Vec<u8>,
}

/// All that is rendered, trained or stored. The flat order of Gaussians, which breaks ties in depth, is: instances in
/// file order, each in template order and then its own Gaussians, then the background.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InstancedScene {
    /// All templates' Gaussians, concatenated, each in its own template's frame.
    pub templates: Gaussians,
    /// One range of `templates` for each template.
    pub template_ranges: Vec<SourceRange>,
    /// The placed copies of templates.
    pub instances: Vec<Instance>,
    /// How each instance's colours follow from its template's, offsets included; empty if they are the same in all.
    pub color_from_template: Vec<ColorMatrix>,
    /// Gaussians that only some instances have, each in the frame of its instance's template, of the templates' SH degree.
    /// Offsets and colour matrices do not change them.
    pub own: Gaussians,
    /// By instance, its own Gaussians in `own`; empty if no instance has any. Instances may share a range.
    pub own_ranges: Vec<SourceRange>,
    /// Offset records; instances hold the index of their first one.
    pub offsets: Offsets,
    /// World-frame Gaussians that belong to no instance.
    pub background: Gaussians,
    /// Optimised levels of detail of its templates, in any order; templates without use merged ones.
    pub fitted_levels: Vec<FittedLevel>,
    /// The pixel filter that the scene was trained with; renderers should use it.
    pub pixel_filter: PixelFilter,
    /// The near plane that the scene was trained with; renderers should use it.
    pub near_plane: NearPlane,
    /// Groups of instances with names and mask ids.
    pub groups: Vec<Group>,
    /// Where the scene came from, free text.
    pub source: String,
    /// Unknown tensors of the file this scene was read from.
    pub foreign_tensors: BTreeMap<String, ForeignTensor>,
    /// Unknown metadata strings of the file this scene was read from.
    pub foreign_metadata: BTreeMap<String, String>,
}

/// Why a scene is inconsistent. The message names the `.instgs` tensor at fault.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{tensor}: {reason}")]
pub struct SceneError {
    /// Tensor name as in the `.instgs` format, for instance "instance.template".
    pub tensor: String,
    /// What is inconsistent, one sentence.
    pub reason: String,
}

impl InstancedScene {
    /// A scene of a plain 3DGS cloud, which becomes the background.
    pub fn from_cloud(background: Gaussians) -> Self {
        Self { background, ..Self::default() }
    }

    /// The SH degree that the renderer evaluates: the larger one of templates and background.
    pub fn sh_degree(&self) -> u32 {
        self.templates.sh_degree.max(self.background.sh_degree)
    }

    /// Number of stored Gaussians: of templates, instances' own, and background.
    pub fn source_len(&self) -> usize {
        self.templates.len() + self.own.len() + self.background.len()
    }

    /// True if another template has some of the Gaussians of template `t`.
    pub fn shares_gaussians(&self, t: usize) -> bool {
        self.template_ranges.iter().filter(|other| self.template_ranges[t].overlaps(**other)).count() > 1
    }

    /// The own Gaussians of instance `k`.
    pub fn own_range(&self, k: usize) -> SourceRange {
        self.own_ranges.get(k).copied().unwrap_or_default()
    }

    /// True if instance `k` looks as its template does: without offsets, Gaussians of its own and a colour matrix.
    pub fn looks_like_template(&self, k: usize) -> bool {
        self.instances[k].first_offset.is_none()
            && self.own_range(k).count == 0
            && self.color_matrix(k).is_none_or(|matrix| *matrix == SAME_COLOR)
    }

    /// Number of Gaussians after expanding every instance, the background included.
    pub fn expanded_len(&self) -> u64 {
        let instanced: u64 =
            self.instances.iter().map(|i| u64::from(self.template_ranges[i.template as usize].count)).sum();
        let own: u64 = self.own_ranges.iter().map(|range| u64::from(range.count)).sum();
        instanced + own + self.background.len() as u64
    }

    /// Size of the scene tensors as f32, bytes: what `bench` reports as `bytes.host`.
    pub fn tensor_bytes(&self) -> u64 {
        // First and count per range.
        self.templates.tensor_bytes()
            + self.own.tensor_bytes()
            + self.background.tensor_bytes()
            + self.fitted_levels.iter().map(|level| level.gaussians.tensor_bytes()).sum::<u64>()
            + self.offsets.tensor_bytes()
            + self.instance_bytes() * self.instances.len() as u64
            + 8 * self.template_ranges.len() as u64
    }

    /// The colour matrix of instance `k`; `None` if its colours are its template's.
    pub fn color_matrix(&self, k: usize) -> Option<&ColorMatrix> {
        self.color_from_template.get(k)
    }

    /// Checks every index and array length.
    ///
    /// # Errors
    /// Names the first inconsistent tensor.
    pub fn validate(&self) -> Result<(), SceneError> {
        let fail = |tensor: &str, reason: String| Err(SceneError { tensor: tensor.into(), reason });
        for (name, cloud) in [("template", &self.templates), ("own", &self.own), ("background", &self.background)] {
            if let Some((field, len, want)) = cloud.wrong_length() {
                return fail(&format!("{name}.{field}"), format!("{len} entries, but {name}.means requires {want}"));
            }
        }
        let m = self.offsets.len();
        for (field, len) in [("sh_dc", self.offsets.sh_dc.len()), ("opacity_logits", self.offsets.opacity_logits.len())]
        {
            if len != m {
                return fail(&format!("offset.{field}"), format!("{len} entries where offset.means has {m}"));
            }
        }
        let rest = self.offsets.sh_rest.len();
        if !(0..=self.templates.sh_degree).any(|degree| rest == m * (sh_coefficients(degree) - 1)) {
            let degree = self.templates.sh_degree;
            return fail(
                "offset.sh_rest",
                format!("{rest} entries for {m} records, not those of a degree up to {degree}"),
            );
        }
        for (field, len, want) in
            [("log_scales", self.offsets.log_scales.len(), m), ("quats", self.offsets.quats.len(), m)]
        {
            if len != want && len != 0 {
                return fail(&format!("offset.{field}"), format!("{len} entries instead of {want} or none"));
            }
        }
        for (g, range) in self.template_ranges.iter().enumerate() {
            let end = u64::from(range.first) + u64::from(range.count);
            if end > self.templates.len() as u64 {
                let n = self.templates.len();
                return fail(
                    "template.ranges",
                    format!("range {g} ends at {end}, but there are {n} template Gaussians"),
                );
            }
        }
        let (matrices, instances) = (self.color_from_template.len(), self.instances.len());
        if matrices != 0 && matrices != instances {
            let reason = format!("{matrices} entries where {instances}, or none, fit");
            return fail("instance.color_from_template", reason);
        }
        self.validate_own()?;
        self.validate_levels()?;
        let finite = |matrix: &ColorMatrix| matrix.as_flattened().iter().all(|v| v.is_finite());
        if let Some(k) = self.color_from_template.iter().position(|matrix| !finite(matrix)) {
            return fail("instance.color_from_template", format!("that of instance {k} is not finite"));
        }
        for (k, instance) in self.instances.iter().enumerate() {
            let Some(range) = self.template_ranges.get(instance.template as usize) else {
                let count = self.template_ranges.len();
                return fail(
                    "instance.template",
                    format!("instance {k} uses template {}, but there are {count}", instance.template),
                );
            };
            if let Some(first) = instance.first_offset {
                let end = u64::from(first) + u64::from(range.count);
                if end > m as u64 {
                    return fail(
                        "instance.first_offset",
                        format!("offsets of instance {k} end at {end}, but there are {m}"),
                    );
                }
            }
        }
        Ok(())
    }

    /// The same scene with own Gaussians in the order of instances, shared by none, and without unused ones.
    pub fn with_packed_own(&self) -> Cow<'_, Self> {
        let mut end = 0u64;
        let packed = self.own_ranges.iter().all(|range| {
            end += u64::from(range.count);
            u64::from(range.first) + u64::from(range.count) == end
        });
        if packed && end == self.own.len() as u64 {
            return Cow::Borrowed(self);
        }
        let mut own = Gaussians { sh_degree: self.own.sh_degree, ..Gaussians::default() };
        let mut pack = |range: &SourceRange| {
            let first = own.len() as u32;
            range.indices().for_each(|i| own.push_from(&self.own, i));
            SourceRange { first, ..*range }
        };
        let own_ranges = self.own_ranges.iter().map(&mut pack).collect();
        Cow::Owned(Self { own, own_ranges, ..self.clone() })
    }

    /// Checks the optimised levels of detail.
    fn validate_levels(&self) -> Result<(), SceneError> {
        let fail = |tensor: &str, reason: String| Err(SceneError { tensor: tensor.into(), reason });
        for (l, level) in self.fitted_levels.iter().enumerate() {
            let [own, template] = [level.gaussians.sh_degree, self.templates.sh_degree];
            if own != template {
                return fail("level.sh", format!("has degree {own} where template.sh has {template}"));
            }
            if let Some((field, len, want)) = level.gaussians.wrong_length() {
                return fail(&format!("level.{field}"), format!("{len} entries in level {l} instead of {want}"));
            }
            if !(level.cell > 0.0 && level.cell < NO_NEXT_CELL) {
                return fail("level.cell", format!("that of level {l} is {}, not a length", level.cell));
            }
        }
        Ok(())
    }

    /// Checks the ranges of instances' own Gaussians.
    fn validate_own(&self) -> Result<(), SceneError> {
        let fail = |tensor: &str, reason: String| Err(SceneError { tensor: tensor.into(), reason });
        let (ranges, instances) = (self.own_ranges.len(), self.instances.len());
        if ranges != 0 && ranges != instances {
            return fail("instance.own", format!("{ranges} entries where {instances}, or none, fit"));
        }
        let count = self.own.len();
        if ranges == 0 && count > 0 {
            return fail("instance.own", format!("is missing, but there are {count} own Gaussians"));
        }
        if let Some(k) = self.own_ranges.iter().position(|r| u64::from(r.first) + u64::from(r.count) > count as u64) {
            let SourceRange { first, count: own } = self.own_ranges[k];
            let end = u64::from(first) + u64::from(own);
            return fail("instance.own", format!("those of instance {k} end at {end}, but there are {count}"));
        }
        let [own, template] = [self.own.sh_degree, self.templates.sh_degree];
        if count > 0 && own != template {
            return fail("own.sh", format!("has degree {own} where template.sh has {template}"));
        }
        Ok(())
    }
}
