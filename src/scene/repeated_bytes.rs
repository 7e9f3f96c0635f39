//! Memory saved by sharing: bytes of the repeated part of a scene compared with separate copies.

use serde::{Deserialize, Serialize};

use super::InstancedScene;

impl InstancedScene {
    /// Bytes of an instance besides its offsets and own Gaussians: a 3x4 transform as f32, template and first offset, its
    /// colour matrix (3x4 as f32) if the scene has matrices, and the range of its own Gaussians if any instance has some.
    pub fn instance_bytes(&self) -> u64 {
        let [color, own] = [self.color_from_template.is_empty(), self.own_ranges.is_empty()];
        56 + if color { 0 } else { 48 } + if own { 0 } else { 8 }
    }
}

/// Bytes of the repeated part of a scene, and of separate copies of it: the analytic bound, without a file's header and
/// index.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(default)]
pub struct RepeatedBytes {
    /// As a .ply with separate copies: 62 f32 at degree 3 for each Gaussian of each instance.
    pub ply: u64,
    /// Templates, offsets, instances and their own Gaussians with `--pack f32`.
    pub f32: u64,
    /// The same with `--pack f16`: means of templates, and transforms, stay f32.
    pub f16: u64,
    /// The same with `--pack q8`: like f16, but offsets have 8 bits per value.
    pub q8: u64,
}

impl RepeatedBytes {
    /// Offset records have 7 values (position, base colour, opacity) and ablation offsets, which stay f16 in q8.
    pub fn of(scene: &InstancedScene) -> Self {
        let coefficients = 3 * scene.templates.sh_coefficients() as u64;
        let gaussians = (scene.templates.len() + scene.own.len()) as u64;
        let offsets = scene.offsets.len() as u64;
        let instances = scene.instance_bytes() * scene.instances.len() as u64;
        // Quaternion, scales, opacity and SH.
        let beside_means = 4 + 3 + 1 + coefficients;
        // A .ply also stores three unused normals.
        let ply = 4 * (3 + 3 + beside_means);
        let half = gaussians * (12 + 2 * beside_means) + instances;
        Self {
            ply: ply * (scene.expanded_len() - scene.hidden_len() - scene.background.len() as u64),
            f32: scene.templates.tensor_bytes() + scene.own.tensor_bytes() + scene.offsets.tensor_bytes() + instances,
            f16: half + scene.offsets.tensor_bytes() / 2,
            q8: half + (scene.offsets.tensor_bytes() - 28 * offsets) / 2 + 7 * offsets,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::similarity::Similarity;
    use crate::scene::removable::HIDDEN_LOGIT;
    use crate::scene::{Gaussians, Instance, Offsets, SourceRange};

    /// The analytic bound, 248 K N bytes against 124 N + 14 K N, plus the instances.
    #[test]
    fn the_bound_is_that_of_the_design() {
        let (k, n) = (3u32, 5u32);
        let mut templates = Gaussians::with_capacity(3, n as usize);
        templates.means = vec![[0.0; 3]; n as usize];
        templates.opacity_logits = vec![0.0; n as usize];
        let instance =
            |i| Instance { template: 0, world_from_template: Similarity::IDENTITY, first_offset: Some(i * n) };
        let scene = InstancedScene {
            templates,
            template_ranges: vec![SourceRange { first: 0, count: n }],
            instances: (0..k).map(instance).collect(),
            offsets: Offsets {
                means: vec![[0.0; 3]; (k * n) as usize],
                opacity_logits: vec![0.0; (k * n) as usize],
                ..Offsets::default()
            },
            background: Gaussians { means: vec![[0.0; 3]; 11], ..Gaussians::default() },
            ..InstancedScene::default()
        };
        let records = (k * n) as usize;
        let ablations = Offsets {
            means: vec![[0.0; 3]; records],
            opacity_logits: vec![0.0; records],
            sh_rest: vec![[0.0; 3]; 15 * records],
            log_scales: vec![[0.0; 3]; records],
            quats: vec![[0.0; 4]; records],
            ..Offsets::default()
        };
        let mut hiding = scene.clone();
        hiding.offsets.opacity_logits[4] = HIDDEN_LOGIT;
        let with_all = InstancedScene { offsets: ablations, ..scene.clone() };
        let (k, n) = (u64::from(k), u64::from(n));
        let bytes = RepeatedBytes::of(&scene);
        assert_eq!(bytes.ply, 248 * k * n);
        assert_eq!(bytes.f32, 236 * n + 28 * k * n + 56 * k);
        assert_eq!(bytes.f16, 124 * n + 14 * k * n + 56 * k);
        assert_eq!(bytes.q8, 124 * n + 7 * k * n + 56 * k);
        // What an instance hides would be in no .ply.
        assert_eq!(RepeatedBytes::of(&hiding), RepeatedBytes { ply: 248 * (k * n - 1), ..bytes });
        let more = RepeatedBytes::of(&with_all);
        assert_eq!(more.ply, bytes.ply);
        assert_eq!(more.f32, bytes.f32 + (180 + 28) * k * n);
        assert_eq!([more.f16 - bytes.f16, more.q8 - bytes.q8], [(90 + 14) * k * n; 2]);
        assert_eq!(RepeatedBytes::of(&InstancedScene::default()), RepeatedBytes::default());
    }
}
