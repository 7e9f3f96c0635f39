//! Poses found on clouds of known scenes: points of the true surfaces that cameras see stand in for a trained cloud.

#![allow(clippy::print_stdout, reason = "tests report what they measured with --nocapture")]

use std::collections::{BTreeMap, BTreeSet};
use std::f64::consts::{PI, TAU};

use glam::{DMat3, DVec3, Vec3};
use instgs_vk::math::covariance::{quat_from_rotation, rotation_from_quat};
use instgs_vk::math::eigen::symmetric_eigen;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::SH_C0;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::register::{RegisterError, RegisterInput, RegisterOptions, Registered, Verdict, register};
use instgs_vk::scene::{Camera, Gaussians, PosedGroup};
use instgs_vk::synth::dataset::frame::Lens;
use instgs_vk::synth::dataset::world::Point;
use instgs_vk::synth::dataset::{Options, build, truth};

/// Rotation right within this, degrees; translation within this part of the object's size. As issue 5 has it.
const DEGREES: f64 = 1.0;
const PART: f64 = 0.01;

/// A labelled cloud and what is true of it.
struct Labelled {
    cloud: Gaussians,
    labels: Vec<u32>,
    categories: BTreeMap<u32, String>,
    cameras: Vec<Camera>,
    truth: Vec<PosedGroup>,
}

/// What a cloud is made with.
#[derive(Clone, Copy)]
struct Recipe {
    scene: &'static str,
    instances: Option<u32>,
    seed: u64,
    /// Cameras stand around so many radians; TAU is all around.
    azimuths: f64,
    /// Deviation of the points' places, as a part of the object's size.
    noise: f64,
}

impl Recipe {
    const fn new(scene: &'static str, seed: u64) -> Self {
        Self { scene, instances: None, seed, azimuths: TAU, noise: 0.003 }
    }

    /// One flat Gaussian for each cell of `spacing` that a ray of a camera meets.
    fn labelled(self) -> Labelled {
        let options =
            Options { views: 40, size: (240, 135), seed: self.seed, instances: self.instances, ..Options::default() };
        let scene = build(self.scene, &options).unwrap();
        let rig = instgs_vk::synth::dataset::views::Rig {
            azimuths: (scene.rig.azimuths.0, scene.rig.azimuths.1.min(self.azimuths)),
            ..scene.rig.clone()
        };
        let cameras = rig.cameras(options.views, options.size, options.seed);
        let truth = truth::groups(&scene);
        let size = truth.iter().flat_map(|g| sizes(&scene, g)).collect::<BTreeMap<u32, f64>>();
        let mut rng = Rng::new(self.seed).fork(0x7E57);
        let mut seen = BTreeSet::new();
        let (mut cloud, mut labels) = (Gaussians::with_capacity(0, 0), Vec::new());
        for camera in &cameras {
            let lens = Lens::new(camera);
            for y in 0..camera.height {
                for x in 0..camera.width {
                    let ray = lens.ray(f64::from(x) + rng.uniform(), f64::from(y) + rng.uniform());
                    let Some(hit) = scene.world.closest(&ray) else { continue };
                    let id = scene.world.id_of(&hit);
                    let spacing = size.get(&id).map_or(0.4, |size| size / 45.0);
                    let at = ray.at(hit.t).as_dvec3();
                    let cell = (at / spacing).floor().to_array().map(|c| c as i64);
                    if seen.insert((id, cell)) {
                        push(
                            &mut cloud,
                            &scene.world.point(&ray, &hit, lens.footprint),
                            (spacing, self.noise),
                            &mut rng,
                        );
                        labels.push(id);
                    }
                }
            }
        }
        let named = |g: &PosedGroup| g.instances.iter().map(|i| (i.id, g.name.clone().unwrap())).collect::<Vec<_>>();
        let categories = truth.iter().flat_map(named).collect();
        Labelled { cloud, labels, categories, cameras, truth }
    }
}

