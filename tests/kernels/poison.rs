//! Inputs at the edge: a right picture or a clear error, never a panic, a hang or a value that is not finite.

use instgs_vk::math::rng::Rng;
use instgs_vk::render::{Picture, RenderOptions, Renderer};
use instgs_vk::scene::{Camera, Gaussians, InstancedScene};

use crate::common::gpu::{SMALLEST_NORMAL, alpha, assert_silent, gpu, render_picture, rgb};
use crate::common::{ImageComparison, single_channel};

fn camera(width: u32, height: u32) -> Camera {
    Camera::look_at(
        "poison",
        glam::DVec3::new(0.0, 0.0, -4.0),
        glam::DVec3::ZERO,
        glam::DVec3::new(0.0, -1.0, 0.0),
        0.9,
        (width, height),
    )
}

fn good_cloud(n: usize, seed: u64) -> Gaussians {
    let mut rng = Rng::new(seed);
    let mut cloud = Gaussians::with_capacity(1, n);
    for _ in 0..n {
        cloud.means.push([0; 3].map(|_| rng.range(-1.0, 1.0) as f32));
        cloud.quats.push(rng.rotation_quat().map(|q| q as f32));
        cloud.log_scales.push([0; 3].map(|_| rng.range(-4.0, -1.5) as f32));
        cloud.opacity_logits.push(rng.range(-2.0, 3.0) as f32);
        (0..4).for_each(|_| cloud.sh.push([0; 3].map(|_| rng.range(-0.5, 0.5) as f32)));
    }
    cloud
}

fn picture_of(cloud: Gaussians, camera: &Camera) -> Option<Picture> {
    let gpu = gpu()?;
    let mut renderer = Renderer::new(&gpu).unwrap();
    let picture = render_picture(&mut renderer, &InstancedScene::from_cloud(cloud), camera, &RenderOptions::default());
    assert_silent(&gpu);
    Some(picture)
}

fn all_finite(picture: &Picture) -> bool {
    picture.colors.iter().flatten().chain(&picture.depths).all(|v| v.is_finite())
}

const POISON: [f32; 9] =
    [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, f32::MIN, SMALLEST_NORMAL, 0.0, 88.8, -200.0];

/// Poison in any one parameter of some Gaussians leaves the others' picture finite, and as the twin has it.
#[test]
fn poison_values_do_not_spread() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let camera = camera(33, 29);
    for (p, &value) in POISON.iter().enumerate() {
        for parameter in 0..5 {
            let mut cloud = good_cloud(60, p as u64);
            for i in (0..60).step_by(7) {
                match parameter {
                    0 => cloud.means[i][i % 3] = value,
                    1 => cloud.quats[i] = [value; 4],
                    2 => cloud.log_scales[i][i % 3] = value,
                    3 => cloud.opacity_logits[i] = value,
                    _ => cloud.sh[4 * i + 1][i % 3] = value,
                }
            }
            let scene = InstancedScene::from_cloud(cloud);
            let options = RenderOptions::default();
            let picture = render_picture(&mut renderer, &scene, &camera, &options);
            assert!(all_finite(&picture), "parameter {parameter} = {value}");
            // Values that f32 cannot tell from poison are culled by both; huge but finite ones are compared too.
            let twin = instgs_reference::render(&scene, &camera, &instgs_reference::RenderOptions::default());
            // Relative to the wanted value where that exceeds 1: a huge SH coefficient takes some pixels to 1e38.
            let scaled = |image: &[[f64; 3]]| -> Vec<[f64; 3]> {
                let scale = |(v, want): (&[f64; 3], &[f64; 3])| [0, 1, 2].map(|c| v[c] / want[c].abs().max(1.0));
                image.iter().zip(&twin.color).map(scale).collect()
            };
            let comparison = ImageComparison::new(&scaled(&rgb(&picture)), &scaled(&twin.color), &twin.robust);
            comparison.check(1e-3).unwrap_or_else(|e| panic!("parameter {parameter} = {value}: {e}"));
        }
    }
    assert_silent(&gpu);
}

