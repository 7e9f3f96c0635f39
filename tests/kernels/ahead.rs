//! Pictures that nobody waits for are those of `render`; one that will not be complete leaves the window as it was.

use glam::{DMat3, DVec3};
use instgs_vk::gpu::{Gpu, Recorder};
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::{
    Ahead, Arrived, Capacities, DeviceScene, ExtraPasses, FRAMES_IN_FLIGHT, Presenter, RenderOptions, Renderer, Show,
    ShownPicture,
};
use instgs_vk::scene::trajectory::Orbit;
use instgs_vk::scene::{Camera, Instance};

use crate::common::gpu::{assert_silent, gpu};
use crate::common::random_scene::random_case;

/// The last picture in a window of its size.
fn window(
    gpu: &std::sync::Arc<Gpu>,
    presenter: &mut Presenter,
    (renderer, scene): (&Renderer, &DeviceScene),
    camera: &Camera,
) -> Vec<u8> {
    let mut recorder = Recorder::new(gpu).unwrap();
    let size = [camera.width, camera.height];
    let picture = ShownPicture { renderer, scene, surfaces: None, marks: None };
    presenter.record(&mut recorder, Show::Color, picture, size, false).unwrap();
    let ticket = recorder.submit().unwrap();
    recorder.wait(ticket).unwrap();
    presenter.rgb8().unwrap()
}

#[test]
fn pictures_ahead_are_those_of_render() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let case = random_case(4);
    let device = renderer.upload(&case.scene).unwrap();
    let options = RenderOptions::default();
    let mut cameras = Orbit::around(&case.scene, None).cameras(7, (64, 48));
    // Another size in between: other buffers while pictures are on their way.
    cameras[4] = cameras[4].resized(33, 17);
    let mut want = Vec::new();
    for camera in &cameras {
        let stats = renderer.render(&device, camera, &options).unwrap();
        want.push((stats.visible, stats.intersections, renderer.download().unwrap()));
    }
    assert!(want.iter().any(|(visible, ..)| *visible > 0));

    let mut ahead = Ahead::new(&gpu).unwrap();
    let mut arrived = Vec::new();
    for (k, camera) in cameras.iter().enumerate() {
        if ahead.is_full() {
            arrived.extend(ahead.arrive().unwrap());
        }
        renderer.submit_ahead(&mut ahead, &device, camera, &options, ExtraPasses::default()).unwrap();
        assert_eq!(renderer.download().unwrap(), want[k].2, "picture {k}");
    }
    while let Some(one) = ahead.arrive().unwrap() {
        arrived.push(one);
    }
    assert_eq!(arrived.len(), cameras.len());
    for (arrived, (visible, intersections, _)) in arrived.iter().zip(&want) {
        let Arrived::Complete(stats) = arrived else { panic!("{arrived:?}") };
        assert_eq!((&stats.visible, &stats.intersections, stats.slabs), (visible, intersections, 1));
    }
    assert_silent(&gpu);
}

/// With too small buffers of every kind, pictures ahead arrive as incomplete, and the window keeps what it showed.
#[test]
fn incomplete_pictures_are_not_shown() {
    let Some(gpu) = gpu() else { return };
    let case = random_case(8);
    let options = RenderOptions::default();
    let roomy = Capacities { candidates: 1 << 12, work_items: 1 << 8, intersections: 1 << 16 };
    let small = |change: fn(&mut Capacities)| {
        let mut capacities = roomy;
        change(&mut capacities);
        capacities
    };
    for (capacities, complete) in [
        (roomy, true),
        (small(|c| c.candidates = 1), false),
        (small(|c| c.work_items = 1), false),
        (small(|c| c.intersections = 1), false),
    ] {
        let mut renderer = Renderer::new(&gpu).unwrap();
        let mut presenter = Presenter::new(&gpu, &renderer).unwrap();
        let mut ahead = Ahead::new(&gpu).unwrap();
        let device = renderer.upload(&case.scene).unwrap();
        let camera = case.camera.resized(64, 48);
        let away = Camera { view_from_world: turned_round(&camera), ..camera.clone() };
        renderer.render(&device, &away, &options).unwrap();
        let before = window(&gpu, &mut presenter, (&renderer, &device), &away);
        renderer.set_capacities(capacities);
        for _ in 0..FRAMES_IN_FLIGHT {
            renderer.submit_ahead(&mut ahead, &device, &camera, &options, ExtraPasses::default()).unwrap();
            let after = window(&gpu, &mut presenter, (&renderer, &device), &camera);
            assert_eq!(before != after, complete, "{capacities:?}");
        }
        for _ in 0..FRAMES_IN_FLIGHT {
            let arrived = ahead.arrive().unwrap().unwrap();
            assert_eq!(matches!(arrived, Arrived::Complete(_)), complete, "{capacities:?}: {arrived:?}");
        }
        // Drawn again, it is right.
        renderer.render(&device, &camera, &options).unwrap();
        assert_ne!(window(&gpu, &mut presenter, (&renderer, &device), &camera), before);
    }
    assert_silent(&gpu);
}

/// More rows than one update command takes, in two runs; what is downloaded has them, whether or not a picture came between.
#[test]
fn moved_rows_reach_the_device() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let case = random_case(4);
    let mut scene = case.scene.clone();
    let one = Instance { first_offset: None, ..scene.instances[0].clone() };
    scene.instances = vec![one; 2000];
    scene.groups.clear();
    let mut device = renderer.upload(&scene).unwrap();
    let by = |distance: f64| {
        move |k: usize| {
            let place = Similarity::from_parts(DMat3::IDENTITY, 1.0, DVec3::new(distance, k as f64, 0.0));
            (k, place)
        }
    };
    for (picture, distance) in [(false, 1.0), (true, 2.0)] {
        let places: Vec<_> = (0..1100).chain(1500..1501).map(by(distance)).collect();
        device.place_instances(&places).unwrap();
        places.iter().for_each(|(k, place)| scene.instances[*k].world_from_template = *place);
        if picture {
            renderer.render(&device, &case.camera, &RenderOptions::default()).unwrap();
        }
        assert!(device.download(&gpu, &scene).unwrap() == scene, "picture: {picture}");
    }
    let error = device.place_instances(&[by(3.0)(0), by(3.0)(2000)]).unwrap_err().to_string();
    assert!(error.contains("2000"), "{error}");
    assert!(device.download(&gpu, &scene).unwrap() == scene, "nothing is moved");
    // The device moves those of a scene in training.
    let mut trained = DeviceScene::unbounded(&gpu, &scene, renderer.variant().workgroup_size).unwrap();
    let error = trained.place_instances(&[by(3.0)(0)]).unwrap_err().to_string();
    assert!(error.contains("training"), "{error}");
    assert_silent(&gpu);
}

/// Looks the other way: first and third row of the rotation change sign.
fn turned_round(camera: &Camera) -> [[f64; 4]; 4] {
    let mut m = camera.view_from_world;
    for row in [0, 2] {
        m[row] = m[row].map(|v| -v);
    }
    m
}
