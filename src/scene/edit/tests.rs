//! Every edit, checked on the flattened scene: what changes, and that nothing else does.

use std::f64::consts::{FRAC_PI_2, PI, TAU};

mod arrange;
mod thin;

use super::*;
use crate::math::sh::{SH_C0, widened};
use crate::scene::gaussians::Gaussians;
use crate::scene::instanced_scene::{ForeignTensor, Group, Instance, SAME_COLOR, SourceRange};
use crate::scene::offsets::Offsets;

/// `count` Gaussians in a row along x from -0.5, SH degree 1, all different.
fn row(count: usize) -> Gaussians {
    let mut out = Gaussians::with_capacity(1, count);
    for i in 0..count {
        let v = i as f32;
        out.means.push([v - 0.5, 0.1 * v, 0.2]);
        out.quats.push([1.0, 0.1 * v, 0.0, 0.2]);
        out.log_scales.push([-2.0, -3.0 - v, -2.5]);
        out.opacity_logits.push(v);
        out.sh.extend((0..4).map(|c| [0.1 * v, 0.2 * c as f32, 0.3]));
    }
    out
}

/// Templates "chair" of 2 and "table" of 3; chairs 0 (id 4, own offsets), 2 (id 9, none), 3 (id 7, own offsets with
/// 4's), 4 (id 8, shares 3's); table 1 (id 5, own offsets).
fn scene() -> InstancedScene {
    let instance = |template, k: u32, first_offset| Instance {
        template,
        world_from_template: Similarity::from_parts(
            DMat3::from_rotation_y(0.4 * f64::from(k)),
            1.0 + 0.5 * f64::from(k),
            DVec3::new(3.0 * f64::from(k), 1.0, -2.0),
        ),
        first_offset,
    };
    let group = |template_id, name: &str, instance_ids: &[u32]| Group {
        template_id,
        name: Some(name.into()),
        instance_ids: instance_ids.into(),
    };
    InstancedScene {
        templates: row(5),
        template_ranges: vec![SourceRange { first: 0, count: 2 }, SourceRange { first: 2, count: 3 }],
        instances: vec![
            instance(0, 0, Some(0)),
            instance(1, 1, Some(2)),
            instance(0, 2, None),
            instance(0, 3, Some(5)),
            instance(0, 4, Some(5)),
        ],
        offsets: Offsets {
            means: (0..7).map(|o| [0.01 * o as f32, 0.0, 0.02]).collect(),
            sh_dc: (0..7).map(|o| [0.1, 0.1 * o as f32, 0.0]).collect(),
            opacity_logits: (0..7).map(|o| 0.1 * o as f32).collect(),
            sh_rest: (0..21).map(|o| [o as f32, 0.0, 1.0]).collect(),
            ..Offsets::default()
        },
        background: row(2),
        groups: vec![group(0, "chair", &[4, 9, 7, 8]), group(1, "table", &[5])],
        ..InstancedScene::default()
    }
}

use glam::DMat3;

fn run(scene: &mut InstancedScene, edit: Edit) -> EditOutcome {
    let outcome = apply(scene, &edit).unwrap();
    scene.validate().unwrap();
    let labelled = scene.groups.iter().map(|g| g.instance_ids.len()).sum::<usize>();
    assert_eq!(labelled, scene.instances.len(), "every instance keeps an id");
    outcome
}

/// The flattened Gaussians of each instance, the background last.
fn looks(scene: &InstancedScene) -> Vec<Gaussians> {
    let flat = scene.flatten();
    let mut first = 0;
    let counts = scene
        .instances
        .iter()
        .enumerate()
        .map(|(k, i)| (scene.template_ranges[i.template as usize].count + scene.own_range(k).count) as usize);
    let mut parts = Vec::new();
    for count in counts.chain([scene.background.len()]) {
        parts.push(flat.filtered(|i| (first..first + count).contains(&i)));
        first += count;
    }
    parts
}

/// Indices of the parts that differ, for scenes with the same instances.
fn differing(before: &InstancedScene, after: &InstancedScene) -> Vec<usize> {
    let (before, after) = (looks(before), looks(after));
    assert_eq!(before.len(), after.len());
    (0..before.len()).filter(|&k| before[k] != after[k]).collect()
}

