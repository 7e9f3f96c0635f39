use std::collections::{BTreeMap, BTreeSet};

use super::*;
use instgs_io::dataset::{Split, read_views};
use instgs_io::groups::read_groups;
use instgs_io::masks::{read_categories, read_mask};
use instgs_vk::math::similarity::Similarity;

const TINY: Options =
    Options { views: 9, size: (25, 17), seed: 3, instances: None, differences: 1.0, flight: None, pose_noise: None };

fn bytes_below(folder: &Path) -> BTreeMap<String, Vec<u8>> {
    let mut out = BTreeMap::new();
    for entry in std::fs::read_dir(folder).unwrap().flatten() {
        let (path, name) = (entry.path(), entry.file_name().to_string_lossy().into_owned());
        match path.is_dir() {
            true => out.extend(bytes_below(&path).into_iter().map(|(file, bytes)| (format!("{name}/{file}"), bytes))),
            false => drop(out.insert(name, std::fs::read(&path).unwrap())),
        }
    }
    out
}

/// The same bytes twice, with one thread, too; other bytes for another seed. Nothing of an older data set in the folder
/// remains.
#[test]
fn the_same_options_give_the_same_bytes() {
    let folder = tempfile::tempdir().unwrap();
    let noisy = Options { views: 3, size: (16, 9), pose_noise: Some(PoseNoise { degrees: 2.0, part: 0.02 }), ..TINY };
    let make = |options: &Options, name: &str| {
        write::<SynthError>("unrelated", &folder.path().join(name), options, &mut |_| Ok(())).unwrap();
        bytes_below(&folder.path().join(name))
    };
    let first = make(&noisy, "a");
    let single = rayon::ThreadPoolBuilder::new().num_threads(1).build().unwrap();
    assert!(first == single.install(|| bytes_of(&folder.path().join("b"), &noisy)));
    assert_eq!(first.len(), 3 * 3 + 8, "{:?}", first.keys());
    let other = make(&Options { seed: 4, views: 2, pose_noise: None, ..noisy }, "a");
    assert!(!other.contains_key("images/view_002.png") && !other.contains_key("groups_noisy.json"));
    assert_ne!(other["images/view_001.png"], first["images/view_001.png"]);
    // One that is stopped half way is no data set: what it had of cameras is gone first.
    files::prepare(&folder.path().join("a")).unwrap();
    assert!(read_views(&folder.path().join("a")).is_err());
}

fn bytes_of(out: &Path, options: &Options) -> BTreeMap<String, Vec<u8>> {
    write::<SynthError>("unrelated", out, options, &mut |_| Ok(())).unwrap();
    bytes_below(out)
}

/// With all differences nothing changes; without any, every car has the meshes and the paint of the first.
#[test]
fn differences_shrink_to_none() {
    use super::look::Spot;
    let scene = |differences: f64| build("cars", &Options { differences, ..TINY }).unwrap();
    let meshes = |scene: &Scene| -> Vec<Vec<usize>> {
        scene.world.bodies().iter().filter(|b| b.id > 0).map(|b| b.meshes.clone()).collect()
    };
    let [none, some, all] = [0.0, 0.5, 1.0].map(scene);
    assert!(meshes(&none).iter().all(|m| *m == meshes(&all)[0]));
    assert_eq!(meshes(&some), meshes(&all));
    assert!(meshes(&all).iter().any(|m| *m != meshes(&all)[0]));
    let door = Spot { part: 0, position: glam::Vec3::new(0.7, 0.85, 0.5), normal: glam::Vec3::Y, footprint: 0.01 };
    let paint = |scene: &Scene, id: u32| {
        let body = scene.world.bodies().iter().find(|b| b.id == id).unwrap();
        body.look.surface(&door).albedo
    };
    for id in 2..=8 {
        assert_eq!(paint(&none, id), paint(&all, 1));
        let middle = 0.5 * (paint(&all, 1) + paint(&all, id));
        assert!((paint(&some, id) - middle).length() < 1e-6);
    }
    assert_ne!(paint(&all, 2), paint(&all, 1));
    assert!(build("cars", &Options { differences: 1.5, ..TINY }).is_err_and(|e| e.to_string().contains("differences")));
}

