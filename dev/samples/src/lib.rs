//! Small scenes, clouds and cameras for the unit tests of several crates.

use std::collections::BTreeMap;

use glam::DVec3;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::instanced_scene::ForeignTensor;
use instgs_vk::scene::lod::{FittedLevel, template_print};
use instgs_vk::scene::{
    Camera, Gaussians, Group, Instance, InstancedScene, NearPlane, Offsets, PixelFilter, SourceRange,
};

/// Twelve cameras on a ring of radius 9 around the origin, 4 above it, looking at it with `up` upwards.
pub fn ring(up: DVec3) -> Vec<Camera> {
    let eye = |i: u32| DVec3::new(9.0 * f64::from(i).cos(), 9.0 * f64::from(i).sin(), 4.0);
    (0..12).map(|i| Camera::look_at("", eye(i), DVec3::ZERO, up, 0.8, (64, 48))).collect()
}

/// A cloud in which every value is different.
pub fn sample(degree: u32, n: usize) -> Gaussians {
    let mut counter = 0;
    let mut next = || {
        counter += 1;
        (counter % 997) as f32 * 0.001 - 0.4
    };
    let mut out = Gaussians { sh_degree: degree, ..Gaussians::default() };
    for _ in 0..n {
        out.means.push([next() * 8.0, next() * 8.0, next() * 8.0]);
        out.quats.push([next() + 1.0, next(), next(), next()]);
        out.log_scales.push([next() - 4.0, next() - 4.0, next() - 4.0]);
        out.opacity_logits.push(next() * 3.0);
        (0..sh_coefficients(degree)).for_each(|_| out.sh.push([next(), next(), next()]));
    }
    out
}

/// Two templates (3 and 2 Gaussians), four instances, 8 offset records, a background of 4.
pub fn sample_scene() -> InstancedScene {
    let pose = |x: f32| {
        Similarity::from_rows([[0.0, -2.0, 0.0, x], [2.0, 0.0, 0.0, 1.0], [0.0, 0.0, 2.0, -x]])
            .unwrap_or(Similarity::IDENTITY)
    };
    let instance = |template, x, first_offset| Instance { template, world_from_template: pose(x), first_offset };
    let values = sample(0, 8);
    InstancedScene {
        templates: sample(2, 5),
        template_ranges: vec![SourceRange { first: 0, count: 3 }, SourceRange { first: 3, count: 2 }],
        instances: vec![
            instance(0, 0.0, Some(0)),
            instance(1, 1.0, None),
            instance(0, 2.0, Some(3)),
            instance(1, 3.0, Some(6)),
        ],
        color_from_template: Vec::new(),
        own: Gaussians::default(),
        own_ranges: Vec::new(),
        offsets: Offsets {
            means: values.means,
            sh_dc: values.sh,
            opacity_logits: values.opacity_logits,
            ..Offsets::default()
        },
        background: sample(3, 4),
        fitted_levels: Vec::new(),
        pixel_filter: PixelFilter { antialias: true, ..PixelFilter::default() },
        near_plane: NearPlane::default(),
        groups: vec![Group { template_id: 0, name: Some("chair \"a\"".into()), instance_ids: vec![4, 9] }],
        source: "test".into(),
        foreign_tensors: BTreeMap::from([
            ("x.odd".into(), ForeignTensor { dtype: "U8".into(), shape: vec![3], bytes: vec![1, 2, 3] }),
            ("a.wide".into(), ForeignTensor { dtype: "I64".into(), shape: vec![1], bytes: vec![7; 8] }),
        ]),
        foreign_metadata: (0..9).map(|i| (format!("key{i}"), format!("value {i}"))).collect(),
    }
}

/// The sample scene with own Gaussians: two that the instances of the first template share, one of the last instance.
pub fn with_own() -> InstancedScene {
    let range = |first, count| SourceRange { first, count };
    InstancedScene {
        own: sample(2, 7).filtered(|i| i >= 4),
        own_ranges: vec![range(1, 2), range(0, 0), range(1, 2), range(0, 1)],
        ..sample_scene()
    }
}

/// The sample scene with two optimised levels of detail of its first template and one of its second.
pub fn with_levels() -> InstancedScene {
    let scene = sample_scene();
    let level = |template: usize, cell, count| FittedLevel {
        template_print: template_print(&scene.templates.range(scene.template_ranges[template])),
        cell,
        gaussians: sample(2, count),
    };
    InstancedScene { fitted_levels: vec![level(0, 0.5, 2), level(0, 1.0, 1), level(1, 0.75, 1)], ..scene }
}

/// The sample scene with offsets of SH degree 1, which is below that of the templates.
pub fn with_low_sh_offsets() -> InstancedScene {
    let mut scene = sample_scene();
    scene.offsets.sh_rest = sample(1, 8).sh.chunks(4).flat_map(|record| record[1..].to_vec()).collect();
    scene
}

/// The sample scene with all kinds of offsets.
pub fn with_ablations() -> InstancedScene {
    let mut scene = sample_scene();
    let values = sample(2, 8);
    // All coefficients but 0 of each record.
    scene.offsets.sh_rest = values.sh.chunks(9).flat_map(|record| record[1..].to_vec()).collect();
    scene.offsets.log_scales = values.log_scales;
    scene.offsets.quats = values.quats;
    scene
}
