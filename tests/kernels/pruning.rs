//! Pruning by blending weights: what shows least goes, what stands in for something else does not go with it.

use glam::{DMat3, DVec3};
use instgs_train::pruning::{picture_psnr, prune};
use instgs_train::{TrainError, measure_sensitivity};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{Camera, Gaussians, Instance, InstancedScene, NearPlane, Offsets, SourceRange};

use crate::common::gpu::{assert_silent, gpu};
use crate::common::random_scene::{add_own_gaussians, random_case};
use instgs_vk::math::rng::Rng;

/// Flat discs across the view, by depth, logit and colour.
fn discs(of: &[(f32, f32, f32)]) -> Gaussians {
    let mut out = Gaussians::with_capacity(0, of.len());
    for &(z, logit, grey) in of {
        out.means.push([0.0, 0.0, z]);
        out.quats.push([1.0, 0.0, 0.0, 0.0]);
        out.log_scales.push([0.0, 0.0, -4.0]);
        out.opacity_logits.push(logit);
        out.sh.push([grey; 3]);
    }
    out
}

fn camera() -> Camera {
    Camera::look_at("front", DVec3::new(0.0, 0.0, -6.0), DVec3::ZERO, DVec3::NEG_Y, 0.6, (48, 32))
}

/// A scene of a few centimetres, in metres: with the near plane that it was trained with the front is seen, and what is behind it
/// goes. With the usual one nothing is seen at all.
#[test]
fn the_near_plane_is_the_scenes() {
    let Some(gpu) = gpu() else { return };
    let mut cloud = discs(&[(0.005, 6.0, -1.0), (0.0, 6.0, 1.0)]);
    cloud.log_scales.iter_mut().for_each(|s| *s = [-5.0, -5.0, -9.0]);
    let usual = InstancedScene::from_cloud(cloud);
    let close = InstancedScene { near_plane: NearPlane(0.01), ..usual.clone() };
    let camera = Camera::look_at("close", DVec3::new(0.0, 0.0, -0.05), DVec3::ZERO, DVec3::NEG_Y, 0.6, (48, 32));
    let cameras = [camera];
    let pruned = prune(&gpu, &close, &cameras, 0.5, || ()).unwrap().scene;
    assert_eq!((pruned.background.means.as_slice(), pruned.near_plane), (&[[0.0; 3]][..], NearPlane(0.01)));
    let nothing = InstancedScene::default();
    let [seen, unseen] = [&close, &usual].map(|scene| picture_psnr(&gpu, [scene, &nothing], &cameras).unwrap());
    assert!(seen < 30.0 && unseen > 90.0, "{seen} {unseen}");
    let [seen, unseen] =
        [&close, &usual].map(|scene| measure_sensitivity::<TrainError>(&gpu, scene, &cameras, || Ok(())).unwrap());
    assert!(seen.shows_anything() && !unseen.shows_anything());
    assert_silent(&gpu);
}

/// Two opaque layers of one colour: a picture without either is nearly the same, without both it is black.
#[test]
fn one_layer_of_two_stays() {
    let Some(gpu) = gpu() else { return };
    let scene = InstancedScene::from_cloud(discs(&[(0.02, 6.0, 1.0), (0.0, 6.0, 1.0), (1.0, -5.0, -1.0)]));
    let pruned = prune(&gpu, &scene, &[camera()], 0.4, || ()).unwrap();
    assert_eq!((pruned.fewer, pruned.hidden), (2, 0));
    assert_eq!(pruned.scene.background.means, [[0.0; 3]], "the front layer stays");
    let nothing = InstancedScene::default();
    let [kept, black] = [&pruned.scene, &nothing].map(|left| picture_psnr(&gpu, [&scene, left], &[camera()]).unwrap());
    assert!(kept < 100.0 && kept > black + 8.0, "{kept} {black}");
    assert_silent(&gpu);
}