/// The program's own readers read what was written, and the values agree.
#[test]
fn masks_groups_and_split_agree() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path();
    let mut told = Vec::new();
    let options = Options { size: (48, 27), ..TINY };
    let truth = write::<SynthError>("hall", out, &options, &mut |done| {
        told.push(done);
        Ok(())
    })
    .unwrap();
    assert_eq!(told, (0..=9).collect::<Vec<_>>());
    let groups = read_groups(&out.join("groups.json")).unwrap();
    assert_eq!(groups, truth.groups);
    let sizes: Vec<usize> = groups.iter().map(|g| g.instances.len()).collect();
    assert_eq!(sizes, [12, 2, 4]);
    let ids: BTreeSet<u32> = groups.iter().flat_map(|g| g.instances.iter().map(|i| i.id)).collect();
    assert_eq!(ids, (1..=18).collect());
    let names = read_categories(&out.join("masks/categories.json")).unwrap();
    assert_eq!(
        (names.len(), names[&1].as_str(), names[&13].as_str(), names[&18].as_str()),
        (18, "chair", "table", "vase")
    );
    let dataset = read_views(out).unwrap();
    let test: Vec<&str> = dataset.split(Split::Test).map(|v| v.camera.name.as_str()).collect();
    assert_eq!((test, dataset.views.len()), (vec!["view_000", "view_008"], 9));
    let mut seen = BTreeSet::new();
    for (view, camera) in dataset.views.iter().zip(&truth.cameras) {
        let mask = read_mask(&out.join("masks").join(format!("{}.png", camera.name))).unwrap();
        assert_eq!((mask.width, mask.height), options.size);
        seen.extend(mask.ids.iter().map(|&id| u32::from(id)).filter(|&id| id > 0));
        assert!((view.camera.position_world() - camera.position_world()).length() < 1e-9);
    }
    assert!(seen.is_subset(&ids) && seen.len() >= 12, "{seen:?}");
    assert!(instgs_io::read_points(out).unwrap().unwrap().points.len() > 1000);
}

/// Objects of a sparse scene are in at most six training photos, and nearly all in one at least.
#[test]
fn sparse_scenes_show_an_object_in_few_photos() {
    let options = Options { size: (64, 36), ..Options::default() };
    for name in ["lot_sparse", "seats_sparse", "shelf_sparse"] {
        let scene = build(name, &options).unwrap();
        let cameras = scene.rig.cameras(options.views, options.size, options.seed);
        let mut photos: BTreeMap<u32, u32> =
            scene.world.bodies().iter().filter(|b| b.id > 0).map(|b| (b.id, 0)).collect();
        for (_, camera) in cameras.iter().enumerate().filter(|(i, _)| i % 8 != 0) {
            let lens = frame::Lens::new(camera);
            let pixels = (0..64 * 36).map(|i| lens.ray(f64::from(i % 64) + 0.5, f64::from(i / 64) + 0.5));
            let seen: BTreeSet<u32> =
                pixels.filter_map(|ray| scene.world.closest(&ray).map(|hit| scene.world.id_of(&hit))).collect();
            seen.iter().filter(|&&id| id > 0).for_each(|id| *photos.entry(*id).or_default() += 1);
        }
        let most = photos.values().max().copied().unwrap_or_default();
        let unseen = photos.values().filter(|&&n| n == 0).count();
        assert!(most <= 6 && 100 * unseen <= photos.len(), "{name}: {photos:?}");
    }
}

