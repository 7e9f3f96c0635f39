//! Poses found on clouds of known scenes: points of the true surfaces that cameras see stand in for a trained cloud.

mod coarse;
pub(crate) mod labelled;
mod painted;
mod score;

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3, Vec3};
use instgs_objects::register::{RegisterInput, RegisterOptions, Registered, Verdict, polished, register};
use instgs_vk::math::covariance::{quat_from_rotation, rotation_from_quat};
use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{Gaussians, PosedGroup};

use self::coarse::{Coarse, of_coarse};
use self::labelled::{Labelled, Recipe, recipe};
use self::score::{Score, measured, pose_error, score};

/// Objects of 15 to 25 Gaussians are up to 20 degrees off, and all that are off are in doubt. Measured: without the spread
/// of halves 32 of 45 would not be, which is the planted error.
#[test]
fn coarse_objects_are_never_off_in_silence() {
    let mut silent_without = 0;
    for (scene, objects) in [("cars", 5), ("hall", 9)] {
        for how in [Coarse::Sampled(15), Coarse::Sampled(20), Coarse::Sampled(25), Coarse::Merged(25)] {
            let (labelled, mut found) = of_coarse(recipe(scene, objects, 3), how);
            let with = score(&labelled, &found);
            println!("{scene} {how:?}: {with:?}");
            assert_eq!(with.silent, 0, "{scene} {how:?}: {with:?}");
            for instance in found.instances.iter_mut().filter(|i| i.note.starts_with("halves")) {
                instance.verdict = Verdict::Accepted;
            }
            silent_without += score(&labelled, &found).silent;
        }
    }
    println!("without the measure {silent_without} silent misses");
    assert!(silent_without > 10, "{silent_without}");
}

/// Coarse to fine; minutes.
#[test]
#[ignore = "a table of minutes; see the docs of `register`"]
fn from_coarse_to_fine() {
    let sampled = [15, 20, 25, 50].map(Coarse::Sampled);
    let merged = [25, 40, 80, 160, 400].map(Coarse::Merged);
    for (scene, objects) in [("cars", 6), ("hall", 12)] {
        for how in sampled.into_iter().chain(merged) {
            let mut sum = Score::default();
            for seed in 0..2 {
                let (labelled, found) = of_coarse(recipe(scene, objects, seed), how);
                let score = score(&labelled, &found);
                sum.right += score.right;
                sum.flagged += score.flagged;
                sum.doubted += score.doubted;
                sum.silent += score.silent;
                sum.worst = (sum.worst.0.max(score.worst.0), sum.worst.1.max(score.worst.1));
            }
            println!("{scene} {how:?}: {sum:?}");
        }
    }
}

/// Measured over 20 seeds: see the docs of `register`.
#[test]
fn cars_and_furniture_are_found_where_they_stand() {
    // The hall's vases are nearly round: how they are turned is uncertain.
    for (scene, objects, groups, most_doubted) in [("cars", 5, 1, 0), ("hall", 18, 3, 3)] {
        let score = measured(recipe(scene, objects, 4));
        assert!(score.silent == 0 && score.right >= (objects - groups) as usize - 1, "{score:?}");
        assert!(score.doubted <= most_doubted, "{score:?}");
    }
}

/// Only half of each object was seen: what is wrong must be said. The planted error shows that the score can fail.
#[test]
fn objects_seen_from_one_side_are_right_or_in_doubt() {
    let labelled = Recipe { azimuths: 0.9 * PI, ..recipe("cars", 4, 2) }.labelled();
    let mut found = labelled.register(&RegisterOptions::default()).unwrap();
    let before = score(&labelled, &found);
    assert_eq!(before.silent, 0, "{before:?}");
    let moved = found.groups[0].instances.last_mut().unwrap();
    let pose = moved.world_from_template;
    moved.world_from_template = Similarity::from_parts(pose.rotation(), 1.0, pose.translation() + DVec3::X * 0.1);
    assert!(score(&labelled, &found).silent == 1 || before.flagged > 0);
}