fn ids(scene: &InstancedScene) -> Vec<u32> {
    scene.instance_labels().iter().map(|l| l.id.unwrap()).collect()
}

fn which(text: &str) -> Selector {
    text.parse().unwrap()
}

fn centre(scene: &InstancedScene, k: usize) -> DVec3 {
    let instance = &scene.instances[k];
    instance.world_from_template.transform_point(template_centres(scene)[instance.template as usize])
}

#[test]
fn selectors_name_instances_and_errors_what_exists() {
    let scene = scene();
    for (text, want) in [("1", vec![1]), ("id:9", vec![2]), ("group:chair", vec![0, 2, 3, 4]), ("template:1", vec![1])]
    {
        assert_eq!(which(text).resolve(&scene).unwrap(), want);
        assert_eq!(which(text).to_string(), text);
    }
    for (text, want) in [
        ("5", "there are 0 to 4"),
        ("id:6", "ids are 4, 9, 7, 8, 5"),
        ("group:sofa", "groups are chair, table"),
        ("template:2", "there are 0 to 1"),
    ] {
        let error = apply(&mut scene.clone(), &Edit::Delete { which: which(text) }).unwrap_err().to_string();
        assert!(error.starts_with("delete: there is no") && error.contains(want), "{error}");
        let empty =
            apply(&mut InstancedScene::default(), &Edit::Delete { which: which(text) }).unwrap_err().to_string();
        assert!(empty.contains("the scene has none"), "{empty}");
    }
    for bad in ["", "-1", "x", "id:", "id:x", "group:", "mask:1", "1.5"] {
        assert!(bad.parse::<Selector>().is_err(), "{bad}");
    }
    let to = Edit::MoveTo { which: which("group:chair"), to: DVec3::ZERO };
    assert!(apply(&mut scene.clone(), &to).unwrap_err().to_string().contains("selects 4 instances"));
}

#[test]
fn placement_changes_the_named_instance_only() {
    let before = scene();
    let turn = Turn { axis: DVec3::new(0.0, 2.0, 0.0), angle: FRAC_PI_2 };
    let edits = [
        Edit::MoveBy { which: which("id:9"), by: DVec3::new(1.0, 2.0, 3.0) },
        Edit::MoveTo { which: which("2"), to: DVec3::new(-1.0, 0.5, 4.0) },
        Edit::Rotate { which: which("2"), turn },
        Edit::Scale { which: which("2"), by: 2.0 },
    ];
    let centres = [
        centre(&before, 2) + DVec3::new(1.0, 2.0, 3.0),
        DVec3::new(-1.0, 0.5, 4.0),
        centre(&before, 2),
        centre(&before, 2),
    ];
    for (edit, want_centre) in edits.into_iter().zip(centres) {
        let mut after = before.clone();
        let outcome = run(&mut after, edit);
        assert_eq!((outcome.changed, outcome.added.len(), outcome.warnings.len()), (vec![2], 0, 0));
        assert_eq!(differing(&before, &after), [2]);
        assert!(centre(&after, 2).distance(want_centre) < 1e-5, "{}", centre(&after, 2));
    }
    let mut after = before.clone();
    run(&mut after, Edit::Rotate { which: which("2"), turn });
    let (old, new) = (before.instances[2].world_from_template, after.instances[2].world_from_template);
    let error = (new.linear() - DMat3::from_rotation_y(FRAC_PI_2) * old.linear()).to_cols_array();
    assert!(error.iter().all(|e| e.abs() < 1e-6));
    run(&mut after, Edit::Scale { which: which("2"), by: 0.25 });
    assert!((after.instances[2].world_from_template.scale() - 0.25 * old.scale()).abs() < 1e-6);
    // A group: each instance moves about its own centre.
    let mut group = before.clone();
    run(&mut group, Edit::Scale { which: which("group:chair"), by: 3.0 });
    assert_eq!(differing(&before, &group), [0, 2, 3, 4]);
    assert!([0, 2, 3, 4].iter().all(|&k| centre(&group, k).distance(centre(&before, k)) < 1e-5));
}

