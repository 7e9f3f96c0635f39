//! What the player draws after edits is what it draws of a scene that was opened so; and a picture shows whom one clicks on.

use glam::{DMat3, DVec3};
use instgs_io::load_scene;
use instgs_player::navigation::Navigator;
use instgs_player::views::View;
use instgs_player::{ChangeError, SceneViewer, ViewerOptions};
use instgs_vk::gpu::{Buffer, DeviceChoice, Gpu, GpuOptions, SubmissionCounts};
use instgs_vk::math::rng::Rng;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::render::RenderOptions;
use instgs_vk::scene::edit::{Edit, Keep, OffsetSource, Scatter, ScatterOver, Selector, Turn, apply};
use instgs_vk::scene::trajectory::Orbit;
use instgs_vk::scene::{Camera, Gaussians, Instance, InstancedScene, Offsets, SourceRange};

use crate::common::chairs::chairs;
use crate::common::gpu::{assert_silent, gpu};

fn undo(viewer: &mut SceneViewer) -> bool {
    viewer.undo().unwrap()
}

fn redo(viewer: &mut SceneViewer) -> bool {
    viewer.redo().unwrap()
}

fn is_out_of_room(error: &ChangeError) -> bool {
    matches!(error, ChangeError::Reverted(device) if device.is_out_of_memory())
        && error.to_string().contains("out of device memory")
}

#[test]
fn edited_scenes_look_as_if_opened_so() {
    let Some(gpu) = gpu() else { return };
    let mut viewer = SceneViewer::new(&gpu, chairs(), ViewerOptions::default()).unwrap();
    let navigator = Navigator::around(&Orbit::around(&chairs(), None));
    let camera = navigator.camera([96, 64]);
    let picture = |viewer: &mut SceneViewer| {
        viewer.draw(&camera).unwrap();
        let got = viewer.rgb8().unwrap();
        let mut fresh = SceneViewer::new(&gpu, viewer.scene().clone(), ViewerOptions::default()).unwrap();
        fresh.draw(&camera).unwrap();
        assert!(got == fresh.rgb8().unwrap(), "as if opened so");
        got
    };
    let which = || Selector::Indices(vec![0, 2]);
    let mut pictures = vec![picture(&mut viewer)];
    for edit in [
        Edit::MoveBy { which: which(), by: DVec3::new(0.3, 0.2, 0.1) },
        Edit::Rotate { which: which(), turn: Turn { axis: DVec3::Y, angle: 0.7 } },
        Edit::Scale { which: Selector::Index(1), by: 2.0 },
        Edit::Duplicate { which: which(), by: DVec3::new(0.0, -0.5, 0.0), turn: None },
        Edit::Recolour { which: Selector::Index(0), rgb: [0.3, 0.0, -0.3] },
        Edit::Crop { template: 0, corners: [DVec3::new(-1.0, -0.3, -1.0), DVec3::INFINITY], keep: Keep::Inside },
        Edit::Erase { template: 0, centres: vec![DVec3::new(-0.1, 0.0, 0.0)], radius: 0.05 },
        Edit::Delete { which: which() },
    ] {
        viewer.edit(&edit).unwrap();
        // Nothing chosen, so that there are no lines.
        viewer.editor_mut().click(None, false);
        let now = picture(&mut viewer);
        assert!(pictures.last() != Some(&now), "{edit:?} shows");
        pictures.push(now);
    }
    for want in pictures.iter().rev().skip(1) {
        assert!(undo(&mut viewer));
        viewer.editor_mut().click(None, false);
        assert!(picture(&mut viewer) == *want);
    }
    assert!(!undo(&mut viewer) && redo(&mut viewer) && viewer.editor().is_unsaved());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("edited.instgs");
    viewer.save(&path).unwrap();
    assert!(!viewer.editor().is_unsaved() && load_scene(&path).unwrap().scene == *viewer.scene());
    assert_silent(&gpu);
}

