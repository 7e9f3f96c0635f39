//! Pictures of the stages, on the device: colours that stay with their objects, and poses that are seen to be wrong.

use std::collections::BTreeMap;
use std::f64::consts::{PI, TAU};
use std::fs;
use std::path::Path;

use glam::{DMat3, DVec3};
use instgs_io::{Checkpoint, Mask, write_groups, write_mask, write_ply, write_scene_file};
use instgs_objects::pipeline::config::RunConfig;
use instgs_objects::pipeline::{PipelineJob, Prepared};
use instgs_objects::segment::{Consensus, IdTable};
use instgs_objects::template::{TemplateOptions, build};
use instgs_report::stage_pictures::colors::Colors;
use instgs_report::stage_pictures::overlay::{Objects, group_overlay};
use instgs_report::stage_pictures::painter::Painter;
use instgs_report::stage_pictures::{add_trained_templates, draw};
use instgs_report::{GroupOverlay, Rgb8, StagePictures};
use instgs_vk::gpu::Gpu;
use instgs_vk::math::rng::Rng;
use instgs_vk::math::sh::SH_C0;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::{RenderOptions, Renderer};
use instgs_vk::scene::{Camera, Gaussians, InstancedScene, PixelFilter, PosedGroup, PosedInstance};

use crate::common::dataset::photograph;
use crate::common::gpu::{assert_silent, gpu, render_picture};
use crate::common::program::program;

/// Gaussians of an object.
const OWN: usize = 900;
/// The objects' ids.
const IDS: [u32; 3] = [2, 5, 9];

/// A long box with a tower at one end, in one colour.
fn push_object(cloud: &mut Gaussians, pose: &Similarity, color: [f32; 3]) {
    let mut rng = Rng::new(1);
    for i in 0..OWN {
        let mut p = DVec3::new(rng.range(-1.0, 1.0), rng.range(-1.0, 1.0), rng.range(-1.0, 1.0));
        let axis = rng.index(3);
        p[axis] = p[axis].signum();
        let (middle, half) = if i % 3 == 0 { (DVec3::new(0.7, 0.0, 0.5), 0.25) } else { (DVec3::ZERO, 1.0) };
        let p = middle + half * p * DVec3::new(1.0, 0.4, if half < 1.0 { 1.0 } else { 0.3 });
        cloud.means.push(pose.transform_point(p).as_vec3().to_array());
        cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
        cloud.log_scales.push([-2.9; 3]);
        cloud.opacity_logits.push(4.0);
        cloud.sh.push(color.map(|c| (c - 0.5) / SH_C0 as f32));
    }
}

fn turned(angle: f64, at: DVec3) -> Similarity {
    Similarity::from_parts(DMat3::from_rotation_z(angle), 1.0, at)
}

/// Three objects in a row, each turned otherwise, and a label per Gaussian.
fn scene() -> (Gaussians, Vec<u32>, PosedGroup) {
    let mut cloud = Gaussians::with_capacity(0, 0);
    let poses = [(0.4, -3.0), (2.1, 0.0), (4.0, 3.0)].map(|(angle, x)| turned(angle, DVec3::new(x, 0.2, 0.3)));
    for (pose, level) in poses.iter().zip([0.3, 0.6, 0.9]) {
        push_object(&mut cloud, pose, [level, 0.5, 0.8 - 0.5 * level]);
    }
    let labels = (0..cloud.len()).map(|i| IDS[i / OWN]).collect();
    let instances = IDS.iter().zip(poses).map(|(&id, world_from_template)| PosedInstance { id, world_from_template });
    let group = PosedGroup { template_id: 4, name: Some("box".into()), score: None, instances: instances.collect() };
    (cloud, labels, group)
}

fn cameras(count: u32) -> Vec<Camera> {
    let camera = |i: u32| {
        let angle = TAU * (f64::from(i) + 0.3) / f64::from(count);
        let eye = DVec3::new(9.0 * angle.cos(), 9.0 * angle.sin(), 9.0);
        Camera::look_at(&format!("v{i}"), eye, DVec3::ZERO, DVec3::Z, 0.8, (160, 120))
    };
    (0..count).map(camera).collect()
}

fn overlay(gpu: &std::sync::Arc<Gpu>, planted: Similarity) -> GroupOverlay {
    let (cloud, labels, mut group) = scene();
    let own = group.instances[1].world_from_template;
    let rotation = own.rotation() * planted.rotation();
    let at = own.transform_point(planted.translation());
    group.instances[1].world_from_template = Similarity::from_parts(rotation, 1.0, at);
    let (colors, cameras) = (Colors::of_ids(IDS), cameras(8));
    let objects = Objects::new(&cloud, &labels, &cameras, &colors);
    let mut painter = Painter::new(gpu, RenderOptions { background: [0.93; 3], ..RenderOptions::default() }).unwrap();
    group_overlay(&mut painter, &objects, &group, 0, &[0, 1, 2]).unwrap()
}