#[test]
fn impossible_placements_are_refused_and_leave_the_scene() {
    let k = || which("group:chair");
    let turn = |axis, angle| Edit::Rotate { which: k(), turn: Turn { axis, angle } };
    for edit in [
        Edit::Scale { which: k(), by: 0.0 },
        Edit::Scale { which: k(), by: -1.0 },
        Edit::Scale { which: k(), by: f64::NAN },
        Edit::Scale { which: k(), by: 1e39 },
        Edit::MoveBy { which: k(), by: DVec3::new(1e39, 0.0, 0.0) },
        Edit::MoveTo { which: which("0"), to: DVec3::NAN },
        turn(DVec3::ZERO, 1.0),
        turn(DVec3::X, f64::INFINITY),
        Edit::Duplicate { which: k(), by: DVec3::NAN, turn: None },
        Edit::Recolour { which: k(), rgb: [f32::NAN, 0.0, 0.0] },
        Edit::Recolour { which: k(), rgb: [0.0, 1e30, 0.0] },
        Edit::Swap { which: k(), template: 2 },
    ] {
        let mut after = scene();
        let error = apply(&mut after, &edit).unwrap_err();
        assert_eq!(error.operation, edit.name());
        assert_eq!(after, scene(), "{error}");
    }
}

#[test]
fn a_duplicate_shares_offsets_and_a_recolouring_copies_them() {
    let before = scene();
    let mut after = before.clone();
    let turn = Some(Turn { axis: DVec3::NEG_Y, angle: PI });
    let outcome = run(&mut after, Edit::Duplicate { which: which("id:4"), by: DVec3::X, turn });
    assert_eq!((outcome.added, ids(&after)), (vec![5], vec![4, 5, 9, 7, 8, 10]));
    assert_eq!((after.instances[5].first_offset, after.offsets.len()), (Some(0), 7));
    assert!(centre(&after, 5).distance(centre(&before, 0) + DVec3::X) < 1e-5);
    assert_eq!(looks(&after)[..5], looks(&before)[..5]);

    // The original is recoloured: the duplicate keeps its colour.
    let shared = after.clone();
    run(&mut after, Edit::Recolour { which: which("0"), rgb: [0.1, 0.0, -0.2] });
    assert_eq!((differing(&shared, &after), after.offsets.len()), (vec![0], 9));
    let colour = |scene: &InstancedScene| widened(looks(scene)[0].sh_of(1)[0]) * SH_C0;
    assert!((colour(&after) - colour(&shared) - DVec3::new(0.1, 0.0, -0.2)).length() < 1e-6);
    assert_eq!(after.offsets.sh_rest[7 * 3..], before.offsets.sh_rest[..6], "the whole record is copied");
    // It has its own run now, so that no further copy is made.
    run(&mut after, Edit::Recolour { which: which("0"), rgb: [0.1, 0.0, -0.2] });
    assert_eq!(after.offsets.len(), 9);
}

#[test]
fn recolouring_uses_the_cheapest_place() {
    let before = scene();
    let recoloured = |selector: &str| {
        let mut after = before.clone();
        run(&mut after, Edit::Recolour { which: which(selector), rgb: [0.0, 0.3, 0.0] });
        (differing(&before, &after), after)
    };
    // An instance without offsets gets a run, one of two that share a run gets a copy, and a whole group changes its
    // template.
    let (parts, after) = recoloured("id:9");
    assert_eq!((parts, after.offsets.len(), after.offsets.sh_rest.len()), (vec![2], 9, 27));
    let (parts, after) = recoloured("3");
    assert_eq!((parts, after.offsets.len()), (vec![3], 9));
    for selector in ["group:chair", "template:0"] {
        let (parts, after) = recoloured(selector);
        assert_eq!((parts, after.offsets), (vec![0, 2, 3, 4], before.offsets.clone()));
        assert_ne!(after.templates.sh, before.templates.sh);
    }
    // Both instances that share a run, as a part of the template's instances: they continue to share it.
    let mut split = before.clone();
    split.groups = vec![
        Group { template_id: 0, name: Some("chair".into()), instance_ids: vec![4, 9] },
        Group { template_id: 0, name: Some("stool".into()), instance_ids: vec![7, 8] },
        split.groups[1].clone(),
    ];
    let mut after = split.clone();
    run(&mut after, Edit::Recolour { which: which("group:stool"), rgb: [0.0, 0.3, 0.0] });
    assert_eq!((differing(&split, &after), after.offsets.len()), (vec![3, 4], 7));
    // Overlapping templates: the other one must not change.
    let mut overlapping = before.clone();
    overlapping.template_ranges[1] = SourceRange { first: 1, count: 3 };
    let mut after = overlapping.clone();
    run(&mut after, Edit::Recolour { which: which("template:0"), rgb: [0.0, 0.3, 0.0] });
    assert_eq!(differing(&overlapping, &after), [0, 2, 3, 4]);
}

