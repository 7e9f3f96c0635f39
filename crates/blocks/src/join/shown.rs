//! What one instance of a scene shows.

use instgs_vk::scene::{Gaussians, Instance, InstancedScene, Offsets, SourceRange};

/// The Gaussians of instance `k` in the world frame: those of its template with its offsets and colours, then its own.
pub(super) fn instance_in_world(scene: &InstancedScene, k: usize) -> Gaussians {
    let Instance { template, world_from_template, first_offset } = scene.instances[k];
    let range = scene.template_ranges[template as usize];
    let mut offsets = Offsets::default();
    if let Some(first) = first_offset {
        (first..first + range.count).for_each(|m| offsets.push_from(&scene.offsets, m as usize));
    }
    let own = scene.own.range(scene.own_range(k));
    let alone = InstancedScene {
        templates: scene.templates.range(range),
        template_ranges: vec![SourceRange { first: 0, count: range.count }],
        instances: vec![Instance { template: 0, world_from_template, first_offset: first_offset.map(|_| 0) }],
        color_from_template: scene.color_matrix(k).copied().into_iter().collect(),
        own_ranges: vec![SourceRange { first: 0, count: own.len() as u32 }],
        own,
        offsets,
        background: Gaussians { sh_degree: scene.templates.sh_degree, ..Gaussians::default() },
        ..InstancedScene::default()
    };
    alone.flatten()
}
