//! Scenes that are trained through the rounding of `--pack small`.

use std::fs;
use std::path::Path;
use std::sync::Arc;

use glam::DVec3;
use instgs_io::picture_png::write_png;
use instgs_io::small::{Sensitivity, SmallOptions, SmallPlan};
use instgs_train::config::TrainConfig;
use instgs_train::{FinishJob, TrainError, finish, measure_sensitivity};
use instgs_vk::gpu::Gpu;
use instgs_vk::render::{RenderOptions, Renderer};
use instgs_vk::scene::{Camera, InstancedScene, SourceRange};

use crate::common::dataset::transforms;
use crate::common::gpu::{assert_silent, gpu};
use crate::train_steps::instanced;

/// By the measure of sensitivity: so coarse that much is lost.
const PICTURE_PSNR_DB: f64 = 40.0;
const STEPS: u64 = 200;
/// Enough to see that the same steps give the same values.
const FEW_STEPS: u64 = 20;

fn cameras(target: DVec3) -> Vec<Camera> {
    let eyes = [[0.0, 0.3, -7.0], [5.0, 1.0, -4.0], [-5.0, -1.0, 3.0], [1.0, -4.0, -5.0]].map(DVec3::from_array);
    let look = |(i, eye): (usize, &DVec3)| {
        Camera::look_at(&format!("{i:03}"), target + *eye, target, DVec3::NEG_Y, 0.9, (64, 48))
    };
    eyes.iter().enumerate().map(look).collect()
}

/// The pictures of a scene, red, green and blue from 0 to 1, one after another.
fn pictures(gpu: &Arc<Gpu>, scene: &InstancedScene, cameras: &[Camera]) -> Vec<f32> {
    let mut renderer = Renderer::new(gpu).unwrap();
    let options = RenderOptions::default().filtered(scene.pixel_filter);
    let on_device = renderer.upload(scene).unwrap();
    let mut picture = |camera: &Camera| {
        renderer.render(&on_device, camera, &options).unwrap();
        renderer.download().unwrap().colors
    };
    cameras.iter().flat_map(&mut picture).flat_map(|c| [c[0], c[1], c[2]].map(|v| v.clamp(0.0, 1.0))).collect()
}

fn mean_squared(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter().zip(b).map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>() / a.len() as f64
}

/// A data set with these pictures, the last of which is for tests.
fn write_photos(folder: &Path, cameras: &[Camera], pictures: &[f32]) {
    fs::create_dir(folder.join("images")).unwrap();
    for (camera, picture) in cameras.iter().zip(pictures.chunks(pictures.len() / cameras.len())) {
        let rgb: Vec<u8> = picture.iter().map(|v| (255.0 * v).round() as u8).collect();
        write_png(&folder.join(format!("images/{}.png", camera.name)), &rgb, (camera.width, camera.height)).unwrap();
    }
    let (train, test) = cameras.split_at(cameras.len() - 1);
    for (split, cameras) in [("train", train), ("test", test)] {
        fs::write(folder.join(format!("transforms_{split}.json")), transforms(cameras).to_string()).unwrap();
    }
}

/// With photos of the scene itself, what rounding loses is all that there is to learn: measured, a mean squared error of 1.0e-4
/// becomes one of 0.59e-4 (8 lanes; 0.40e-4 to 0.72e-4 after 200 to 600 steps, 4 and 8 lanes). Nothing but values changes, and
/// the same steps give the same values.
#[test]
fn what_is_lost_by_rounding_is_learned_again() {
    let Some(gpu) = gpu() else { return };
    let (scene, _, target) = instanced();
    let (cameras, folder) = (cameras(target), tempfile::tempdir().unwrap());
    write_photos(folder.path(), &cameras, &pictures(&gpu, &scene, &cameras));
    let cameras = &cameras[..cameras.len() - 1];
    let photos = pictures(&gpu, &scene, cameras);
    let sensitivity = &measure_sensitivity::<TrainError>(&gpu, &scene, cameras, || Ok(())).unwrap();
    let options = SmallOptions { sensitivity, picture_psnr_db: PICTURE_PSNR_DB };
    let plan = SmallPlan::new(&scene, &options, folder.path()).unwrap();
    let before = mean_squared(&pictures(&gpu, &plan.rounded(&scene, folder.path()).unwrap(), cameras), &photos);

    let finished = |scene: &InstancedScene, steps: u64| {
        let (data, config) = (folder.path(), &TrainConfig::default());
        let job = FinishJob { scene, sensitivity, picture_psnr_db: PICTURE_PSNR_DB, data, config, to: data, steps };
        let mut done = 0;
        let finished = finish::<TrainError>(&gpu, &job, || {
            done += 1;
            Ok(())
        })
        .unwrap();
        assert_eq!(done, steps);
        finished
    };
    let once = finished(&scene, STEPS);
    let rounded = once.plan.rounded(&once.scene, folder.path()).unwrap();
    let after = mean_squared(&pictures(&gpu, &rounded, cameras), &photos);
    println!("mean squared error {before:.3e}, after {STEPS} steps {after:.3e}");
    assert!(after < 0.9 * before, "{before:.3e} {after:.3e}");
    let counts = |scene: &InstancedScene| scene.parameter_rows();
    assert_eq!(counts(&once.scene), counts(&scene));
    assert_eq!((&rounded.instances, &rounded.own_ranges), (&scene.instances, &scene.own_ranges));
    assert_eq!(rounded.color_from_template, scene.color_from_template);
    assert_eq!(finished(&scene, FEW_STEPS).scene, finished(&scene, FEW_STEPS).scene);
    // What is rounded already stays, up to the rounding of f32.
    let again = once.plan.rounded(&rounded, folder.path()).unwrap();
    let moved = mean_squared(&pictures(&gpu, &again, cameras), &pictures(&gpu, &rounded, cameras));
    assert!(moved < 1e-3 * after, "{moved:.3e} {after:.3e}");
    assert_silent(&gpu);
}

/// A duplicate shares its offsets: what several instances learn of one record would depend on the order of threads.
#[test]
fn scenes_whose_instances_share_rows_are_refused() {
    let Some(gpu) = gpu() else { return };
    let (mut scene, _, _) = instanced();
    let with_offsets = scene.instances.iter().position(|instance| instance.first_offset.is_some()).unwrap();
    scene.instances.push(scene.instances[with_offsets].clone());
    scene.own_ranges.resize(scene.instances.len(), SourceRange::default());
    let (sensitivity, config) = (&Sensitivity::default(), &TrainConfig::default());
    let (data, to) = (Path::new("data"), Path::new("small.instgs"));
    let job = FinishJob { scene: &scene, sensitivity, picture_psnr_db: 50.0, data, config, to, steps: 1 };
    let text = finish::<TrainError>(&gpu, &job, || Ok(())).unwrap_err().to_string();
    assert!(text.starts_with("small.instgs") && text.contains("instances share"), "{text}");
}
