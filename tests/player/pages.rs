//! Scenes in pages: what the player draws is what it draws of the whole scene, and what needs all of it is refused.

use instgs_console::opened::{OpenedScene, SceneMemory};
use instgs_io::{Pack, load_scene_to_draw, write_scene_file_in_pages};
use instgs_player::{ChangeError, SceneViewer, ViewerOptions};
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::edit::{Edit, Selector};
use instgs_vk::scene::{Camera, Gaussians, InstancedScene};

use crate::common::chairs::chairs;
use crate::common::gpu::{assert_silent, gpu};

/// Chairs on a wide ground.
fn scene() -> InstancedScene {
    let mut rng = Rng::new(11);
    let mut scene = chairs();
    let degree = scene.background.sh_degree;
    let mut ground = Gaussians::with_capacity(degree, 20_000);
    for _ in 0..20_000 {
        let (x, z) = (rng.range(-30.0, 30.0), rng.range(-30.0, 30.0));
        ground.means.push([x as f32, 1.5, z as f32]);
        ground.quats.push([0; 4].map(|_| rng.normal() as f32));
        ground.log_scales.push([0; 3].map(|_| rng.range(-2.6, -1.8) as f32));
        ground.opacity_logits.push(rng.range(0.0, 3.0) as f32);
        (0..(degree + 1).pow(2)).for_each(|_| ground.sh.push([0; 3].map(|_| rng.range(-0.4, 0.8) as f32)));
    }
    scene.background.append(&ground);
    scene
}

/// A camera above the ground, turned by `angle`.
fn camera(angle: f64) -> Camera {
    let (sin, cos) = angle.sin_cos();
    let view_from_world = [[cos, 0.0, sin, 0.0], [0.0, 1.0, 0.0, 0.0], [-sin, 0.0, cos, 2.0], [0.0, 0.0, 0.0, 1.0]];
    Camera { name: String::new(), width: 96, height: 64, fx: 90.0, fy: 90.0, cx: 48.0, cy: 32.0, view_from_world }
}

#[test]
fn pages_come_as_the_view_wants_them() {
    let Some(gpu) = gpu() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.instgs");
    write_scene_file_in_pages(&path, &scene(), Pack::F32).unwrap();
    let options = ViewerOptions::default();
    let memory = SceneMemory { host_bytes: Some(1) };
    let open = || OpenedScene::open(&path, memory).unwrap();
    assert!(matches!(open(), OpenedScene::InPages(_)));
    assert!(matches!(OpenedScene::open(&path, SceneMemory::default()).unwrap(), OpenedScene::Whole(_)));
    let loaded = load_scene_to_draw(&path).unwrap().scene;
    assert_eq!(open().counts(), [loaded.source_len() as u64, loaded.expanded_len()]);
    let mut whole = SceneViewer::new(&gpu, loaded, options).unwrap();
    let mut viewer = SceneViewer::of_opened(&gpu, open(), options).unwrap();
    assert!(viewer.is_in_pages() && !whole.is_in_pages());
    let picture = |viewer: &mut SceneViewer, angle: f64| {
        viewer.draw_ahead(&camera(angle)).unwrap();
        viewer.rgb8().unwrap()
    };
    for k in 0..6 {
        let angle = f64::from(k);
        assert!(picture(&mut viewer, angle) == picture(&mut whole, angle), "angle {angle}");
        assert!(!viewer.awaits_pages());
    }
    // Without waiting, stand-ins come first, and the same picture in the end.
    let mut ahead = SceneViewer::of_opened(&gpu, open(), options).unwrap();
    ahead.waits_for_pages = false;
    let first = picture(&mut ahead, 0.5);
    // Pictures that are kept do not.
    ahead.draw_complete(&camera(2.5)).unwrap();
    let kept = ahead.rgb8().unwrap();
    assert!(kept == picture(&mut whole, 2.5) && !ahead.waits_for_pages);
    picture(&mut ahead, 4.5);
    ahead.complete().unwrap();
    assert!(ahead.rgb8().unwrap() == picture(&mut whole, 4.5) && !ahead.awaits_pages());
    let mut ahead = SceneViewer::of_opened(&gpu, open(), options).unwrap();
    ahead.waits_for_pages = false;
    assert!(first == picture(&mut ahead, 0.5));
    let want = picture(&mut whole, 0.5);
    assert!(ahead.awaits_pages() && first != want);
    for _ in 0..10_000 {
        if !ahead.awaits_pages() {
            break;
        }
        picture(&mut ahead, 0.5);
        std::thread::yield_now();
    }
    assert!(!ahead.awaits_pages() && picture(&mut ahead, 0.5) == want);
    // Another scene in its place, and on another device.
    ahead.open(open(), options).unwrap();
    ahead.waits_for_pages = true;
    assert!(picture(&mut ahead, 0.5) == want);
    let mut again = SceneViewer::reopened(&gpu, ahead).unwrap();
    assert!(again.is_in_pages() && picture(&mut again, 0.5) == want);
    assert_silent(&gpu);
}