/// The diagonals of the objects' boxes by id.
fn sizes(scene: &instgs_vk::synth::dataset::stage::Scene, group: &PosedGroup) -> Vec<(u32, f64)> {
    let bodies = scene.world.bodies().iter().filter(|b| group.instances.iter().any(|i| i.id == b.id));
    let size = |b: &instgs_vk::synth::dataset::world::Body| {
        f64::from(scene.world.object_bounds(b).diagonal()) * b.world_from_object.scale()
    };
    bodies.map(|b| (b.id, size(b))).collect()
}

/// A disc on the surface, a little off, as training leaves them: also tilted, and of uneven size.
fn push(cloud: &mut Gaussians, point: &Point, (spacing, noise): (f64, f64), rng: &mut Rng) {
    let normal = (point.flat_normal.as_dvec3() + 0.15 * rng.normal_vector()).normalize();
    let side = normal.any_orthonormal_vector();
    cloud.means.push((point.position.as_dvec3() + noise * rng.normal_vector()).as_vec3().to_array());
    cloud.quats.push(quat_from_rotation(DMat3::from_cols(side, normal.cross(side), normal)).map(|q| q as f32));
    let wide = (0.4 * spacing * (0.4 * rng.normal()).exp()).ln() as f32;
    cloud.log_scales.push([wide, wide, wide - 2.0]);
    cloud.opacity_logits.push(rng.range(-0.5, 3.0) as f32);
    let shade = point.surface.albedo.as_dvec3().powf(1.0 / 2.2) + 0.04 * rng.normal_vector();
    cloud.sh.push(((shade - 0.5) / SH_C0).as_vec3().to_array());
}

impl Labelled {
    fn register(&self, options: &RegisterOptions) -> Result<Registered, RegisterError> {
        register(&self.input(&self.categories), None, options)
    }

    fn input<'a>(&'a self, categories: &'a BTreeMap<u32, String>) -> RegisterInput<'a> {
        RegisterInput { cloud: &self.cloud, instance_of_gaussian: &self.labels, categories, cameras: &self.cameras }
    }
}

/// Turns about the vertical, evenly spread, after which an object is the same: tables have two ends, vases are round.
fn symmetry(name: Option<&str>) -> usize {
    match name {
        Some("table") => 2,
        Some("vase") => 720,
        _ => 1,
    }
}

/// Angle in degrees and distance as a part of the size between the found and the true pose of an object, relative to the
/// found group's reference and up to symmetry.
fn pose_error(labelled: &Labelled, group: &PosedGroup, id: u32) -> Option<(f64, f64)> {
    let pose = |group: &PosedGroup, id: u32| group.instances.iter().find(|i| i.id == id).map(|i| i.world_from_template);
    let reference = &group.instances[0];
    let found = pose(group, id)?;
    let truth = labelled.truth.iter().find(|g| pose(g, id).is_some())?;
    let (to, from) = (pose(truth, id)?, pose(truth, reference.id)?);
    let own = (0..labelled.labels.len()).filter(|&i| labelled.labels[i] == id);
    let points: Vec<DVec3> = own.map(|i| Vec3::from(labelled.cloud.means[i]).as_dvec3()).collect();
    let (low, high) = points.iter().fold((points[0], points[0]), |(l, h), p| (l.min(*p), h.max(*p)));
    let count = symmetry(truth.name.as_deref());
    let errors = (0..count).map(|k| {
        let own_turn = DMat3::from_rotation_z(TAU * k as f64 / count as f64);
        let linear = to.linear() * own_turn * from.linear().inverse();
        let middle = reference.world_from_template.translation();
        let want = linear * (middle - from.translation()) + to.translation();
        let turn = found.rotation().transpose() * (linear * (1.0 / linear.determinant().cbrt()));
        let trace = turn.x_axis.x + turn.y_axis.y + turn.z_axis.z;
        let degrees = (0.5 * (trace - 1.0)).clamp(-1.0, 1.0).acos().to_degrees();
        (degrees, want.distance(found.translation()) / low.distance(high))
    });
    errors.min_by(|a, b| a.0.total_cmp(&b.0))
}