/// A drag is on the device what it is on the host at each of its edits, and one step; given up, it leaves nothing.
/// An edit that the device has no room for is refused in words; the scene and its picture are as they were.
#[test]
fn what_does_not_fit_the_device_is_refused() {
    // A device of its own: the budget is the device's.
    if gpu().is_none() {
        return;
    }
    let device = std::env::var("INSTGS_TEST_DEVICE").map_or(DeviceChoice::Best, |name| name.parse().unwrap());
    let gpu = Gpu::open(&GpuOptions { device, validation: true, ..Default::default() }).unwrap();
    let mut viewer = SceneViewer::new(&gpu, chairs(), ViewerOptions::default()).unwrap();
    let camera = Navigator::around(&Orbit::around(&chairs(), None)).camera([96, 64]);
    let picture = |viewer: &mut SceneViewer| {
        viewer.draw(&camera).unwrap();
        viewer.rgb8().unwrap()
    };
    let before = picture(&mut viewer);
    gpu.set_memory_budget(gpu.memory_usage().0 + (64 << 10));
    let over = ScatterOver::Plane {
        point: DVec3::ZERO,
        normal: DVec3::Z,
        extent: [9.0, 9.0],
        min_distance: 0.0,
        turn: 0.0,
        seed: 1,
    };
    // 128 bytes each.
    let scatter =
        |count| Edit::Scatter(Scatter { template: 0, count, over: over.clone(), offsets: OffsetSource::None });
    for live in [false, true] {
        let edit = scatter(5000);
        let done = if live { viewer.edit_live(&edit) } else { viewer.edit(&edit) };
        let error = done.unwrap_err();
        assert!(is_out_of_room(&error), "{error}");
        assert!(*viewer.scene() == chairs() && !viewer.editor().is_unsaved());
        assert_eq!(viewer.editor().steps(), [0, 0]);
        assert!(picture(&mut viewer) == before, "as it was");
    }
    viewer.edit(&scatter(5)).unwrap();
    assert_eq!(viewer.scene().instances.len(), chairs().instances.len() + 5);
    assert_silent(&gpu);
}

#[test]
fn what_is_dragged_is_seen_at_once() {
    let Some(gpu) = gpu() else { return };
    let mut viewer = SceneViewer::new(&gpu, chairs(), ViewerOptions::default()).unwrap();
    let camera = Navigator::around(&Orbit::around(&chairs(), None)).camera([96, 64]);
    let picture = |viewer: &mut SceneViewer| {
        viewer.draw(&camera).unwrap();
        viewer.rgb8().unwrap()
    };
    let fresh =
        |scene: &InstancedScene| picture(&mut SceneViewer::new(&gpu, scene.clone(), ViewerOptions::default()).unwrap());
    let at_first = picture(&mut viewer);
    let which = || Selector::Index(1);
    let drags: [Vec<Edit>; 3] = [
        [0.2, -0.3, 0.5].map(|x| Edit::MoveBy { which: which(), by: DVec3::new(x, 0.1, 0.0) }).into(),
        [0.1, 0.4].map(|r| Edit::Recolour { which: which(), rgb: [-r, r, r] }).into(),
        [0.3, 0.1]
            .map(|y| Edit::Crop {
                template: 0,
                corners: [DVec3::new(-1.0, -y, -1.0), DVec3::INFINITY],
                keep: Keep::Inside,
            })
            .into(),
    ];
    for drag in drags {
        let mut seen = vec![at_first.clone()];
        for edit in &drag {
            viewer.edit_live(edit).unwrap();
            let mut want = chairs();
            apply(&mut want, edit).unwrap();
            assert!(*viewer.scene() == want, "each begins where the drag began");
            let now = picture(&mut viewer);
            assert!(now == fresh(&want) && !seen.contains(&now), "{edit:?}");
            seen.push(now);
        }
        viewer.cancel_live().unwrap();
        assert!(picture(&mut viewer) == at_first && viewer.editor().steps()[0] == 0);
        drag.iter().for_each(|edit| drop(viewer.edit_live(edit).unwrap()));
        viewer.editor_mut().finish();
        assert!(viewer.editor().steps() == [1, 0] && picture(&mut viewer) == *seen.last().unwrap());
        assert!(undo(&mut viewer) && picture(&mut viewer) == at_first && !undo(&mut viewer));
    }
    assert_silent(&gpu);
}