/// A mean so far away that its view depth overflows while x/z stays small.
#[test]
fn infinite_depth_is_not_drawn() {
    let mut cloud = good_cloud(20, 6);
    cloud.means[3] = [3e38, 0.0, 3e38];
    cloud.log_scales[3] = [80.0; 3];
    let eye = glam::DVec3::new(-4.0, 0.0, -4.0);
    let target = glam::DVec3::new(4.0, 0.0, 4.0);
    let camera = Camera::look_at("yawed", eye, target, glam::DVec3::NEG_Y, 0.9, (64, 48));
    let Some(picture) = picture_of(cloud, &camera) else { return };
    assert!(all_finite(&picture));
}

#[test]
fn an_empty_scene_is_background() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let options = RenderOptions { background: [0.25, 0.5, 0.75], ..Default::default() };
    let picture = render_picture(&mut renderer, &InstancedScene::default(), &camera(19, 7), &options);
    assert!(picture.colors.iter().all(|&c| c == [0.25, 0.5, 0.75, 0.0]) && picture.depths.iter().all(|&d| d == 0.0));
    assert_silent(&gpu);
}

#[test]
fn everything_behind_the_camera_is_background() {
    let mut cloud = good_cloud(50, 1);
    cloud.means.iter_mut().for_each(|m| m[2] -= 10.0);
    let Some(picture) = picture_of(cloud, &camera(20, 20)) else { return };
    assert!(picture.colors.iter().all(|&c| c == [0.0; 4]));
}

/// 1x1, one row, one column, odd sizes: against the twin.
#[test]
fn odd_image_sizes() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let scene = InstancedScene::from_cloud(good_cloud(80, 2));
    for (width, height) in [(1, 1), (1, 50), (50, 1), (7, 9), (65, 63)] {
        let camera = camera(width, height);
        let picture = render_picture(&mut renderer, &scene, &camera, &RenderOptions::default());
        let twin = instgs_reference::render(&scene, &camera, &instgs_reference::RenderOptions::default());
        assert_eq!((picture.width, picture.height), (width, height));
        // Images this small may have more than 2 % fragile pixels; only the error is compared.
        for comparison in [
            ImageComparison::new(&rgb(&picture), &twin.color, &twin.robust),
            ImageComparison::new(&alpha(&picture), &single_channel(&twin.alpha), &twin.robust),
        ] {
            assert!(comparison.max_abs_error < 1e-4 && comparison.non_finite == 0, "{width}x{height}: {comparison:?}");
        }
    }
    assert_silent(&gpu);
}

/// Five thousand splats on one pixel, and splats that contain the camera.
#[test]
fn piles_and_splats_around_the_camera() {
    let mut pile = good_cloud(5000, 3);
    pile.means.iter_mut().for_each(|m| *m = m.map(|v| 1e-3 * v));
    pile.opacity_logits.iter_mut().for_each(|o| *o -= 3.0);
    let Some(picture) = picture_of(pile, &camera(31, 31)) else { return };
    assert!(all_finite(&picture) && picture.colors[15 * 31 + 15][3] > 0.99);
    let mut around = good_cloud(200, 4);
    around.means.iter_mut().for_each(|m| m[2] -= 4.0);
    around.log_scales.iter_mut().for_each(|s| *s = s.map(|v| v + 2.5));
    let Some(picture) = picture_of(around, &camera(64, 48)) else { return };
    assert!(all_finite(&picture));
}

#[test]
fn bad_cameras_and_options_are_errors() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let scene = renderer.upload(&InstancedScene::from_cloud(good_cloud(3, 5))).unwrap();
    let good = camera(8, 8);
    let mut cameras = vec![good.clone(); 5];
    cameras[0].width = 0;
    cameras[1].height = 20_000;
    cameras[2].fx = f64::NAN;
    cameras[3].fy = -1.0;
    cameras[4].view_from_world[0][0] = 7.0;
    for bad in &cameras {
        let error = renderer.render(&scene, bad, &RenderOptions::default()).unwrap_err().to_string();
        assert!(error.contains("camera poison") && !error.contains('\n'), "{error}");
    }
    for options in [
        RenderOptions { near: f32::NAN, ..Default::default() },
        RenderOptions { near: -1.0, ..Default::default() },
        RenderOptions { dilation_px2: 0.0, ..Default::default() },
        RenderOptions { background: [f32::INFINITY, 0.0, 0.0], ..Default::default() },
    ] {
        assert!(renderer.render(&scene, &good, &options).is_err(), "{options:?}");
    }
    renderer.render(&scene, &good, &RenderOptions::default()).unwrap();
    assert_silent(&gpu);
}