#[test]
fn colour_matrices_follow_their_instances() {
    let mut scene = scene();
    let matrix = |k: usize| [[k as f32, 0.0, 0.0, 0.0]; 3];
    scene.color_from_template = (0..5).map(matrix).collect();
    run(&mut scene, Edit::Delete { which: which("1") });
    run(&mut scene, Edit::Duplicate { which: which("2"), by: DVec3::X, turn: None });
    assert_eq!(scene.color_from_template, [0, 2, 3, 4, 3].map(matrix));
    let shared = Scatter {
        template: 0,
        count: 2,
        over: ScatterOver::Path { points: vec![DVec3::ZERO, DVec3::X], up: DVec3::Y, yaw: 0.0 },
        offsets: OffsetSource::Shared(which("2")),
    };
    run(&mut scene, Edit::Scatter(shared));
    assert_eq!(scene.color_from_template[5..], [matrix(3), matrix(3)]);
    run(&mut scene, Edit::Swap { which: which("0"), template: 1 });
    assert_eq!((scene.color_from_template[0], scene.color_from_template[1]), (SAME_COLOR, matrix(2)));
}

/// Chair 2 has neither offsets nor own Gaussians, and a colour matrix is a look of its own.
#[test]
fn scattered_instances_take_a_colour_matrix_alone() {
    let mut before = scene();
    let mut tinted = SAME_COLOR;
    tinted[1][3] = 0.5;
    before.color_from_template = vec![SAME_COLOR; 5];
    let like_template = plane(2, 0.0, 1, OffsetSource::Shared(which("2")));
    assert!(apply(&mut before.clone(), &like_template).is_err(), "it looks like the template");
    before.color_from_template[2] = tinted;
    for offsets in [OffsetSource::Shared(which("2")), OffsetSource::Copied(which("2"))] {
        let mut after = before.clone();
        run(&mut after, plane(2, 0.0, 1, offsets));
        assert_eq!((after.offsets.len(), after.instances[5].first_offset), (before.offsets.len(), None));
        assert_eq!(after.color_from_template[5..], [tinted; 2]);
    }
}

/// The scene with own Gaussians: two of chair 0, one of table 1 that chair 2 shares, none of the others.
fn with_own() -> InstancedScene {
    let range = |first, count| SourceRange { first, count };
    let own_ranges = vec![range(0, 2), range(2, 1), range(2, 1), range(0, 0), range(0, 0)];
    InstancedScene { own: row(3), own_ranges, ..scene() }
}

#[test]
fn own_gaussians_follow_their_instances() {
    let before = with_own();
    let mut after = before.clone();
    run(&mut after, Edit::MoveBy { which: which("1"), by: DVec3::X });
    assert_eq!((differing(&before, &after), &after.own), (vec![1], &before.own));
    // A duplicate shares them, and with the last of those that share them they go.
    run(&mut after, Edit::Duplicate { which: which("1"), by: DVec3::X, turn: None });
    assert_eq!((after.own_range(5), after.own.len()), (after.own_range(1), 3));
    run(&mut after, Edit::Delete { which: which("1") });
    run(&mut after, Edit::Delete { which: which("4") });
    assert_eq!(after.own.len(), 3, "chair 2, now 1, has one of them");
    let outcome = run(&mut after, Edit::Swap { which: which("1"), template: 1 });
    assert!(outcome.warnings.iter().any(|w| w.contains("own Gaussians of 1 instances")), "{:?}", outcome.warnings);
    assert_eq!((after.own, after.own_ranges[1].count), (row(3).filtered(|i| i < 2), 0));
}