/// Pictures of a drag are on their way two at a time, and each is the one of its own places. Each takes two submissions, one that
/// draws and one that makes pixels, whatever is shown and chosen; nobody waits for the last of them.
#[test]
fn dragged_pictures_are_on_their_way_together() {
    if gpu().is_none() {
        return;
    }
    // A device of its own: counts are the device's.
    let device = std::env::var("INSTGS_TEST_DEVICE").map_or(DeviceChoice::Best, |name| name.parse().unwrap());
    let gpu = Gpu::open(&GpuOptions { device, validation: true, ..Default::default() }).unwrap();
    let navigator = Navigator::around(&Orbit::around(&chairs(), None));
    let (size, pictures, first_counted) = ([96, 64], 10, 2);
    let camera = navigator.camera(size);
    let edit = |k: usize| Edit::MoveBy { which: Selector::Index(1), by: DVec3::new(0.05 * (k + 1) as f64, 0.1, 0.0) };
    for (view, chosen) in [
        (View::Color, None),
        (View::Color, Some(1)),
        (View::Instances, None),
        (View::Ellipses, Some(1)),
        (View::Offsets, Some(0)),
    ] {
        let options = ViewerOptions { show: view.show(navigator.distance()), ..ViewerOptions::default() };
        let mut viewer = SceneViewer::new(&gpu, chairs(), options).unwrap();
        viewer.editor_mut().click(chosen, false);
        viewer.draw(&camera).unwrap();
        let pixel_count = size[0] as usize * size[1] as usize;
        let mut shown: Vec<Buffer<u32>> =
            (0..pictures).map(|_| Buffer::for_readback(&gpu, "shown", pixel_count).unwrap()).collect();
        let mut before = SubmissionCounts::default();
        for (k, shown) in shown.iter_mut().enumerate() {
            if k == first_counted {
                before = gpu.submission_counts();
            }
            viewer.edit_live(&edit(k)).unwrap();
            viewer.draw_ahead(&camera).unwrap();
            let (recorder, pixels) = viewer.record_pixels(size, false).unwrap();
            recorder.copy(pixels, shown, 4 * pixel_count as u64).unwrap();
            recorder.submit().unwrap();
            assert!(viewer.in_flight() > 0, "{view:?}");
        }
        let after = gpu.submission_counts();
        let counted = (pictures - first_counted) as u64;
        assert_eq!(after.submissions - before.submissions, 2 * counted, "{view:?}, {chosen:?} chosen");
        assert_eq!(after.drains, before.drains, "{view:?}, {chosen:?} chosen");
        assert!(after.waits - before.waits <= 2 * counted, "{view:?}: {before:?}, {after:?}");
        assert!(viewer.settle().unwrap());
        gpu.wait_all().unwrap();
        for (k, shown) in shown.iter().enumerate() {
            let mut moved = chairs();
            apply(&mut moved, &edit(k)).unwrap();
            let mut fresh = SceneViewer::new(&gpu, moved, options).unwrap();
            fresh.editor_mut().click(chosen, false);
            fresh.draw(&camera).unwrap();
            let got: Vec<u8> = (0..pixel_count)
                .flat_map(|i| {
                    let [r, g, b, _] = shown.read_mapped(i).to_le_bytes();
                    [r, g, b]
                })
                .collect();
            assert!(got == fresh.rgb8().unwrap(), "{view:?}, {chosen:?} chosen, picture {k}: as if opened so");
        }
    }
    assert_silent(&gpu);
}

