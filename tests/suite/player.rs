//! What the player draws after edits is what it draws of a scene that was opened so; and a picture shows whom one clicks on.

use glam::DVec3;
use instgs_vk::io::load_scene;
use instgs_vk::player::navigation::Navigator;
use instgs_vk::player::views::View;
use instgs_vk::player::{Stage, StageOptions};
use instgs_vk::scene::edit::{Edit, Selector, Turn};
use instgs_vk::scene::trajectory::Orbit;

use crate::common::chairs::chairs;
use crate::common::gpu::{assert_silent, gpu};

#[test]
fn edited_scenes_look_as_if_opened_so() {
    let Some(gpu) = gpu() else { return };
    let mut stage = Stage::new(&gpu, chairs(), StageOptions::default()).unwrap();
    let navigator = Navigator::around(&Orbit::around(&chairs(), None));
    let camera = navigator.camera([96, 64]);
    let picture = |stage: &mut Stage| {
        stage.draw(&camera).unwrap();
        let got = stage.rgb8().unwrap();
        let mut fresh = Stage::new(&gpu, stage.scene().clone(), StageOptions::default()).unwrap();
        fresh.draw(&camera).unwrap();
        assert!(got == fresh.rgb8().unwrap(), "as if opened so");
        got
    };
    let which = || Selector::Indices(vec![0, 2]);
    let mut pictures = vec![picture(&mut stage)];
    for edit in [
        Edit::MoveBy { which: which(), by: DVec3::new(0.3, 0.2, 0.1) },
        Edit::Rotate { which: which(), turn: Turn { axis: DVec3::Y, angle: 0.7 } },
        Edit::Scale { which: Selector::Index(1), by: 2.0 },
        Edit::Duplicate { which: which(), by: DVec3::new(0.0, -0.5, 0.0), turn: None },
        Edit::Recolour { which: Selector::Index(0), rgb: [0.3, 0.0, -0.3] },
        Edit::Delete { which: which() },
    ] {
        stage.edit(&edit).unwrap().unwrap();
        // Nothing chosen, so that there are no lines.
        stage.click(None, false);
        let now = picture(&mut stage);
        assert!(pictures.last() != Some(&now), "{edit:?} shows");
        pictures.push(now);
    }
    for want in pictures.iter().rev().skip(1) {
        assert!(stage.undo().unwrap());
        stage.click(None, false);
        assert!(picture(&mut stage) == *want);
    }
    assert!(!stage.undo().unwrap() && stage.redo().unwrap() && stage.editor().is_unsaved());
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("edited.instgs");
    stage.save(&path).unwrap();
    assert!(!stage.editor().is_unsaved() && load_scene(&path).unwrap().scene == *stage.scene());
    assert_silent(&gpu);
}

#[test]
fn clicks_find_instances_and_draw_a_line_around_them() {
    let Some(gpu) = gpu() else { return };
    let scene = chairs();
    let mut stage = Stage::new(&gpu, scene.clone(), StageOptions::default()).unwrap();
    let camera = Navigator::around(&Orbit::around(&scene, None)).camera([192, 128]);
    stage.draw(&camera).unwrap();
    let plain = stage.rgb8().unwrap();
    // A Gaussian of each chair, as the camera sees it.
    for (k, instance) in scene.instances.iter().enumerate() {
        let mean = scene.templates.means[2].map(f64::from);
        let at = camera.pixel_of(instance.world_from_template.transform_point(DVec3::from_array(mean))).unwrap();
        assert_eq!(stage.instance_at(at).unwrap(), Some(k), "{at:?}");
        let point = stage.point_at(at).unwrap().unwrap();
        let back = camera.pixel_of(point).unwrap();
        assert!((back[0] - at[0]).hypot(back[1] - at[1]) < 1e-6);
    }
    assert_eq!(stage.instance_at([1.0, 1.0]).unwrap(), None);
    assert_eq!((stage.instance_at([-1.0, 0.0]).unwrap(), stage.instance_at([192.0, 0.0]).unwrap()), (None, None));
    assert_eq!(stage.point_at([1.0, 1.0]).unwrap(), None);
    stage.click(Some(1), false);
    stage.draw(&camera).unwrap();
    let lined = stage.rgb8().unwrap();
    let line = lined.chunks_exact(3).zip(plain.chunks_exact(3)).filter(|(a, b)| a != b).map(|(a, _)| a.to_vec());
    let line: Vec<Vec<u8>> = line.collect();
    assert!(line.len() > 20 && line.iter().all(|rgb| *rgb == [255, 184, 0]), "{} pixels", line.len());
    stage.choose_alike();
    assert_eq!(stage.editor().chosen().len(), 3);
    assert_silent(&gpu);
}

/// A click picks the instance at the surface whatever is shown and chosen; every view has a picture of its own.
#[test]
fn every_view_looks_its_own_way_and_picks_the_same() {
    let Some(gpu) = gpu() else { return };
    let scene = chairs();
    let navigator = Navigator::around(&Orbit::around(&scene, None));
    let camera = navigator.camera([192, 128]);
    let mean = DVec3::from_array(scene.templates.means[2].map(f64::from));
    let at = camera.pixel_of(scene.instances[1].world_from_template.transform_point(mean)).unwrap();
    let mut pictures = Vec::new();
    for chosen in [None, Some(2)] {
        for view in View::ALL {
            // Nothing is left of another view.
            let options = StageOptions { show: view.show(navigator.distance()), ..StageOptions::default() };
            let mut stage = Stage::new(&gpu, scene.clone(), options).unwrap();
            stage.click(chosen, false);
            stage.draw(&camera).unwrap();
            let picture = stage.rgb8().unwrap();
            assert_eq!(stage.instance_at(at).unwrap(), Some(1), "{view:?}, {chosen:?} chosen");
            assert!(stage.rgb8().unwrap() == picture, "{view:?}: picking changes the picture");
            assert!(!pictures.contains(&picture), "{view:?}, {chosen:?} chosen: as another");
            pictures.push(picture);
        }
    }
    assert_silent(&gpu);
}