/// Measured on lavapipe: outlines agree by 1.0000; by 0.895 turned round (only the tower tells), by 0.833 turned by 10
/// degrees, by 0.804 shifted.
#[test]
fn a_wrong_pose_is_seen() {
    let Some(gpu) = gpu() else { return };
    let right = overlay(&gpu, Similarity::IDENTITY);
    let of = |overlay: &GroupOverlay, i: usize| overlay.tiles[i].overlap.unwrap();
    assert_eq!(right.tiles.iter().map(|tile| tile.id).collect::<Vec<_>>(), IDS);
    assert!(right.tiles[0].overlap.is_none() && right.tiles.iter().all(|tile| tile.over.len() == 2));
    assert_ne!(right.tiles[0].color, right.tiles[1].color);
    println!("right {:.4} and {:.4}", of(&right, 1), of(&right, 2));
    assert!(of(&right, 1) > 0.98 && of(&right, 2) > 0.98);
    for (what, planted, most) in [
        ("turned round", turned(PI, DVec3::ZERO), 0.93),
        ("turned by 10 degrees", turned(10f64.to_radians(), DVec3::ZERO), 0.9),
        ("a tenth of its length off", turned(0.0, DVec3::X * 0.2), 0.9),
    ] {
        let wrong = overlay(&gpu, planted);
        println!("{what}: {:.4}", of(&wrong, 1));
        assert!(of(&wrong, 1) < most, "{what}: {}", of(&wrong, 1));
        assert_ne!(wrong.tiles[1].over, right.tiles[1].over, "{what}");
        assert_eq!((&wrong.tiles[0], &wrong.tiles[2]), (&right.tiles[0], &right.tiles[2]), "{what}: the others");
    }
    assert_silent(&gpu);
}

/// Photos and masks of the scene in `at/data`, whose ids are shuffled otherwise in every view, and what the stages
/// leave in `at/run`.
fn run_folder(gpu: &std::sync::Arc<Gpu>, at: &Path) -> PipelineJob {
    let (cloud, labels, group) = scene();
    let (scene, cameras) = (InstancedScene::from_cloud(cloud.clone()), cameras(6));
    photograph(program(), &scene, &cameras, at);
    fs::create_dir_all(at.join("data/masks")).unwrap();
    let mut renderer = Renderer::new(gpu).unwrap();
    let mut table = Vec::new();
    for (v, camera) in cameras.iter().enumerate() {
        let mut mask = Mask { width: 160, height: 120, ids: vec![0; 160 * 120] };
        let mut objects = BTreeMap::new();
        for (k, &id) in IDS.iter().enumerate() {
            let own = InstancedScene::from_cloud(cloud.filtered(|i| labels[i] == id));
            let picture = render_picture(&mut renderer, &own, camera, &RenderOptions::default());
            let given = 1 + ((k + v) % IDS.len()) as u16;
            let pixels = mask.ids.iter_mut().zip(&picture.colors).filter(|(_, c)| c[3] > 0.5);
            pixels.for_each(|(pixel, _)| *pixel = given);
            objects.insert(given, id as u16);
        }
        // The first view is for test, and has no mask.
        if v > 0 {
            write_mask(&at.join("data/masks").join(format!("{}.png", camera.name)), &mask).unwrap();
            table.push(objects);
        }
    }
    let run = at.join("run");
    fs::create_dir_all(&run).unwrap();
    write_ply(&run.join("point_cloud.ply"), &cloud, PixelFilter::default()).unwrap();
    let mut file = Checkpoint::default();
    file.put("instance_of_gaussian", &[labels.len()], labels.clone());
    file.write(&run.join("labels.safetensors")).unwrap();
    let consensus = Consensus { table: IdTable::PerView(table), ..Consensus::default() };
    fs::write(run.join("consensus.json"), serde_json::to_vec(&consensus).unwrap()).unwrap();
    let groups = [group];
    write_groups(&run.join("groups.json"), &groups).unwrap();
    let built = build(&cloud, &labels, &groups, &TemplateOptions::default()).unwrap();
    write_scene_file(&run.join("initial.instgs"), &built.scene).unwrap();
    PipelineJob {
        data: at.join("data"),
        out: run,
        config: RunConfig::default(),
        resume: true,
        accept_changed_data: false,
    }
}