/// A hidden chair is not seen and not hit, whatever else is edited, and is there again when it is shown.
#[test]
fn hidden_instances_are_as_if_they_were_not_there() {
    let Some(gpu) = gpu() else { return };
    let mut viewer = SceneViewer::new(&gpu, chairs(), ViewerOptions::default()).unwrap();
    let camera = Navigator::around(&Orbit::around(&chairs(), None)).camera([192, 128]);
    let picture = |viewer: &mut SceneViewer| {
        viewer.editor_mut().click(None, false);
        viewer.draw(&camera).unwrap();
        viewer.rgb8().unwrap()
    };
    let without = |scene: &InstancedScene| {
        let mut scene = scene.clone();
        apply(&mut scene, &Edit::Delete { which: Selector::Index(1) }).unwrap();
        picture(&mut SceneViewer::new(&gpu, scene, ViewerOptions::default()).unwrap())
    };
    let at_first = picture(&mut viewer);
    let mean = DVec3::from_array(chairs().templates.means[2].map(f64::from));
    let at = camera.pixel_of(chairs().instances[1].world_from_template.transform_point(mean)).unwrap();
    assert_eq!(viewer.instance_at(at).unwrap(), Some(1));
    let (template, touched) = viewer.template_point_at(at).unwrap().unwrap();
    let back = camera.pixel_of(chairs().instances[1].world_from_template.transform_point(touched)).unwrap();
    assert!(template == 0 && (back[0] - at[0]).hypot(back[1] - at[1]) < 1e-3, "{back:?}");
    assert!(touched.distance(mean) < 0.4, "on the chair: {touched}");
    assert!(!viewer.hide_chosen().unwrap() && !viewer.show_all().unwrap());
    viewer.editor_mut().click(Some(1), false);
    assert!(viewer.hide_chosen().unwrap());
    let hidden = picture(&mut viewer);
    assert!(hidden == without(&chairs()) && hidden != at_first);
    assert_ne!(viewer.instance_at(at).unwrap(), Some(1));
    assert!(*viewer.scene() == chairs() && !viewer.editor().is_unsaved());
    // One that only places, one that uploads everything again.
    viewer.edit(&Edit::MoveBy { which: Selector::Index(2), by: DVec3::new(0.0, 0.2, 0.0) }).unwrap();
    assert!(picture(&mut viewer) == without(viewer.scene()));
    viewer.edit(&Edit::Recolour { which: Selector::Index(0), rgb: [0.3, 0.0, -0.3] }).unwrap();
    assert!(picture(&mut viewer) == without(viewer.scene()));
    // Moved while it is hidden, and the table's entry read back: still hidden.
    viewer.edit(&Edit::MoveBy { which: Selector::Index(1), by: DVec3::new(0.0, 0.2, 0.0) }).unwrap();
    assert!(picture(&mut viewer) == without(viewer.scene()));
    (0..3).for_each(|_| assert!(undo(&mut viewer)));
    assert!(picture(&mut viewer) == hidden);
    assert!(viewer.show_all().unwrap() && picture(&mut viewer) == at_first);
    assert!(undo(&mut viewer) && picture(&mut viewer) == hidden);
    assert!(undo(&mut viewer) && picture(&mut viewer) == at_first);
    assert_silent(&gpu);
}

/// Nor are its levels of detail; a level that is moved is moved with the rest.
#[test]
fn hidden_levels_are_as_if_they_were_not_there() {
    let Some(gpu) = gpu() else { return };
    let render = RenderOptions { lod_error_px: 8.0, ..RenderOptions::default() };
    let options = ViewerOptions { render, ..ViewerOptions::default() };
    let scene = bushes();
    let camera = Navigator::around(&Orbit::around(&scene, None)).camera([48, 32]);
    let picture = |viewer: &mut SceneViewer| {
        viewer.editor_mut().click(None, false);
        viewer.draw(&camera).unwrap();
        viewer.rgb8().unwrap()
    };
    let fresh = |scene: InstancedScene| picture(&mut SceneViewer::new(&gpu, scene, options).unwrap());
    let mut viewer = SceneViewer::new(&gpu, scene.clone(), options).unwrap();
    let at_first = picture(&mut viewer);
    let in_full = picture(&mut SceneViewer::new(&gpu, scene, ViewerOptions::default()).unwrap());
    assert!(at_first != in_full, "there are levels");
    viewer.editor_mut().click(Some(1), false);
    assert!(viewer.hide_chosen().unwrap());
    viewer.edit(&Edit::MoveBy { which: Selector::Index(0), by: DVec3::new(0.0, 0.2, 0.0) }).unwrap();
    let mut left = viewer.scene().clone();
    apply(&mut left, &Edit::Delete { which: Selector::Index(1) }).unwrap();
    assert!(picture(&mut viewer) == fresh(left));
    (0..2).for_each(|_| assert!(undo(&mut viewer)));
    assert!(picture(&mut viewer) == at_first);
    assert_silent(&gpu);
}

/// Three instances of a template of 200 small Gaussians.
fn bushes() -> InstancedScene {
    let mut scene = chairs();
    let mut rng = Rng::new(5);
    let mut place = || [0, 1, 2].map(|_| 0.3 * rng.normal() as f32);
    let leaf = |mean: [f32; 3]| (mean, [1.0, 0.0, 0.0, 0.0], [-4.0; 3], 2.0, mean);
    let leaves: Vec<_> = (0..200).map(|_| leaf(place())).collect();
    scene.templates = Gaussians {
        sh_degree: 0,
        means: leaves.iter().map(|l| l.0).collect(),
        quats: leaves.iter().map(|l| l.1).collect(),
        log_scales: leaves.iter().map(|l| l.2).collect(),
        opacity_logits: leaves.iter().map(|l| l.3).collect(),
        sh: leaves.iter().map(|l| l.4).collect(),
    };
    scene.template_ranges = vec![SourceRange { first: 0, count: 200 }];
    scene.offsets = Offsets::default();
    scene.foreign_tensors.clear();
    for instance in &mut scene.instances {
        (instance.template, instance.first_offset) = (0, None);
    }
    scene
}