#[test]
fn own_gaussians_are_copied_when_one_of_their_users_changes() {
    for (selector, count) in [("1", 4), ("0", 3), ("3", 3)] {
        let before = with_own();
        let mut after = before.clone();
        run(&mut after, Edit::Recolour { which: which(selector), rgb: [0.5, 0.0, -0.25] });
        assert_eq!((differing(&before, &after), after.own.len()), (vec![selector.parse().unwrap()], count));
        let k: usize = selector.parse().unwrap();
        let (was, is) = (&looks(&before)[k], &looks(&after)[k]);
        for i in 0..was.len() {
            let shift = [0, 1, 2].map(|c| SH_C0 as f32 * (is.sh_of(i)[0][c] - was.sh_of(i)[0][c]));
            assert!(shift.iter().zip([0.5, 0.0, -0.25]).all(|(a, b)| (a - b).abs() < 1e-5), "{i}: {shift:?}");
        }
    }
}

#[test]
fn a_region_loses_own_gaussians_too() {
    let mut scene = with_own();
    // Chair 0's own are at -0.5 and 0.5, as the chair's; the third, at 1.5, is also the table's.
    let erase = |x: f64| Edit::Erase { template: 0, centres: vec![DVec3::new(x, 0.1, 0.2)], radius: 0.2 };
    run(&mut scene, erase(0.5));
    assert_eq!((scene.template_ranges[0].count, scene.own.len(), scene.own_range(0).count), (1, 2, 1));
    let outcome = run(&mut scene, erase(1.5));
    assert!(outcome.warnings.len() == 1 && scene.own.len() == 2, "{:?}", outcome.warnings);
}

/// The shift is that of the colour that is seen, whatever the matrix makes of the template's.
#[test]
fn recolouring_shifts_what_is_seen() {
    let mut before = scene();
    let fifth = [[0.2, 0.0, 0.0, 0.1], [0.0, 0.2, 0.0, 0.1], [0.0, 0.0, 0.2, 0.1]];
    before.color_from_template = vec![fifth; 5];
    let mut after = before.clone();
    run(&mut after, Edit::Recolour { which: which("1"), rgb: [0.5, 0.0, -0.25] });
    let (was, is) = (before.flatten(), after.flatten());
    // Instance 1 has the Gaussians 2 to 4 of the flat order.
    for i in 0..was.len() {
        let shift = [0, 1, 2].map(|c| SH_C0 as f32 * (is.sh_of(i)[0][c] - was.sh_of(i)[0][c]));
        let want = if (2..5).contains(&i) { [0.5, 0.0, -0.25] } else { [0.0; 3] };
        assert!(shift.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-5), "{i}: {shift:?}");
    }
    // A whole group: its template has the colour too, so that copies made later have it.
    let mixed = [[0.2, 0.5, 0.0, 0.1], [-0.3, 0.4, 0.1, 0.1], [0.0, 0.7, 0.2, 0.1]];
    before.color_from_template[2] = mixed;
    before.color_from_template[3] = mixed.map(|row| row.map(|v| 1.5 * v));
    before.color_from_template[4] = SAME_COLOR;
    let mut after = before.clone();
    run(&mut after, Edit::Recolour { which: which("template:0"), rgb: [0.5, 0.0, -0.25] });
    assert_ne!(after.templates.sh, before.templates.sh);
    for k in 0..before.instances.len() {
        let want = if before.instances[k].template == 0 { [0.5, 0.0, -0.25] } else { [0.0; 3] };
        let (was, is) = (before.flatten_one(k), after.flatten_one(k));
        for i in 0..was.len() {
            let shift = [0, 1, 2].map(|c| SH_C0 as f32 * (is.sh_of(i)[0][c] - was.sh_of(i)[0][c]));
            assert!(shift.iter().zip(want).all(|(a, b)| (a - b).abs() < 1e-5), "{k} {i}: {shift:?}");
        }
    }
    let first = |scene: &InstancedScene| scene.templates.sh[0].map(|v| SH_C0 as f32 * v);
    let (was, is) = (first(&before), first(&after));
    assert!((0..3).all(|c| (is[c] - was[c] - [0.5, 0.0, -0.25][c]).abs() < 1e-5), "{was:?} {is:?}");
    // What would not be finite is refused, and nothing changes.
    before.color_from_template[2][0][0] = 3e38;
    let mut after = before.clone();
    assert!(
        apply(&mut after, &Edit::Recolour { which: which("template:0"), rgb: [1e6, 0.0, 0.0] }).is_err()
            && after == before
    );
}