/// Which object's colour the picture has where the object stands; by hue, as pictures are shaded.
fn seen_color(picture: &Rgb8, camera: &Camera, at: DVec3, colors: &Colors) -> u32 {
    let camera = camera.resized(picture.width, picture.height);
    let v = camera.rotation() * at + camera.translation();
    let (x, y) = (camera.fx * v.x / v.z + camera.cx, camera.fy * v.y / v.z + camera.cy);
    let i = 3 * (y as usize * picture.width as usize + x as usize);
    let hue = |c: [u8; 3]| {
        let c = DVec3::from_array(c.map(f64::from));
        (c - c.element_sum() / 3.0).normalize_or_zero()
    };
    let own = hue([0, 1, 2].map(|c| picture.pixels[i + c]));
    let alike = |id: &u32| own.dot(hue(colors.of(*id).unwrap()));
    let best = IDS.into_iter().max_by(|a, b| alike(a).total_cmp(&alike(b))).unwrap();
    assert!(alike(&best) > 0.95, "{}", alike(&best));
    best
}

#[test]
fn objects_keep_their_colours_through_views_and_stages() {
    let Some(gpu) = gpu() else { return };
    let folder = tempfile::tempdir().unwrap();
    let job = run_folder(&gpu, folder.path());
    let pictures = draw(&gpu, &job, &Prepared::default()).unwrap();
    let (colors, cameras, group) = (Colors::of_ids(IDS), cameras(6), scene().2);
    assert_eq!(
        pictures.objects.iter().map(|o| (o.id, o.color)).collect::<Vec<_>>(),
        IDS.map(|id| (id, colors.of(id).unwrap()))
    );
    assert_eq!(pictures.views.len(), 4);
    let mut given = Vec::new();
    for view in &pictures.views {
        let camera = cameras.iter().find(|c| c.name == view.name).unwrap();
        for instance in &group.instances {
            let seen =
                |picture: &Rgb8| seen_color(picture, camera, instance.world_from_template.translation(), &colors);
            assert_eq!(seen(view.objects.as_ref().unwrap()), instance.id, "{}: objects", view.name);
            assert_eq!(seen(&view.labels), instance.id, "{}: labels", view.name);
        }
        given.push(view.given.clone().unwrap());
    }
    assert!(pictures.views.iter().zip(&given).any(|(v, given)| v.objects.as_ref() != Some(given)), "ids are shuffled");
    assert_eq!(pictures.overlays.len(), 1);
    assert!(pictures.overlays[0].tiles[1..].iter().all(|tile| tile.overlap > Some(0.98)));
    let template = &pictures.templates[0];
    assert_eq!((template.merged.len(), template.trained.len(), template.instances), (2, 0, 3));
    files_are_there(&job.out, &pictures);
    // After the joint phase.
    fs::copy(job.out.join("initial.instgs"), job.out.join("scene.instgs")).unwrap();
    let mut later = pictures.clone();
    add_trained_templates(&gpu, &job, &mut later).unwrap();
    assert_eq!(later.templates[0].trained, later.templates[0].merged, "the same scene, seen alike");
    assert!(job.out.join("stages/5_template_0_trained_behind.png").is_file());
    // The masks have gone, groups were never found.
    fs::remove_dir_all(job.data.join("masks")).unwrap();
    fs::remove_file(job.out.join("groups.json")).unwrap();
    let without = draw(&gpu, &job, &Prepared::default()).unwrap();
    assert!(without.notes[0].contains("not there any more"));
    assert!(without.views.len() == 4 && without.views.iter().all(|v| v.given.is_none() && v.objects.is_none()));
    assert_eq!(without.overlays[0].tiles.iter().map(|tile| tile.id).collect::<Vec<_>>(), IDS);
    assert!(without.overlays[0].tiles.iter().all(|tile| tile.own.is_some() && tile.over.is_empty()));
    assert_silent(&gpu);
}

fn files_are_there(run: &Path, pictures: &StagePictures) {
    for view in &pictures.views {
        for stage in ["1_masks", "2_objects", "3_labels"] {
            assert!(run.join(format!("stages/{stage}_{}.png", view.name)).is_file(), "{stage} {}", view.name);
        }
    }
    for name in ["4_pose_2_alone", "4_pose_5_over", "4_pose_9_over_side", "5_template_0_merged_front"] {
        let picture = image::open(run.join(format!("stages/{name}.png"))).unwrap();
        assert_eq!((picture.width(), picture.height()), (240, 180), "{name}");
    }
}