/// Files of the scene as it is, in other formats.
#[test]
fn edited_scenes_are_exported() {
    let Some(gpu) = gpu() else { return };
    let mut viewer = SceneViewer::new(&gpu, chairs(), ViewerOptions::default()).unwrap();
    viewer.edit(&Edit::Delete { which: Selector::Index(0) }).unwrap();
    let folder = tempfile::tempdir().unwrap();
    for name in ["x.ply", "x.spz", "x.glb"] {
        viewer.export(&folder.path().join(name), DVec3::NEG_Y).unwrap();
    }
    let cloud = load_scene(&folder.path().join("x.ply")).unwrap().scene;
    assert!(cloud.background == viewer.scene().flatten());
    assert_eq!(load_scene(&folder.path().join("x.spz")).unwrap().scene.background.len(), cloud.background.len());
    let error = viewer.export(&folder.path().join("x.obj"), DVec3::NEG_Y).unwrap_err().to_string();
    assert!(error.contains("unknown format \".obj\""), "{error}");
    assert_silent(&gpu);
}

#[test]
fn clicks_find_instances_and_draw_a_line_around_them() {
    let Some(gpu) = gpu() else { return };
    let scene = chairs();
    let mut viewer = SceneViewer::new(&gpu, scene.clone(), ViewerOptions::default()).unwrap();
    let camera = Navigator::around(&Orbit::around(&scene, None)).camera([192, 128]);
    viewer.draw(&camera).unwrap();
    let plain = viewer.rgb8().unwrap();
    // A Gaussian of each chair, as the camera sees it.
    for (k, instance) in scene.instances.iter().enumerate() {
        let mean = scene.templates.means[2].map(f64::from);
        let at = camera.pixel_of(instance.world_from_template.transform_point(DVec3::from_array(mean))).unwrap();
        assert_eq!(viewer.instance_at(at).unwrap(), Some(k), "{at:?}");
        let point = viewer.point_at(at).unwrap().unwrap();
        let back = camera.pixel_of(point).unwrap();
        assert!((back[0] - at[0]).hypot(back[1] - at[1]) < 1e-6);
    }
    assert_eq!(viewer.instance_at([1.0, 1.0]).unwrap(), None);
    assert_eq!((viewer.instance_at([-1.0, 0.0]).unwrap(), viewer.instance_at([192.0, 0.0]).unwrap()), (None, None));
    assert_eq!(viewer.point_at([1.0, 1.0]).unwrap(), None);
    viewer.editor_mut().click(Some(1), false);
    viewer.draw(&camera).unwrap();
    let lined = viewer.rgb8().unwrap();
    let line = lined.chunks_exact(3).zip(plain.chunks_exact(3)).filter(|(a, b)| a != b).map(|(a, _)| a.to_vec());
    let line: Vec<Vec<u8>> = line.collect();
    assert!(line.len() > 20 && line.iter().all(|rgb| *rgb == [255, 184, 0]), "{} pixels", line.len());
    let (editor, scene) = viewer.editor_and_scene();
    editor.choose_alike(scene);
    assert_eq!(viewer.editor().chosen().len(), 3);
    assert_silent(&gpu);
}

/// A camera, and the pixel of it where a Gaussian of chair 1 is in front.
fn view_of_chair_1(scene: &InstancedScene, navigator: &Navigator) -> (Camera, [f64; 2]) {
    let camera = navigator.camera([192, 128]);
    let mean = DVec3::from_array(scene.templates.means[2].map(f64::from));
    let at = camera.pixel_of(scene.instances[1].world_from_template.transform_point(mean)).unwrap();
    (camera, at)
}

