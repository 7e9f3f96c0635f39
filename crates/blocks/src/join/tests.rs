//! Two made-up blocks of a row of equal objects on a floor, cut at x = 0.

use glam::{DMat3, DVec3};
use instgs_samples::ring;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::lod::merged_levels;
use instgs_vk::scene::{Gaussians, Group, Instance, InstancedScene, Offsets, SourceRange};

use super::*;
use crate::cell::Cell;
use crate::plan::on_level_ground;

/// Points of the objects' surfaces.
const POINTS: usize = 1500;
/// Distance from the nearest of a surface's points, scene units, beyond which a Gaussian is not on it: twice their spacing.
const NEAR: f64 = 0.15;

fn push(out: &mut Gaussians, at: DVec3, color: [f32; 3]) {
    out.means.push(at.as_vec3().to_array());
    out.quats.push([1.0, 0.0, 0.0, 0.0]);
    out.log_scales.push([-3.5; 3]);
    out.opacity_logits.push(3.0);
    out.sh.push(color);
}

/// A low box with a tower on one corner and a step on another: it looks different from every side. The seed draws the points.
fn object(seed: u64) -> Gaussians {
    let boxes = [
        (DVec3::new(0.0, 0.0, 0.3), DVec3::new(1.0, 0.5, 0.3)),
        (DVec3::new(0.7, 0.25, 0.9), DVec3::new(0.25, 0.2, 0.3)),
        (DVec3::new(-0.6, -0.2, 0.75), DVec3::new(0.3, 0.25, 0.15)),
    ];
    let mut rng = Rng::new(seed);
    let mut out = Gaussians::with_capacity(0, POINTS);
    for i in 0..POINTS {
        let (middle, half) = boxes[i % 3];
        let mut at = DVec3::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0), rng.range(-1.0, 1.0));
        let axis = (3.0 * rng.uniform()) as usize % 3;
        at[axis] = if rng.chance(0.5) { 1.0 } else { -1.0 };
        push(&mut out, middle + at * half, [i as f32 % 3.0 - 1.0, 0.3, -0.2]);
    }
    out
}

fn floor() -> Gaussians {
    let mut out = Gaussians::with_capacity(0, 0);
    for i in -40..=40 {
        for j in -10..=10 {
            push(&mut out, DVec3::new(0.2 * f64::from(i) + 0.03, 0.2 * f64::from(j), -0.05), [0.0; 3]);
        }
    }
    out
}

/// A block with an object at each x, of a template whose frame is turned and moved, and with offsets of its own.
fn block(template: Gaussians, world_from_frame: Similarity, at: &[f64], background: Gaussians) -> InstancedScene {
    let count = template.len() as u32;
    let templates = template.placed(world_from_frame.inverse());
    let place = |x: f64| Similarity::from_parts(DMat3::from_rotation_z(0.4 * x), 1.0, DVec3::X * x);
    let instance = |(k, &x): (usize, &f64)| Instance {
        template: 0,
        world_from_template: place(x).after(&world_from_frame),
        first_offset: Some(k as u32 * count),
    };
    let records = at.len() * count as usize;
    InstancedScene {
        templates,
        template_ranges: vec![SourceRange { first: 0, count }],
        instances: at.iter().enumerate().map(instance).collect(),
        offsets: Offsets {
            means: vec![[0.0; 3]; records],
            sh_dc: (0..records).map(|m| [0.1 * (m / count as usize) as f32, 0.0, 0.0]).collect(),
            opacity_logits: vec![0.0; records],
            ..Offsets::default()
        },
        groups: vec![Group {
            template_id: 0,
            name: Some("thing".into()),
            instance_ids: (1..=at.len() as u32).collect(),
        }],
        background,
        ..InstancedScene::default()
    }
}

fn plan() -> Plan {
    on_level_ground(Cell::default().cut(0, 0.0), [1.0, 0.0])
}

/// Where an object that stands at x should have its surface, world frame.
fn surface_at(x: f64) -> Gaussians {
    object(9).placed(Similarity::from_parts(DMat3::from_rotation_z(0.4 * x), 1.0, DVec3::X * x))
}