/// Poses that are given 2 degrees and 2 % off end where the objects are; exact ones stay as they are.
#[test]
fn given_poses_are_refined() {
    for (scene, objects, allow_scale) in [("cars", 4, false), ("orchard", 4, true)] {
        let labelled = recipe(scene, objects, 6).labelled();
        let options = RegisterOptions { allow_scale, ..RegisterOptions::default() };
        let refine = |groups: &[PosedGroup]| polished(&labelled.input(&BTreeMap::new()), groups, &options).unwrap();
        let mut rng = Rng::new(9);
        let mut off = labelled.truth.clone();
        for instance in &mut off[0].instances[1..] {
            let pose = instance.world_from_template;
            let own = (0..labelled.labels.len()).filter(|&i| labelled.labels[i] == instance.id);
            let points: Vec<DVec3> = own.map(|i| Vec3::from(labelled.cloud.means[i]).as_dvec3()).collect();
            let (low, high) = points.iter().fold((points[0], points[0]), |(l, h), p| (l.min(*p), h.max(*p)));
            let turn = DMat3::from_axis_angle(rng.normal_vector().normalize(), 2.0_f64.to_radians());
            let shift = rng.normal_vector().normalize() * 0.02 * low.distance(high);
            let scale = if allow_scale { 1.01 } else { 1.0 };
            instance.world_from_template =
                Similarity::from_parts(turn * pose.rotation(), scale * pose.scale(), pose.translation() + shift);
        }
        let errors = |groups: &[PosedGroup]| -> Vec<(f64, f64)> {
            groups[0].instances[1..].iter().map(|i| pose_error(&labelled, &groups[0], i.id).unwrap()).collect()
        };
        let found = refine(&off);
        println!("{scene}: {:.3?} -> {:.3?}", errors(&off), errors(&found));
        assert!(errors(&off).iter().all(|e| e.0 > 1.9 && e.1 > 0.015));
        assert!(errors(&found).iter().all(|e| e.0 < 0.5 && e.1 < 0.005), "{:?}", errors(&found));
        assert_eq!(found[0].instances[0], off[0].instances[0]);
        assert_eq!(refine(&labelled.truth), labelled.truth, "{scene}");
    }
    // Nothing to lay on each other.
    let labelled = recipe("cars", 2, 6).labelled();
    let mut strangers = labelled.truth.clone();
    strangers[0].instances[1].id = 77;
    let none = BTreeMap::new();
    assert_eq!(polished(&labelled.input(&none), &strangers, &RegisterOptions::default()).unwrap(), strangers);
}

/// Features find a car that lies on its side, where no turn about the vertical leads.
#[test]
fn a_tilted_object_is_found_by_its_shape() {
    let mut labelled = recipe("cars", 3, 5).labelled();
    let id = labelled.truth[0].instances[2].id;
    let middle = labelled.truth[0].instances[2].world_from_template.translation();
    let turn = DMat3::from_axis_angle(DVec3::new(0.8, 0.6, 0.0), 1.4);
    let moved = |p: DVec3| turn * (p - middle) + middle;
    for i in (0..labelled.labels.len()).filter(|&i| labelled.labels[i] == id) {
        let mean = moved(Vec3::from(labelled.cloud.means[i]).as_dvec3());
        let rotation = turn * rotation_from_quat(labelled.cloud.quats[i].map(f64::from));
        labelled.cloud.means[i] = mean.as_vec3().to_array();
        labelled.cloud.quats[i] = quat_from_rotation(rotation).map(|q| q as f32);
    }
    let pose = &mut labelled.truth[0].instances[2].world_from_template;
    *pose = Similarity::from_parts(turn * pose.rotation(), 1.0, moved(pose.translation()));
    let found = labelled.register(&RegisterOptions::default()).unwrap();
    let score = score(&labelled, &found);
    assert!(score.silent == 0 && score.right == 2, "{score:?}");
}

/// Trees of 0.7 to 1.3 times the size.
#[test]
fn sizes_are_found_if_they_may_differ() {
    let labelled = recipe("orchard", 4, 1).labelled();
    let options = RegisterOptions { allow_scale: true, ..RegisterOptions::default() };
    let found = labelled.register(&options).unwrap();
    let score = score(&labelled, &found);
    assert!(score.silent == 0 && score.right == 3, "{score:?}");
    let pose = |g: &PosedGroup, id| g.instances.iter().find(|i| i.id == id).unwrap().world_from_template;
    let (found, truth) = (&found.groups[0], &labelled.truth[0]);
    let first = found.instances[0].id;
    for id in found.instances.iter().map(|i| i.id) {
        let want = pose(truth, id).scale() / pose(truth, first).scale();
        assert!((pose(found, id).scale() / want - 1.0).abs() < 0.01, "{} {want}", pose(found, id).scale());
    }
}

/// Without names, chairs, tables and vases are told apart (a vase without flowers has no like); the same input gives the same answer, with any number of threads.
#[test]
fn groups_are_found_without_names() {
    let labelled = recipe("hall", 9, 7).labelled();
    let none = BTreeMap::new();
    let run = || register(&labelled.input(&none), None, &RegisterOptions::default()).unwrap();
    let found = run();
    let kind = |id: u32| labelled.categories.get(&id).unwrap();
    for group in &found.groups {
        assert!(group.instances.iter().all(|i| kind(i.id) == kind(group.instances[0].id)), "{group:?}");
    }
    let grouped: usize = found.groups.iter().map(|g| g.instances.len()).sum();
    assert!(grouped >= 6 && found.groups.len() <= 3, "{:?}", found.instances);
    let one_thread = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert_eq!(found, one_thread.install(run));
}