/// A click picks the instance at the surface whatever is shown and chosen; every view has a picture of its own.
#[test]
fn every_view_looks_its_own_way_and_picks_the_same() {
    let Some(gpu) = gpu() else { return };
    let scene = chairs();
    let navigator = Navigator::around(&Orbit::around(&scene, None));
    let (camera, at) = view_of_chair_1(&scene, &navigator);
    let mut pictures = Vec::new();
    for chosen in [None, Some(2)] {
        for view in View::ALL {
            // Nothing is left of another view.
            let options = ViewerOptions { show: view.show(navigator.distance()), ..ViewerOptions::default() };
            let mut viewer = SceneViewer::new(&gpu, scene.clone(), options).unwrap();
            viewer.editor_mut().click(chosen, false);
            viewer.draw(&camera).unwrap();
            let picture = viewer.rgb8().unwrap();
            assert_eq!(viewer.instance_at(at).unwrap(), Some(1), "{view:?}, {chosen:?} chosen");
            assert!(viewer.rgb8().unwrap() == picture, "{view:?}: picking changes the picture");
            assert!(!pictures.contains(&picture), "{view:?}, {chosen:?} chosen: as another");
            pictures.push(picture);
        }
    }
    assert_silent(&gpu);
}

/// Also before a frame shows the edit, which may have given instances other numbers.
#[test]
fn clicks_right_after_an_edit_find_the_instances_of_now() {
    let Some(gpu) = gpu() else { return };
    let scene = chairs();
    let navigator = Navigator::around(&Orbit::around(&scene, None));
    let (camera, at) = view_of_chair_1(&scene, &navigator);
    // With ids in the frame.
    let options = ViewerOptions { show: View::Instances.show(navigator.distance()), ..ViewerOptions::default() };
    let mut viewer = SceneViewer::new(&gpu, scene, options).unwrap();
    viewer.draw(&camera).unwrap();
    assert_eq!(viewer.instance_at(at).unwrap(), Some(1));
    viewer.edit(&Edit::Delete { which: Selector::Index(0) }).unwrap();
    assert_eq!(viewer.instance_at(at).unwrap(), Some(0));
    viewer.draw(&camera).unwrap();
    assert!(undo(&mut viewer));
    assert_eq!(viewer.instance_at(at).unwrap(), Some(1));
    assert_silent(&gpu);
}

/// What the device has no room for is not done or done without, in words: the pictures are those of before.
#[test]
fn what_does_not_fit_is_done_without() {
    if gpu().is_none() {
        return;
    }
    // Its own device: others have no limit.
    let gpu = Gpu::open(&GpuOptions { device: DeviceChoice::Best, validation: true, ..Default::default() }).unwrap();
    let scene = crowd();
    let navigator = Navigator::around(&Orbit::around(&scene, None));
    let camera = navigator.camera([192, 128]);
    let mut viewer = SceneViewer::new(&gpu, scene.clone(), ViewerOptions::default()).unwrap();
    let picture = |viewer: &mut SceneViewer| {
        let words = viewer.draw_what_fits(&camera).unwrap();
        // Reading the picture takes memory that the player has no need of.
        let budget = gpu.memory_budget();
        gpu.set_memory_budget(u64::MAX);
        let picture = viewer.rgb8().unwrap();
        gpu.set_memory_budget(budget);
        (picture, words)
    };
    let (in_full, None) = picture(&mut viewer) else { panic!("there is room") };
    // Half of the chairs go; then there is room for these, but not for all.
    let gone = Edit::Delete { which: Selector::Indices((0..scene.instances.len() / 2).collect()) };
    let fewer = |viewer: &mut SceneViewer| {
        viewer.edit(&gone).unwrap();
        picture(viewer).0
    };
    let of_fewer = fewer(&mut viewer);
    assert!(undo(&mut viewer));
    assert!(redo(&mut viewer));
    gpu.set_memory_budget(upload_peak(&gpu, &mut viewer));
    let refused = viewer.undo().unwrap_err();
    assert!(is_out_of_room(&refused) && viewer.editor().steps() == [1, 0], "{refused}");
    assert!(picture(&mut viewer) == (of_fewer.clone(), None) && viewer.scene().instances.len() < scene.instances.len());
    gpu.set_memory_budget(u64::MAX);
    assert!(undo(&mut viewer) && picture(&mut viewer) == (in_full.clone(), None));

    // Levels of detail, a view that needs surfaces, and what is chosen.
    gpu.set_memory_budget(upload_peak(&gpu, &mut viewer));
    viewer.options.render.lod_error_px = 2.0;
    let (got, words) = picture(&mut viewer);
    assert!(got == in_full && viewer.options.render.lod_error_px == 0.0);
    assert!(viewer.take_arrived().iter().all(|stats| stats.slabs == 1), "nor is it slower");
    assert!(words.is_some_and(|words| words.starts_with("levels of detail are off: out of device memory")));
    gpu.set_memory_budget(gpu.memory_usage().0);
    viewer.options.show = View::Instances.show(navigator.distance());
    let (got, words) = picture(&mut viewer);
    assert!(got == in_full && View::of(viewer.options.show) == View::Color);
    assert!(words.is_some_and(|words| words.starts_with("the view is back to colours: out of device memory")));
    viewer.editor_mut().click(Some(0), false);
    let (got, words) = picture(&mut viewer);
    assert!(got == in_full && viewer.editor().chosen().is_empty());
    assert!(words.is_some_and(|words| words.starts_with("the selection was cleared: out of device memory")));
    assert_silent(&gpu);
}