/// What came out of a scene.
#[derive(Default, Debug)]
struct Score {
    right: usize,
    /// Wrong, but said so.
    flagged: usize,
    /// Right, but put in doubt.
    doubted: usize,
    /// Wrong, and nothing said.
    silent: usize,
    worst: (f64, f64),
}

fn score(labelled: &Labelled, found: &Registered) -> Score {
    let mut out = Score::default();
    for instance in found.instances.iter().filter(|i| i.verdict != Verdict::Reference) {
        let error = found.groups.iter().find_map(|g| pose_error(labelled, g, instance.instance));
        let right = error.is_some_and(|(degrees, part)| degrees < DEGREES && part < PART);
        let doubt = matches!(instance.verdict, Verdict::Ambiguous | Verdict::Rejected);
        match (right, doubt) {
            (true, false) => out.right += 1,
            (true, true) => (out.right, out.doubted) = (out.right + 1, out.doubted + 1),
            (false, true) => out.flagged += 1,
            (false, false) => out.silent += 1,
        }
        if let Some((degrees, part)) = error.filter(|_| !doubt) {
            out.worst = (out.worst.0.max(degrees), out.worst.1.max(part));
        }
        if !right || doubt {
            println!("  {error:.3?} {instance:?}");
        }
    }
    out
}

fn measured(recipe: Recipe) -> Score {
    let labelled = recipe.labelled();
    let started = std::time::Instant::now();
    let found = labelled.register(&RegisterOptions::default()).unwrap();
    let seconds = started.elapsed().as_secs_f64();
    let score = score(&labelled, &found);
    println!("{} seed {}: {score:?}, {} Gaussians, {seconds:.2} s", recipe.scene, recipe.seed, labelled.cloud.len());
    score
}

fn recipe(scene: &'static str, instances: u32, seed: u64) -> Recipe {
    Recipe { instances: Some(instances), ..Recipe::new(scene, seed) }
}

/// How an object is made coarse: into how many Gaussians, and how.
#[derive(Clone, Copy, Debug)]
enum Coarse {
    /// Each stands for the points nearest to it, with their mean and spread.
    Merged(usize),
    /// Some of the points, wider; and as many faint ones that are off.
    Sampled(usize),
}

impl Labelled {
    /// The same scene with few Gaussians for each object.
    fn coarse(&self, how: Coarse, seed: u64) -> Self {
        let (mut cloud, mut labels) = (Gaussians::with_capacity(0, 0), Vec::new());
        let mut rng = Rng::new(seed).fork(0xC0A5);
        for &id in self.categories.keys() {
            let own: Vec<usize> = (0..self.labels.len()).filter(|&i| self.labels[i] == id).collect();
            match how {
                Coarse::Merged(count) => self.push_merged(&own, count, &mut cloud, &mut rng),
                Coarse::Sampled(count) => self.push_sampled(&own, count, &mut cloud, &mut rng),
            }
            labels.resize(cloud.len(), id);
        }
        let (categories, cameras, truth) = (self.categories.clone(), self.cameras.clone(), self.truth.clone());
        Self { cloud, labels, categories, cameras, truth }
    }

    fn place(&self, i: usize) -> DVec3 {
        Vec3::from(self.cloud.means[i]).as_dvec3()
    }

    fn drawn(own: &[usize], count: usize, rng: &mut Rng) -> Vec<usize> {
        let mut order = own.to_vec();
        rng.shuffle(&mut order);
        order.truncate(count);
        order
    }

