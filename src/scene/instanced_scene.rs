//! The one scene type: templates, instances with offsets, and a background. A plain cloud is "background only".

use std::collections::BTreeMap;

use crate::math::similarity::Similarity;
use crate::scene::gaussians::Gaussians;
use crate::scene::offsets::Offsets;

/// A range of the template pool: one template.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct TemplateRange {
    /// Index of the template's first Gaussian in `InstancedScene::templates`.
    pub first: u32,
    /// Number of Gaussians of the template.
    pub count: u32,
}

/// One placed copy of a template.
#[derive(Clone, Debug, PartialEq)]
pub struct Instance {
    /// Index into `InstancedScene::template_ranges`.
    pub template: u32,
    /// The similarity that brings template-frame points into the world.
    pub world_from_template: Similarity,
    /// Index of the instance's first record in `InstancedScene::offsets`; `None` = no offsets.
    pub first_offset: Option<u32>,
}

/// Name and instance ids of a group of instances, as in `groups.json`; carried through files, not used for rendering.
#[derive(Clone, Debug, PartialEq, serde::Serialize, serde::Deserialize)]
pub struct Group {
    /// Template index this group uses.
    pub template_id: u32,
    /// Human name, for instance "chair".
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// Mask ids of the group's instances, in instance order.
    pub instance_ids: Vec<u32>,
}

/// A tensor that this version does not know: kept on re-save.
#[derive(Clone, Debug, PartialEq)]
pub struct ForeignTensor {
    /// Safetensors element type, for instance "F32".
    pub dtype: String,
    /// Tensor shape.
    pub shape: Vec<usize>,
    /// Little-endian bytes, row major.
    pub bytes: Vec<u8>,
}

/// Everything that is rendered, trained or stored. Flat Gaussian order (ties in depth are broken by it):
/// instances in file order, each in template order, then the background.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct InstancedScene {
    /// All templates' Gaussians, one after another, each in its own template frame.
    pub templates: Gaussians,
    /// One range of `templates` per template.
    pub template_ranges: Vec<TemplateRange>,
    /// The placed copies.
    pub instances: Vec<Instance>,
    /// Offsets that instances point into.
    pub offsets: Offsets,
    /// World-frame Gaussians that belong to no instance.
    pub background: Gaussians,
    /// The scene was trained with opacity compensation (Mip-Splatting style); renderers should use it.
    pub antialias: bool,
    /// Groups of instances with names and mask ids.
    pub groups: Vec<Group>,
    /// Where the scene came from, free text.
    pub source: String,
    /// Unknown tensors of the file this scene was read from.
    pub foreign_tensors: BTreeMap<String, ForeignTensor>,
    /// Unknown metadata strings of the file this scene was read from.
    pub foreign_metadata: BTreeMap<String, String>,
}

/// Why a scene is not consistent. The message names the tensor of `.instgs` that is at fault.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("{tensor}: {reason}")]
pub struct SceneError {
    /// Tensor name as in the `.instgs` format, for instance "instance.template".
    pub tensor: String,
    /// What is wrong.
    pub reason: String,
}

impl InstancedScene {
    /// A plain 3DGS cloud.
    pub fn from_cloud(background: Gaussians) -> Self {
        Self { background, ..Self::default() }
    }

    /// The SH degree the renderer evaluates: the larger of templates' and background's.
    pub fn sh_degree(&self) -> u32 {
        self.templates.sh_degree.max(self.background.sh_degree)
    }

    /// Number of Gaussians after expanding every instance, background included.
    pub fn expanded_len(&self) -> u64 {
        let instanced: u64 =
            self.instances.iter().map(|i| u64::from(self.template_ranges[i.template as usize].count)).sum();
        instanced + self.background.len() as u64
    }

    /// Bytes of the scene tensors as f32: what `bench` reports as `bytes.host`.
    pub fn tensor_bytes(&self) -> u64 {
        // 3x4 transform, template index, first offset; first and count per range.
        self.templates.tensor_bytes()
            + self.background.tensor_bytes()
            + self.offsets.tensor_bytes()
            + 56 * self.instances.len() as u64
            + 8 * self.template_ranges.len() as u64
    }

    /// Checks every index and array length; the error names the first tensor that is inconsistent.
    pub fn validate(&self) -> Result<(), SceneError> {
        let fail = |tensor: &str, reason: String| Err(SceneError { tensor: tensor.into(), reason });
        for (name, cloud) in [("template", &self.templates), ("background", &self.background)] {
            if let Some((field, len, want)) = cloud.wrong_length() {
                return fail(&format!("{name}.{field}"), format!("{len} entries where {name}.means calls for {want}"));
            }
        }
        let m = self.offsets.len();
        for (field, len) in [("sh_dc", self.offsets.sh_dc.len()), ("opacity_logits", self.offsets.opacity_logits.len())]
        {
            if len != m {
                return fail(&format!("offset.{field}"), format!("{len} entries where offset.means has {m}"));
            }
        }
        let rest = self.templates.sh_coefficients() - 1;
        for (field, len, want) in [
            ("sh_rest", self.offsets.sh_rest.len(), m * rest),
            ("log_scales", self.offsets.log_scales.len(), m),
            ("quats", self.offsets.quats.len(), m),
        ] {
            if len != want && len != 0 {
                return fail(&format!("offset.{field}"), format!("{len} entries where {want}, or none, fit"));
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
}