#[test]
fn deleting_frees_offsets_that_nobody_shares() {
    let before = scene();
    for (selector, left, records) in [
        ("1", vec![4, 9, 7, 8], 4),
        ("3", vec![4, 5, 9, 8], 7),
        ("id:9", vec![4, 5, 7, 8], 7),
        ("group:chair", vec![5], 3),
    ] {
        let mut after = before.clone();
        let outcome = run(&mut after, Edit::Delete { which: which(selector) });
        assert_eq!((ids(&after), after.offsets.len(), after.offsets.sh_rest.len()), (left, records, 3 * records));
        let kept = |&k: &usize| !outcome.removed.contains(&k);
        let want: Vec<Gaussians> = (0..6).filter(kept).map(|k| looks(&before)[k].clone()).collect();
        assert_eq!(looks(&after), want, "{selector}");
    }
}

#[test]
fn swapping_keeps_the_place_and_drops_offsets() {
    let mut before = scene();
    before.color_from_template = vec![SAME_COLOR; 5];
    before.color_from_template[0][1][3] = 0.1;
    let mut after = before.clone();
    let outcome = run(&mut after, Edit::Swap { which: which("id:4"), template: 1 });
    assert_eq!((outcome.changed, after.offsets.len(), &after.color_from_template), (vec![0], 5, &vec![SAME_COLOR; 5]));
    let dropped = |what| format!("the {what} of 1 instances were dropped: they are for another template");
    assert_eq!(outcome.warnings, ["offsets", "colour matrices"].map(dropped));
    assert_eq!((ids(&after), after.groups[1].instance_ids.clone()), (ids(&before), vec![4, 5]));
    assert_eq!(after.instances[0].world_from_template, before.instances[0].world_from_template);
    assert_eq!(looks(&after)[1..], looks(&before)[1..]);
    let same = run(&mut after, Edit::Swap { which: which("id:4"), template: 1 });
    assert_eq!(same, EditOutcome::default());
}

fn plane(count: usize, min_distance: f64, seed: u64, offsets: OffsetSource) -> Edit {
    let over = ScatterOver::Plane {
        point: DVec3::new(1.0, 2.0, 3.0),
        normal: DVec3::new(0.0, -3.0, 0.0),
        extent: [20.0, 10.0],
        min_distance,
        turn: TAU,
        seed,
    };
    Edit::Scatter(Scatter { template: 0, count, over, offsets })
}

#[test]
fn scattering_over_a_plane_keeps_distances_and_stands_on_it() {
    let before = scene();
    let mut after = before.clone();
    let outcome = run(&mut after, plane(40, 1.0, 7, OffsetSource::None));
    assert_eq!(outcome.added, (5..45).collect::<Vec<_>>());
    assert_eq!(looks(&after)[..5], looks(&before)[..5]);
    let mut repeated = before.clone();
    run(&mut repeated, plane(40, 1.0, 7, OffsetSource::None));
    assert_eq!(repeated, after);
    run(&mut repeated, plane(1, 1.0, 8, OffsetSource::None));
    assert_ne!(repeated.instances[45].world_from_template, after.instances[5].world_from_template);
    let level = |k: usize| centre(&after, k) * DVec3::new(1.0, 0.0, 1.0);
    for k in 5..45 {
        assert!((5..k).all(|other| level(k).distance(level(other)) > 1.0 - 1e-5));
        let from_point = level(k) - DVec3::new(1.0, 0.0, 3.0);
        assert!(from_point.x.abs() <= 10.0 + 1e-5 && from_point.z.abs() <= 5.0 + 1e-5, "{from_point}");
        // y points down: the lowest Gaussian is on the plane, with the rotation of the first chair (scale 1).
        let lowest = looks(&after)[k].means.iter().map(|m| m[1]).fold(f32::MIN, f32::max);
        assert!((lowest - 2.0).abs() < 1e-5, "{lowest}");
        assert!((after.instances[k].world_from_template.linear() * DVec3::Y - DVec3::Y).length() < 1e-6);
    }
    let full = apply(&mut before.clone(), &plane(500, 2.0, 1, OffsetSource::None)).unwrap_err().to_string();
    assert!(full.contains("of 500 fit"), "{full}");
}

