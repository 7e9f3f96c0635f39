//! A scene that is small enough to see through by hand.

use glam::{DMat3, DVec3};
use instgs_vk::math::sh::SH_C0;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{Gaussians, Group, Instance, InstancedScene, Offsets, SourceRange};

/// Three chairs in a row along x, two with offsets, and a floor of one Gaussian; y is down.
pub(crate) fn chairs() -> InstancedScene {
    let mut chair = Gaussians::with_capacity(0, 4);
    for (k, mean) in [[0.1, 0.0, 0.0], [-0.1, 0.0, 0.0], [0.0, -0.2, 0.1], [0.0, -0.4, -0.1]].into_iter().enumerate() {
        chair.means.push(mean);
        chair.quats.push([1.0, 0.0, 0.2 * k as f32, 0.0]);
        chair.log_scales.push([0.1f32.ln(); 3]);
        chair.opacity_logits.push(3.0);
        chair.sh.push([1.0, 0.0, 0.2 * k as f32].map(|c| (c - 0.5) / SH_C0 as f32));
    }
    let instance = |k: u32| Instance {
        template: 0,
        world_from_template: Similarity::from_parts(DMat3::IDENTITY, 1.0, DVec3::new(f64::from(k), 0.0, 0.0)),
        first_offset: (k < 2).then_some(4 * k),
    };
    InstancedScene {
        background: chair.filtered(|i| i == 0),
        templates: chair,
        template_ranges: vec![SourceRange { first: 0, count: 4 }],
        instances: (0..3).map(instance).collect(),
        offsets: Offsets {
            means: vec![[0.0, 0.01, 0.0]; 8],
            sh_dc: vec![[0.1, 0.0, 0.0]; 8],
            opacity_logits: vec![0.5; 8],
            ..Offsets::default()
        },
        groups: vec![Group { template_id: 0, name: Some("chair".into()), instance_ids: vec![3, 7, 11] }],
        ..InstancedScene::default()
    }
}