/// Block 0 has three objects, block 1 three; that at -0.4 both have. That at 0.5 only block 0 found, and in block 1 it is
/// background.
#[test]
fn blocks_of_a_row_become_one_row() {
    let turned = Similarity::from_parts(DMat3::from_rotation_z(1.1), 1.0, DVec3::new(0.2, -0.3, 0.5));
    let mut first = block(object(1), Similarity::IDENTITY, &[-6.0, -3.0, -0.4, 0.5], floor());
    first.fitted_levels = merged_levels(&first.templates);
    let mut background = floor();
    let floor_len = background.len();
    background.append(&surface_at(0.5));
    // One more is known to the block on whose ground it is, and too far away for this one.
    let mut second = block(object(2), turned, &[-0.4, 3.2, 6.0, -3.0], background);
    second.fitted_levels = merged_levels(&second.templates);
    let (plan, mut scenes, cameras) = (plan(), [first, second], ring(DVec3::Z));
    let input = JoinInput { plan: &plan, scenes: &scenes, cameras: &cameras, gpu: None };
    let Joined { scene, report } = join(&input).unwrap();
    assert_eq!((scene.template_ranges.len(), scene.instances.len(), report.duplicates), (1, 6, 1), "{report:?}");
    assert_eq!((report.templates[0].templates, report.templates[0].block.as_str()), (2, "block_00"));
    assert_eq!(scene.groups[0].instance_ids, [1, 2, 3, 4, 5, 6]);
    // Block 0's own stay as they are, to the bit, and so do the levels of its template.
    assert_eq!(scene.templates, scenes[0].templates);
    assert!(!scene.fitted_levels.is_empty() && scene.fitted_levels == scenes[0].fitted_levels);
    assert_eq!([report.blocks[0].beyond, report.blocks[1].beyond], [0, 1]);
    let records = 4 * POINTS;
    assert_eq!(scene.instances[..4], scenes[0].instances[..]);
    assert_eq!(scene.offsets.sh_dc[..records], scenes[0].offsets.sh_dc[..]);
    // Those of block 1 are where they were, turned alike, and keep their colours.
    for (k, x) in [(4, 3.2), (5, 6.0)] {
        let shown = scene.flatten_one(k);
        let surface = instgs_vk::math::nearest::PointSet::new(&surface_at(x).means);
        let far = shown.means.iter().filter(|&&mean| surface.distance(mean) > NEAR).count();
        assert!(far < POINTS / 50, "{k}: {far}");
        let other = Similarity::from_parts(DMat3::from_rotation_z(0.4 * x + std::f64::consts::PI), 1.0, DVec3::X * x);
        let planted = instgs_vk::math::nearest::PointSet::new(&object(9).placed(other).means);
        assert!(shown.means.iter().filter(|&&mean| planted.distance(mean) > NEAR).count() > POINTS / 10);
        let old = if k == 4 { 1 } else { 2 };
        let red = |cloud: &Gaussians| cloud.sh.iter().map(|c| f64::from(c[0])).sum::<f64>() / cloud.len() as f64;
        let (is, was) = (red(&shown), red(&scenes[1].flatten_one(old)));
        assert!((is - was).abs() < 0.05, "{is} {was}");
    }
    // The floor is whole, once, but for a few Gaussians below the object; the object in the background is gone.
    let [left, right] = [&report.blocks[0], &report.blocks[1]];
    assert_eq!(left.background + left.outside, floor_len);
    assert!(right.covered as f64 > 0.9 * POINTS as f64 * 0.5, "{report:?}");
    let floor_kept = scene.background.means.iter().filter(|mean| mean[2] < 0.0).count();
    assert!(floor_kept * 100 >= floor_len * 99, "{floor_kept} of {floor_len}");
    let above = scene.background.means.iter().filter(|mean| mean[2] > 0.1).count();
    assert!(above < POINTS / 20, "{above} Gaussians of the object are left");
    assert!(report.warnings.is_empty(), "{:?}", report.warnings);
    // Of the template that goes the levels go, too, and where the other has none they are missed.
    scenes[0].fitted_levels.clear();
    let Joined { scene, report } =
        join(&JoinInput { plan: &plan, scenes: &scenes, cameras: &cameras, gpu: None }).unwrap();
    assert!(scene.fitted_levels.is_empty());
    assert!(
        matches!(&report.warnings[..], [one] if one.contains("levels of detail of block_01's template")),
        "{report:?}"
    );
}

/// Without objects, joining is taking each block's part of the ground.
#[test]
fn plain_clouds_are_joined_by_ownership() {
    let scenes = [InstancedScene::from_cloud(floor()), InstancedScene::from_cloud(floor())];
    let plan = plan();
    let Joined { scene, report } = join(&JoinInput { plan: &plan, scenes: &scenes, cameras: &[], gpu: None }).unwrap();
    assert_eq!((scene.background.len(), scene.instances.len()), (floor().len(), 0));
    assert_eq!(report.blocks[0].background + report.blocks[1].background, floor().len());
    let error = join(&JoinInput { plan: &plan, scenes: &scenes[..1], cameras: &[], gpu: None }).err();
    assert!(error.is_some_and(|error| error.to_string().contains("2 blocks and 1 scenes")));
}