#[test]
fn scattered_instances_are_turned_as_far_as_asked_for() {
    let turned = |turn: f64| {
        let mut edit = plane(30, 0.0, 7, OffsetSource::None);
        let Edit::Scatter(Scatter { over: ScatterOver::Plane { turn: field, .. }, .. }) = &mut edit else {
            return Vec::new();
        };
        *field = turn;
        let mut after = scene();
        run(&mut after, edit);
        // Up is -y, and the first chair is not rotated.
        let angle = |k: usize| {
            let x = after.instances[k].world_from_template.linear() * DVec3::X;
            x.z.atan2(x.x).rem_euclid(TAU)
        };
        (5..35).map(angle).collect::<Vec<_>>()
    };
    assert!(turned(0.0).iter().all(|a| a.min(TAU - a) < 1e-6));
    let some = turned(0.5);
    assert!(some.iter().all(|a| *a < 0.5 + 1e-6) && some.iter().any(|a| *a > 0.4) && some.iter().any(|a| *a < 0.1));
    assert!(turned(TAU).iter().any(|a| *a > 4.0));
    assert!(turned(-0.5).iter().all(|a| *a > TAU - 0.5 - 1e-6));
}

/// The footprint is the ground rectangle of a chair for any rotation.
#[test]
fn the_footprint_is_where_an_instance_stands() {
    let scene = scene();
    let mut bare = scene.clone();
    bare.instances.iter_mut().for_each(|instance| instance.first_offset = None);
    for k in [0, 2] {
        let (up, look) = (DVec3::NEG_Y, &looks(&bare)[k]);
        let foot = footprint(&scene, k, 3.0 * up);
        let of = |axis: usize| look.means.iter().map(move |m| f64::from(m[axis]));
        let (low, high) = (
            [0, 2].map(|a| of(a).fold(f64::INFINITY, f64::min)),
            [0, 2].map(|a| of(a).fold(f64::NEG_INFINITY, f64::max)),
        );
        for i in 0..2 {
            assert!((foot.extent[i] - (high[i] - low[i])).abs() < 1e-5, "{k} {foot:?}");
        }
        let ground = of(1).fold(f64::NEG_INFINITY, f64::max);
        let want = DVec3::new((low[0] + high[0]) / 2.0, ground, (low[1] + high[1]) / 2.0);
        assert!(foot.point.distance(want) < 1e-5, "{k} {foot:?} {want}");
        let top = of(1).fold(f64::INFINITY, f64::min);
        assert!((foot.height - (ground - top)).abs() < 1e-5, "{k} {foot:?}");
    }
}

#[test]
fn scattered_offsets_are_shared_or_copied() {
    let before = scene();
    for (offsets, records) in [(OffsetSource::Shared(which("id:7")), 7), (OffsetSource::Copied(which("id:7")), 13)] {
        let mut after = before.clone();
        run(&mut after, plane(3, 0.0, 1, offsets));
        assert_eq!((after.offsets.len(), after.offsets.sh_rest.len()), (records, 3 * records));
        let opacities = |k: usize| looks(&after)[k].opacity_logits.clone();
        assert!((5..8).all(|k| opacities(k) == opacities(3)));
    }
    for (source, want) in [("id:9", "has neither offsets"), ("1", "are for template 1"), ("77", "there is no instance")]
    {
        let error = apply(&mut before.clone(), &plane(3, 0.0, 1, OffsetSource::Shared(which(source)))).unwrap_err();
        assert!(error.to_string().contains(want), "{error}");
    }
}