/// The ray towards the posed centre of a window hits that window at that depth.
#[test]
fn the_mask_shows_the_instance_where_its_pose_says() {
    let scene = build("facade", &TINY).unwrap();
    let camera = &scene.rig.cameras(9, (320, 180), 3)[0];
    let lens = frame::Lens::new(camera);
    let mut found = 0;
    for instance in truth::groups(&scene).iter().flat_map(|g| &g.instances) {
        let in_view = camera.rotation() * instance.world_from_template.translation() + camera.translation();
        let (x, y) = (in_view.x / in_view.z * camera.fx + camera.cx, in_view.y / in_view.z * camera.fy + camera.cy);
        let hit = scene.world.closest(&lens.ray(x, y)).unwrap();
        found += u32::from(scene.world.id_of(&hit) == instance.id && (f64::from(hit.t) - in_view.z).abs() < 0.4);
    }
    // A lamp post or a tree may stand in front of some.
    assert!(found >= 12, "{found} of 15");
}

/// A pose maps the reference's surface onto the instance's: rays at a mapped point hit the mapped surface.
#[test]
fn poses_map_the_reference_onto_the_instances() {
    for name in ["cars", "orchard", "facade"] {
        let scene = build(name, &TINY).unwrap();
        for group in truth::groups(&scene) {
            let reference = group.instances[0].world_from_template;
            assert!((reference.rotation() - glam::DMat3::IDENTITY).to_cols_array().iter().all(|v| v.abs() < 1e-6));
            assert!((reference.scale() - 1.0).abs() < 1e-6);
            let body = |id: u32| scene.world.bodies().iter().find(|b| b.id == id).unwrap();
            let own = |id: u32| body(id).world_from_object;
            for instance in &group.instances {
                for corner in scene.world.object_bounds(body(instance.id)).corners() {
                    let on_reference = own(group.instances[0].id).transform_point(corner.as_dvec3());
                    let in_template = on_reference - reference.translation();
                    let want = own(instance.id).transform_point(corner.as_dvec3());
                    let mapped = instance.world_from_template.transform_point(in_template);
                    assert!((mapped - want).length() < 1e-4, "{name} {}: {mapped} {want}", instance.id);
                }
            }
        }
    }
}

#[test]
fn disturbed_poses_are_off_by_exactly_so_much() {
    let noise = PoseNoise { degrees: 2.0, part: 0.02 };
    for (name, scales) in [("cars", false), ("orchard", true)] {
        let scene = build(name, &TINY).unwrap();
        let (truth, off) = (truth::groups(&scene), truth::disturbed_groups(&scene, noise, 1));
        for (t, o) in truth[0].instances.iter().zip(&off[0].instances) {
            let (t, o): (Similarity, Similarity) = (t.world_from_template, o.world_from_template);
            let turn = o.rotation() * t.rotation().transpose();
            let trace = turn.x_axis.x + turn.y_axis.y + turn.z_axis.z;
            let degrees = (0.5 * (trace - 1.0)).acos().to_degrees();
            let stretch = (o.scale() / t.scale() - 1.0).abs();
            assert!((degrees - 2.0).abs() < 0.01, "{name} {degrees}");
            assert!((stretch - if scales { 0.01 } else { 0.0 }).abs() < 1e-5, "{name} {stretch}");
            let shift = (o.translation() - t.translation()).length();
            let size = f64::from(scene.world.object_bounds(&scene.world.bodies()[0]).diagonal()) * t.scale();
            let first = if scales { truth[0].instances[0].id } else { 0 };
            let reference =
                scene.world.bodies().iter().find(|b| b.id == first).map_or(1.0, |b| b.world_from_object.scale());
            assert!((shift / (size * reference) - 0.02).abs() < 1e-4, "{name} {shift}");
        }
    }
}

