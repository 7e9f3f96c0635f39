//! Instanced scenes.

use instgs_io::{IoError, Pack, scene_write};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{Group, Instance, InstancedScene, Offsets, SourceRange};

use super::clouds::cloud;
use crate::path;

/// A scene of the coded tables of older versions, which are only read.
pub const OLDER: &[u8] = include_bytes!("../../../../tests/fixtures/small_tables.instgs");
/// A scene of coded fields without memory and opponent colours, as older versions wrote them.
pub const OLDER_CODED: &[u8] = include_bytes!("../../../../tests/fixtures/small_coded.instgs");

/// Scenes with templates, offsets of shapes and own Gaussians that an older version packed (format 4).
pub const OLDER_SCENES: [&[u8]; 2] = [
    include_bytes!("../../../../tests/fixtures/small_ablations_4.instgs"),
    include_bytes!("../../../../tests/fixtures/small_own_4.instgs"),
];

/// Two instances of a template of three Gaussians, one of them with offsets, and a background of two.
pub fn scene() -> InstancedScene {
    let instance = |first_offset| Instance { template: 0, world_from_template: Similarity::IDENTITY, first_offset };
    InstancedScene {
        templates: cloud(1, 3),
        template_ranges: vec![SourceRange { first: 0, count: 3 }],
        instances: vec![instance(Some(0)), instance(None)],
        offsets: Offsets {
            means: vec![[0.1; 3]; 3],
            sh_dc: vec![[0.0; 3]; 3],
            opacity_logits: vec![0.0; 3],
            ..Offsets::default()
        },
        background: cloud(1, 2),
        groups: vec![Group { template_id: 0, name: Some("x".into()), instance_ids: vec![1, 2] }],
        ..InstancedScene::default()
    }
}

/// A scene with all that a file may have: offsets of every kind, colour matrices, own Gaussians, levels, foreign tensors.
pub fn full_scene() -> InstancedScene {
    let mut scene = instgs_samples::sample_scene();
    let records = scene.offsets.means.len();
    let rest = scene.templates.sh_coefficients() - 1;
    scene.offsets.sh_rest = vec![[0.3, -0.2, 0.1]; records * rest];
    scene.offsets.log_scales = vec![[0.1; 3]; records];
    scene.offsets.quats = vec![[0.0, 0.1, 0.0, -0.1]; records];
    let count = scene.instances.len();
    scene.color_from_template = vec![[[1.1, 0.0, 0.0, 0.1], [0.0, 0.9, 0.0, 0.0], [0.0, 0.0, 1.0, -0.1]]; count];
    scene.own = instgs_samples::sample(2, 2);
    scene.own_ranges = vec![SourceRange::default(); count];
    scene.own_ranges[1] = SourceRange { first: 0, count: 2 };
    scene.fitted_levels = instgs_samples::with_levels().fitted_levels;
    scene
}

/// [`full_scene`] as a file.
pub fn packed(pack: Pack) -> Result<Vec<u8>, IoError> {
    scene_write::packed_scene_file_bytes(&full_scene(), pack, path())
}