#[test]
fn what_needs_the_whole_scene_is_refused() {
    let Some(gpu) = gpu() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.instgs");
    write_scene_file_in_pages(&path, &scene(), Pack::F16).unwrap();
    let memory = SceneMemory { host_bytes: Some(1) };
    let opened = OpenedScene::open(&path, memory).unwrap();
    let mut viewer = SceneViewer::of_opened(&gpu, opened, ViewerOptions::default()).unwrap();
    viewer.draw(&camera(0.0)).unwrap();
    let before = viewer.rgb8().unwrap();
    let refused = viewer.edit(&Edit::Delete { which: Selector::Index(0) }).unwrap_err();
    assert!(matches!(&refused, ChangeError::Rejected(_)) && refused.to_string().contains("memory"), "{refused}");
    for name in ["b.instgs", "b.ply"] {
        let to = folder.path().join(name);
        let copied = viewer.write_copy(&to).err().into_iter();
        assert_eq!(copied.chain(viewer.export(&to, glam::DVec3::Y).err()).count(), 2, "{name}");
        assert!(!to.exists());
    }
    viewer.draw(&camera(0.0)).unwrap();
    assert!(viewer.rgb8().unwrap() == before);
    // Hiding is no edit.
    assert!(viewer.set_hidden(&[0], true).unwrap());
    viewer.draw(&camera(0.0)).unwrap();
    viewer.set_hidden(&[0], false).unwrap();
    viewer.draw(&camera(0.0)).unwrap();
    assert!(viewer.rgb8().unwrap() == before);
    assert_silent(&gpu);
}

#[test]
fn pages_that_cannot_be_read_are_left_out() {
    let Some(gpu) = gpu() else { return };
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("a.instgs");
    write_scene_file_in_pages(&path, &scene(), Pack::F32).unwrap();
    let opened = OpenedScene::open(&path, SceneMemory { host_bytes: Some(1) }).unwrap();
    let mut viewer = SceneViewer::of_opened(&gpu, opened, ViewerOptions::default()).unwrap();
    viewer.waits_for_pages = false;
    // The file is cut short while it is open.
    let file = std::fs::File::options().write(true).open(&path).unwrap();
    file.set_len(20_000).unwrap();
    let mut words = Vec::new();
    for _ in 0..10_000 {
        words.extend(viewer.draw_what_fits(&camera(0.5)).unwrap());
        if !viewer.awaits_pages() {
            break;
        }
        std::thread::yield_now();
    }
    words.extend(viewer.draw_what_fits(&camera(0.5)).unwrap());
    assert!(!viewer.awaits_pages() && words.iter().any(|words| words.contains("cannot read")), "{words:?}");
    assert!(viewer.draw_complete(&camera(0.5)).unwrap_err().to_string().contains("cannot read"));
    assert_silent(&gpu);
}