/// Of two instances one stands behind a wall: there, and only there, its Gaussians go.
#[test]
fn instances_are_judged_on_their_own() {
    let Some(gpu) = gpu() else { return };
    let instance = |x: f64, first_offset| Instance {
        template: 0,
        world_from_template: Similarity::from_parts(DMat3::IDENTITY, 0.2, DVec3::new(x, 0.0, 2.0)),
        first_offset,
    };
    let zeros = |n: usize| vec![[0.0; 3]; n];
    let mut wall = discs(&[(0.0, 9.0, 1.0)]);
    wall.means[0][0] = 1.0;
    wall.log_scales[0] = [-0.5, -0.5, -4.0];
    let scene = InstancedScene {
        templates: discs(&[(0.0, 2.0, 0.5), (0.5, 2.0, -0.5)]),
        template_ranges: vec![SourceRange { first: 0, count: 2 }],
        instances: vec![instance(-1.0, Some(0)), instance(1.2, Some(2))],
        offsets: Offsets { means: zeros(4), sh_dc: zeros(4), opacity_logits: vec![0.0; 4], ..Offsets::default() },
        background: wall,
        ..InstancedScene::default()
    };
    scene.validate().unwrap();
    let pruned = prune(&gpu, &scene, &[camera()], 0.6, || ()).unwrap();
    assert_eq!((pruned.fewer, pruned.hidden, pruned.scene.offsets.len()), (2, 2, 4));
    let logits = &pruned.scene.offsets.opacity_logits;
    assert!(logits[..2] == [0.0; 2] && logits[2..].iter().all(|&logit| logit < -12.0), "{logits:?}");
    assert!(picture_psnr(&gpu, [&scene, &pruned.scene], &[camera()]).unwrap() > 25.0);
    // What is hidden already is not hidden again.
    let again = prune(&gpu, &pruned.scene, &[camera()], 1.0, || ()).unwrap();
    assert_eq!((again.drawn, again.fewer, again.scene), (3, 0, pruned.scene));
    assert_silent(&gpu);
}

/// On scenes with everything: half of what is drawn goes, and pictures keep far more than half. The order of cameras changes
/// nothing, all of a scene stays as it is, and what no camera sees stays.
#[test]
fn half_of_what_is_drawn_is_hardly_missed() {
    let Some(gpu) = gpu() else { return };
    for seed in [3, 8] {
        let mut case = random_case(seed);
        add_own_gaussians(&mut Rng::new(seed), &mut case);
        let (scene, cameras) = (&case.scene, [case.camera.clone(), Camera { cx: 3.0, ..case.camera.clone() }]);
        let half = prune(&gpu, scene, &cameras, 0.5, || ()).unwrap();
        half.scene.validate().unwrap();
        let turned = [cameras[1].clone(), cameras[0].clone()];
        assert_eq!(prune(&gpu, scene, &turned, 0.5, || ()).unwrap(), half);
        let nothing = InstancedScene { pixel_filter: scene.pixel_filter, ..InstancedScene::default() };
        let [kept, black] = [&half.scene, &nothing].map(|left| picture_psnr(&gpu, [scene, left], &cameras).unwrap());
        println!("seed {seed}: {} of {} fewer, {kept:.2} dB, black {black:.2}", half.fewer, scene.expanded_len());
        assert!(half.fewer > 0 && kept > black + 10.0, "{kept} {black}");
        assert_eq!(prune(&gpu, scene, &cameras, 1.0, || ()).unwrap().scene, *scene);
        // Everything is behind this camera.
        let mut away = cameras[0].clone();
        away.view_from_world =
            [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, -1e4], [0.0, 0.0, 0.0, 1.0]];
        assert_eq!(prune(&gpu, scene, &[away], 0.5, || ()).unwrap().fewer, 0);
    }
    assert!(prune(&gpu, &InstancedScene::default(), &[], 0.5, || ()).is_err());
    assert_silent(&gpu);
}