/// Sampling noise: pictures with other sample positions in their pixels agree.
#[test]
fn pictures_hardly_depend_on_the_seed_of_their_samples() {
    let scene = build("unrelated", &TINY).unwrap();
    let camera = &scene.rig.cameras(9, (160, 90), 3)[2];
    let light = light_of(&scene, std::slice::from_ref(camera), 3);
    let [a, b] = [1, 2].map(|seed| frame::take(&scene, &light, camera, seed, 0));
    assert_eq!((&a.ids, &a.depths), (&b.ids, &b.depths));
    let square = |(a, b): (&u8, &u8)| ((f64::from(*a) - f64::from(*b)) / 255.0).powi(2);
    let mse = a.colors.iter().zip(&b.colors).map(square).sum::<f64>() / a.colors.len() as f64;
    assert!(mse > 0.0 && -10.0 * mse.log10() > NOISE_FLOOR_DB, "{}", -10.0 * mse.log10());
    // No pixel differs by much: a few samples that agree by chance do not finish it.
    let furthest = a.colors.iter().zip(&b.colors).map(|(a, b)| a.abs_diff(*b)).max().unwrap_or(0);
    assert!(furthest < FURTHEST, "{furthest}");
    let distinct: BTreeSet<&[u8]> = a.colors.chunks(3).collect();
    assert!(distinct.len() > 1000, "{} colours", distinct.len());
}

/// For 160x90, where every other pixel has an edge.
const NOISE_FLOOR_DB: f64 = 43.5;
/// Largest difference of a byte between the two.
const FURTHEST: u8 = 56;

#[test]
fn bounds_and_names() {
    let text = |name: &str, options: Options| build(name, &options).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(text("car", TINY).contains("cars, hall, orchard, facade, unrelated"));
    for recipe in &RECIPES {
        let ObjectCount { usual: own, least, most } = recipe.instances;
        for count in [least, own, most] {
            let scene = build(recipe.name, &Options { instances: Some(count), ..TINY }).unwrap();
            let ids: Vec<u32> = scene.kinds.iter().flat_map(|k| k.ids.clone()).collect();
            assert_eq!(ids, (1..=count).collect::<Vec<_>>(), "{}", recipe.name);
        }
        for count in [least - 1, most + 1] {
            assert!(text(recipe.name, Options { instances: Some(count), ..TINY }).contains(&least.to_string()));
        }
    }
    assert!(text("cars", Options { views: 1, ..TINY }).starts_with("views"));
    assert!(text("cars", Options { size: (0, 5), ..TINY }).starts_with("size"));
    let noise = Some(PoseNoise { degrees: f64::NAN, part: 0.0 });
    assert!(text("cars", Options { pose_noise: noise, ..TINY }).starts_with("pose-noise"));
    let folder = tempfile::tempdir().unwrap();
    std::fs::write(folder.path().join("diary.txt"), "mine").unwrap();
    let error = write::<SynthError>("cars", folder.path(), &TINY, &mut |_| Ok(())).unwrap_err();
    assert!(error.to_string().contains("not empty"), "{error}");
}

/// Objects do not intersect: no instance's centre is inside the box of another of its kind, and all are visible.
#[test]
fn every_object_is_seen_from_many_sides() {
    for name in ["cars", "facade"] {
        let scene = build(name, &TINY).unwrap();
        let mut views_of: BTreeMap<u32, usize> = BTreeMap::new();
        for camera in scene.rig.cameras(16, (96, 54), 1) {
            let lens = frame::Lens::new(&camera);
            let centres = (0..96 * 54).map(|i| lens.ray(f64::from(i % 96) + 0.5, f64::from(i / 96) + 0.5));
            let ids: BTreeSet<u32> =
                centres.filter_map(|r| scene.world.closest(&r)).map(|h| scene.world.id_of(&h)).collect();
            ids.into_iter().for_each(|id| *views_of.entry(id).or_default() += 1);
        }
        for id in scene.kinds.iter().flat_map(|k| &k.ids) {
            assert!(views_of.get(id).is_some_and(|&n| n >= 6), "{name}: {id} in {:?} of 16 views", views_of.get(id));
        }
    }
}