/// A car and a chair of one name have nothing to share; nor has an object alone.
#[test]
fn objects_that_are_not_alike_stay_in_the_background() {
    let labelled = Recipe::new("unrelated", 1).labelled();
    let found = labelled.register(&RegisterOptions::default()).unwrap();
    assert!(found.groups.is_empty() && found.instances.len() == 2);
    assert!(found.instances.iter().all(|i| !i.accepted && !i.note.is_empty()), "{:?}", found.instances);
    let first = labelled.labels.iter().map(|&id| if id == 1 { 1 } else { 0 }).collect();
    let alone = Labelled { labels: first, ..labelled };
    let found = alone.register(&RegisterOptions::default()).unwrap();
    assert!(found.groups.is_empty() && found.instances[0].note.contains("the only object"), "{:?}", found.instances);
}

/// Clouds that no surface can be made of: no panic, and each object has a reason.
#[test]
fn degenerate_objects_are_rejected_with_a_reason() {
    let mut rng = Rng::new(3);
    let mut cloud = Gaussians::with_capacity(0, 0);
    let mut labels = Vec::new();
    for id in 1..=10u32 {
        for i in 0..60 {
            let free = rng.normal_vector().as_vec3();
            let mean = match id {
                1 | 10 => Vec3::ONE,
                2 => Vec3::X * free.x,
                3 => Vec3::new(free.x, free.y, 0.0),
                4 => free * 1e30,
                5 => free * f32::NAN,
                6 if i > 0 => continue,
                7 => Vec3::X * (i % 2) as f32,
                _ => free,
            };
            cloud.means.push(mean.to_array());
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            let log_scale = if id >= 9 { -200.0 } else { -4.0 };
            cloud.log_scales.push([log_scale; 3]);
            cloud.opacity_logits.push(2.0);
            cloud.sh.push([0.1 * i as f32; 3]);
            labels.push(id);
        }
    }
    for allow_scale in [false, true] {
        for named in [false, true] {
            let names = (1..=10).map(|id| (id, "thing".to_owned())).filter(|_| named).collect();
            let input =
                RegisterInput { cloud: &cloud, instance_of_gaussian: &labels, categories: &names, cameras: &[] };
            let options = RegisterOptions { allow_scale, min_inliers: 0.0, ..RegisterOptions::default() };
            let found = register(&input, None, &options).unwrap();
            assert_eq!(found.instances.iter().map(|i| i.instance).collect::<Vec<_>>(), (1..=10).collect::<Vec<_>>());
            assert!(found.instances.iter().all(|i| i.accepted || !i.note.is_empty()));
            let poses = found.groups.iter().flat_map(|g| &g.instances);
            assert!(
                poses.map(|i| i.world_from_template.rows()).all(|r| r.as_flattened().iter().all(|v| v.is_finite()))
            );
        }
    }
}

#[test]
fn input_that_does_not_fit_is_named() {
    let labelled = Labelled {
        cloud: Gaussians::with_capacity(0, 0),
        labels: Vec::new(),
        categories: BTreeMap::new(),
        cameras: Vec::new(),
        truth: Vec::new(),
    };
    assert_eq!(labelled.register(&RegisterOptions::default()).unwrap(), Registered::default());
    let text = |labelled: &Labelled, options: RegisterOptions| labelled.register(&options).unwrap_err().to_string();
    let of = |min_opacity| RegisterOptions { min_opacity, ..RegisterOptions::default() };
    assert!(text(&labelled, of(f64::NAN)).contains("min_opacity"));
    assert!(text(&labelled, RegisterOptions { voxels_per_size: 1e9, ..of(0.3) }).contains("voxels_per_size"));
    let labels = Labelled { labels: vec![1], ..labelled };
    assert!(text(&labels, of(0.3)).contains("1 labels for 0 Gaussians"));
    let mut cloud = Gaussians::with_capacity(0, 0);
    cloud.means.push([0.0; 3]);
    assert!(text(&Labelled { cloud, ..labels }, of(0.3)).contains("quats"));
}

/// The whole of what issue 5 asks for; minutes.
#[test]
#[ignore = "20 seeds take minutes; prints a table"]
fn twenty_seeds() {
    for (scene, azimuths) in [("hall", TAU), ("cars", TAU), ("facade", TAU), ("cars", 0.9 * PI)] {
        let (mut right, mut all, mut silent, mut doubted) = (0, 0, 0, 0);
        for seed in 0..20 {
            let score = measured(Recipe { azimuths, ..Recipe::new(scene, seed) });
            right += score.right;
            silent += score.silent;
            doubted += score.doubted;
            all += score.right + score.flagged + score.silent;
        }
        println!("{scene} {azimuths:.2}: {right} of {all} right, {doubted} of them in doubt, {silent} silent misses");
    }
}