#[test]
fn scattering_along_a_path_is_even_and_turned_along_it() {
    let before = scene();
    let path = |points: &[[f64; 3]], count, yaw| {
        let points = points.iter().map(|&p| DVec3::from_array(p)).collect();
        let over = ScatterOver::Path { points, up: DVec3::NEG_Y, yaw };
        Edit::Scatter(Scatter { template: 0, count, over, offsets: OffsetSource::None })
    };
    let corner = [[0.0, 2.0, 0.0], [4.0, 2.0, 0.0], [4.0, 2.0, 0.0], [4.0, 2.0, 6.0]];
    let mut after = before.clone();
    run(&mut after, path(&corner, 6, 0.0));
    let want = [[0.0, 0.0], [2.0, 0.0], [4.0, 0.0], [4.0, 2.0], [4.0, 4.0], [4.0, 6.0]];
    for (i, spot) in want.into_iter().enumerate() {
        let at = centre(&after, 5 + i);
        assert!((at.x - spot[0]).abs() + (at.z - spot[1]).abs() < 1e-5, "{at}");
        // The first chair is not rotated: its x axis is the template's.
        let forward = after.instances[5 + i].world_from_template.linear() * DVec3::X;
        assert!(forward.distance(if i < 3 { DVec3::X } else { DVec3::Z }) < 1e-6, "{i}: {forward}");
    }
    let mut turned = before.clone();
    run(&mut turned, path(&corner, 1, FRAC_PI_2));
    assert!((turned.instances[5].world_from_template.linear() * DVec3::X).distance(DVec3::Z) < 1e-6);
    // A vertical path has no horizontal direction to point along.
    run(&mut turned, path(&[[0.0; 3], [0.0, 5.0, 0.0]], 2, 0.0));
    for bad in [
        path(&corner[..1], 3, 0.0),
        path(&[[1.0; 3], [1.0; 3]], 3, 0.0),
        path(&corner, 0, 0.0),
        path(&[[f64::NAN; 3]; 2], 2, 0.0),
    ] {
        assert!(apply(&mut before.clone(), &bad).is_err());
    }
}

#[test]
fn tensors_of_other_versions_go_when_they_would_no_longer_fit() {
    let foreign = || ForeignTensor { dtype: "U8".into(), shape: vec![1], bytes: vec![1] };
    let mut before = scene();
    for name in ["instance.tint", "offset.extra", "x.odd"] {
        before.foreign_tensors.insert(name.into(), foreign());
    }
    let left = |edit: Edit| {
        let mut after = before.clone();
        let outcome = run(&mut after, edit);
        assert_eq!(outcome.warnings.len(), 3 - after.foreign_tensors.len());
        after.foreign_tensors.into_keys().collect::<Vec<_>>()
    };
    assert_eq!(left(Edit::Delete { which: which("0") }), ["x.odd"]);
    assert_eq!(left(Edit::Delete { which: which("id:9") }), ["offset.extra", "x.odd"]);
    assert_eq!(left(Edit::Recolour { which: which("id:9"), rgb: [0.1; 3] }), ["instance.tint", "x.odd"]);
    assert_eq!(left(Edit::MoveBy { which: which("0"), by: DVec3::X }).len(), 3);
}

#[test]
fn scenes_and_templates_without_gaussians() {
    let mut scene =
        InstancedScene { template_ranges: vec![SourceRange { first: 0, count: 0 }], ..InstancedScene::default() };
    let outcome = apply(&mut scene, &plane(2, 0.5, 1, OffsetSource::None)).unwrap();
    assert_eq!(outcome.added, [0, 1]);
    apply(&mut scene, &Edit::Recolour { which: which("0"), rgb: [0.1; 3] }).unwrap();
    apply(&mut scene, &Edit::Delete { which: which("template:0") }).unwrap();
    scene.validate().unwrap();
    let error = apply(&mut InstancedScene::default(), &plane(2, 0.5, 1, OffsetSource::None)).unwrap_err().to_string();
    assert!(error.contains("the scene has none"), "{error}");
}