    fn push_merged(&self, own: &[usize], count: usize, cloud: &mut Gaussians, rng: &mut Rng) {
        let centres = Self::drawn(own, count, rng);
        let mut parts = vec![Vec::new(); centres.len()];
        for &i in own {
            let distance = |c: &usize| self.place(centres[*c]).distance_squared(self.place(i));
            let nearest = (0..centres.len()).min_by(|a, b| distance(a).total_cmp(&distance(b))).unwrap();
            parts[nearest].push(i);
        }
        for part in parts.iter().filter(|part| !part.is_empty()) {
            let mean = part.iter().map(|&i| self.place(i)).sum::<DVec3>() / part.len() as f64;
            let mut moments = [[0.0; 3]; 3];
            for d in part.iter().map(|&i| self.place(i) - mean) {
                (0..9).for_each(|k| moments[k / 3][k % 3] += d[k / 3] * d[k % 3] / part.len() as f64);
            }
            let [thin, middle, long] = symmetric_eigen(moments);
            let axes = [long, middle, thin].map(|(_, v)| DVec3::from_array(v));
            let rotation = DMat3::from_cols(axes[0], axes[1], axes[0].cross(axes[1]));
            let scale = |pair: (f64, [f64; 3])| pair.0.max(1e-10).sqrt().ln() as f32;
            cloud.means.push(mean.as_vec3().to_array());
            cloud.quats.push(quat_from_rotation(rotation).map(|q| q as f32));
            cloud.log_scales.push([scale(long), scale(middle), scale(thin)]);
            cloud.opacity_logits.push(rng.range(0.5, 3.0) as f32);
            cloud.sh.push(self.cloud.sh[part[0]]);
        }
    }

    fn push_sampled(&self, own: &[usize], count: usize, cloud: &mut Gaussians, rng: &mut Rng) {
        let drawn = Self::drawn(own, 2 * count, rng);
        // As wide as to cover what the left out ones did.
        let wider = (own.len() as f64 / count as f64).sqrt().ln().min(2.0) as f32;
        let (low, high) = own.iter().fold((self.place(own[0]), self.place(own[0])), |(low, high), &i| {
            (low.min(self.place(i)), high.max(self.place(i)))
        });
        for (k, &i) in drawn.iter().enumerate() {
            let faint = k >= count;
            let off = if faint { 0.01 * low.distance(high) } else { 0.0 } * rng.normal_vector();
            cloud.means.push((self.place(i) + off).as_vec3().to_array());
            cloud.quats.push(self.cloud.quats[i]);
            cloud.log_scales.push(self.cloud.log_scales[i].map(|s| s + wider));
            cloud.opacity_logits.push(if faint { -1.3 } else { rng.range(0.0, 3.0) as f32 });
            cloud.sh.push(self.cloud.sh[i]);
        }
    }
}

/// What comes of coarse objects of a scene.
fn of_coarse(recipe: Recipe, how: Coarse) -> (Labelled, Registered) {
    let labelled = recipe.labelled().coarse(how, recipe.seed);
    let found = labelled.register(&RegisterOptions::default()).unwrap();
    (labelled, found)
}

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
    for id in 1..=9u32 {
        for i in 0..60 {
            let free = rng.normal_vector().as_vec3();
            let mean = match id {
                1 => Vec3::ONE,
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
            let log_scale = if id == 9 { -200.0 } else { -4.0 };
            cloud.log_scales.push([log_scale; 3]);
            cloud.opacity_logits.push(2.0);
            cloud.sh.push([0.1 * i as f32; 3]);
            labels.push(id);
        }
    }
    for allow_scale in [false, true] {
        for named in [false, true] {
            let names = (1..=9).map(|id| (id, "thing".to_owned())).filter(|_| named).collect();
            let input =
                RegisterInput { cloud: &cloud, instance_of_gaussian: &labels, categories: &names, cameras: &[] };
            let options = RegisterOptions { allow_scale, min_inliers: 0.0, ..RegisterOptions::default() };
            let found = register(&input, None, &options).unwrap();
            assert_eq!(found.instances.iter().map(|i| i.instance).collect::<Vec<_>>(), (1..=9).collect::<Vec<_>>());
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
    assert!(text(&Labelled { cloud, ..labels }, of(0.3)).contains("quaternions"));
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