/// Views and selections whose frames would have to be divided, which only those of colours are, are done without, too.
#[test]
fn what_cannot_be_divided_is_done_without() {
    let Some(gpu) = gpu() else { return };
    let navigator = Navigator::around(&Orbit::around(&crowd(), None));
    let camera = navigator.camera([192, 128]);
    let render = RenderOptions { lod_error_px: 1e-3, ..RenderOptions::default() };
    let mut viewer = SceneViewer::new(&gpu, crowd(), ViewerOptions { render, ..ViewerOptions::default() }).unwrap();
    viewer.draw(&camera).unwrap();
    let in_full = viewer.rgb8().unwrap();
    let chunks = viewer.take_arrived().last().unwrap().work_items as u32;
    // With room for all, so that the next frame goes ahead and is found to be too much only when it has arrived.
    let instances = View::Instances.show(navigator.distance());
    viewer.options.show = instances;
    assert_eq!(viewer.draw_what_fits(&camera).unwrap(), None);
    assert!(viewer.settle().unwrap() && viewer.options.show == instances);
    viewer.options.render.max_chunks = Some(chunks - 1);
    let picture = |viewer: &mut SceneViewer| {
        let words = viewer.draw_what_fits(&camera).unwrap();
        viewer.settle().unwrap();
        let words = words.or(viewer.draw_what_fits(&camera).unwrap());
        assert_eq!(viewer.draw_what_fits(&camera).unwrap(), None, "told once");
        (viewer.rgb8().unwrap(), words)
    };
    let (got, words) = picture(&mut viewer);
    assert!(got == in_full && View::of(viewer.options.show) == View::Color);
    assert!(words.as_ref().is_some_and(|w| w.starts_with("the view is back to colours: visible chunks")), "{words:?}");
    viewer.editor_mut().click(Some(0), false);
    let (got, words) = picture(&mut viewer);
    assert!(got == in_full && viewer.editor().chosen().is_empty());
    assert!(words.as_ref().is_some_and(|w| w.starts_with("the selection was cleared: visible chunks")), "{words:?}");
    let error = viewer.instance_at([96.0, 64.0]).unwrap_err();
    assert!(error.is_too_much() && !error.is_out_of_memory(), "{error}");
    assert!(picture(&mut viewer) == (in_full, None));
    assert!(viewer.options.render.lod_error_px > 0.0, "without levels there would be more chunks");
    assert_silent(&gpu);
}

/// Bytes in use at most while the scene goes to the device again.
fn upload_peak(gpu: &Gpu, viewer: &mut SceneViewer) -> u64 {
    gpu.reset_memory_peak();
    viewer.edit_live(&Edit::Recolour { which: Selector::Template(0), rgb: [0.1; 3] }).unwrap();
    viewer.cancel_live().unwrap();
    gpu.memory_usage().1
}

/// Twenty bushes, each with offsets of its own.
fn crowd() -> InstancedScene {
    let mut scene = bushes();
    let instance = |k: u32| Instance {
        world_from_template: Similarity::from_parts(
            DMat3::IDENTITY,
            1.0,
            DVec3::new(f64::from(k % 5), 0.0, f64::from(k / 5)),
        ),
        template: 0,
        first_offset: Some(200 * k),
    };
    scene.instances = (0..20).map(instance).collect();
    scene.groups.clear();
    scene.offsets = Offsets {
        means: vec![[0.01; 3]; 4000],
        sh_dc: vec![[0.1; 3]; 4000],
        opacity_logits: vec![0.1; 4000],
        ..Offsets::default()
    };
    scene
}
