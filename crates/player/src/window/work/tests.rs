//! Cameras of frames for files, and files that are written beside the picture, without a window.

use super::*;
use instgs_io::write_cameras;
use instgs_samples::sample_scene;
use instgs_vk::scene::PixelFilter;

#[test]
fn a_turntable_closes_and_a_path_ends_where_it_should() {
    let first = Camera::look_at("a", DVec3::new(3.0, 0.0, 1.0), DVec3::ZERO, DVec3::Z, 0.8, (160, 90));
    let circle = turntable(&first, DVec3::ZERO, DVec3::Z, 4);
    assert!(circle[0].position_world().distance(first.position_world()) < 1e-9 && circle[0].fy == first.fy);
    assert!(circle[2].position_world().distance(DVec3::new(-3.0, 0.0, 1.0)) < 1e-9);
    let path = along(&circle[..3], [64, 36], 11);
    assert_eq!((path.len(), path[0].width), (11, 64));
    assert!(path[10].position_world().distance(circle[2].position_world()) < 1e-6);
    assert!(path[5].position_world().distance(circle[1].position_world()) < 1e-6);
}

#[test]
fn a_turntable_keeps_the_roll_and_may_look_straight_down() {
    let target = DVec3::new(1.0, -2.0, 0.5);
    // From above, and tilted with the horizon at an angle.
    for (eye, upwards) in [(target + 3.0 * DVec3::Z, DVec3::Y), (target + DVec3::new(2.0, 1.0, 1.5), DVec3::ONE)] {
        let first = Camera::look_at("a", eye, target, upwards, 0.8, (160, 90));
        let level = |camera: &Camera| camera.rotation().row(0).z;
        let circle = turntable(&first, target, DVec3::Z, 8);
        for camera in &circle {
            camera.validate().unwrap();
            let middle = camera.pixel_of(target).unwrap();
            assert!((middle[0] - 80.0).hypot(middle[1] - 45.0) < 1e-9 && (level(camera) - level(&first)).abs() < 1e-9);
        }
        let right = |k: usize| circle[k].rotation().row(0).truncate();
        assert!((right(0) + right(4)).length() < 1e-9, "half a turn looks the other way");
    }
}

#[test]
fn a_way_along_far_cameras_moves_at_every_step_and_squeezes_nothing() {
    let first = Camera::look_at("a", DVec3::new(3.0, 0.0, 1.0), DVec3::ZERO, DVec3::Z, 0.8, (160, 90));
    let path = along(&turntable(&first, DVec3::ZERO, DVec3::Z, 4)[..3], [64, 64], 120);
    assert_eq!(path.len(), 120);
    for pair in path.windows(2) {
        let step = pair[0].position_world().distance(pair[1].position_world());
        assert!((0.04..0.08).contains(&step), "{}: {step}", pair[1].name);
    }
    assert!(path.iter().all(|camera| (camera.fx - camera.fy).abs() < 1e-9 && camera.width == 64));
}

/// The sample scene, for a file in a folder; the scene is from a file beside it.
fn writing(folder: &Path, name: &str) -> Writing {
    let to = folder.join(name);
    Writing {
        scene: sample_scene(),
        from: folder.join("scene.instgs"),
        format: ExportFormat::of(&to, None).unwrap(),
        to,
        saves: false,
        up: DVec3::Z,
        up_of_user: None,
        cancelled: Arc::default(),
    }
}

#[test]
fn what_is_cancelled_leaves_no_file() {
    for name in ["a.ply", "a.html"] {
        for (cancelled, files) in [(true, 0), (false, 1)] {
            let folder = tempfile::tempdir().unwrap();
            let job = writing(folder.path(), name);
            let to = job.to.clone();
            job.cancelled.store(cancelled, Ordering::Relaxed);
            assert_eq!(job.run().is_err(), cancelled, "{name}");
            assert_eq!((folder.path().read_dir().unwrap().count(), to.exists()), (files, !cancelled), "{name}");
        }
    }
}

/// A scene is often a link into a folder of many: what is saved goes there, and the link stays.
#[cfg(unix)]
#[test]
fn a_link_stays_and_leads_to_what_was_saved() {
    for (name, saves) in [("a.instgs", true), ("a.ply", false)] {
        let (folder, elsewhere) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
        let real = elsewhere.path().join("real");
        std::fs::write(&real, b"old").unwrap();
        let job = Writing { saves, ..writing(folder.path(), name) };
        std::os::unix::fs::symlink(&real, &job.to).unwrap();
        let to = job.to.clone();
        job.run().unwrap();
        assert_eq!(std::fs::read_link(&to).unwrap(), real, "{name}");
        assert!(real.metadata().unwrap().len() > 100, "{name}");
        assert_eq!(elsewhere.path().read_dir().unwrap().count(), 1, "{name}");
    }
}

#[test]
fn a_page_has_its_files_name_and_the_first_training_camera() {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("cameras.json");
    let camera = |name: &str| Camera::look_at(name, DVec3::X, DVec3::ZERO, DVec3::NEG_Y, 0.8, (160, 90));
    write_cameras(&file, &[camera("first_view"), camera("second_view")]).unwrap();
    let page = |job: Writing| {
        let to = job.to.clone();
        (job.run().unwrap(), std::fs::read_to_string(to).unwrap())
    };
    let (notes, text) = page(writing(folder.path(), "room.html"));
    assert_eq!(notes, Vec::<String>::new());
    assert!(text.contains("<title>room</title>") && text.contains("first_view") && !text.contains("second_view"));
    std::fs::write(&file, "no cameras").unwrap();
    let (notes, text) = page(writing(folder.path(), "hall.html"));
    assert!(notes.len() == 1 && notes[0].contains("cameras.json"), "{notes:?}");
    assert!(text.contains("<title>hall</title>") && !text.contains("first_view"));
}

#[test]
fn what_a_file_cannot_hold_is_told_with_its_name() {
    let folder = tempfile::tempdir().unwrap();
    let mut job = writing(folder.path(), "a.glb");
    job.scene.pixel_filter = PixelFilter { antialias: true, dilation_px2: 0.1 };
    let done = texts::exported(&job.to);
    let notes = job.run().unwrap();
    assert!(notes.len() == 2 && notes[0].starts_with(".glb has no place"), "{notes:?}");
    let text = texts::with_notes(done.clone(), &notes);
    assert!(text.starts_with(&format!("{done}; .glb has no place")) && text.ends_with("(and 1 more)"), "{text}");
    assert_eq!(texts::with_notes(done.clone(), &notes[..1]), format!("{done}; {}", notes[0]));
    assert_eq!(texts::with_notes(done.clone(), &[]), done);
}

/// Files of this kind that nobody has locked are removed by whoever writes into the folder for the first time.
#[cfg(unix)]
#[test]
fn a_video_that_is_being_made_is_not_taken_for_one_left_behind() {
    let folder = tempfile::tempdir().unwrap();
    let to = folder.path().join("a.mp4");
    let part = part_of(&to, &to).unwrap();
    let same_file = std::fs::File::open(part.path()).unwrap();
    assert!(same_file.try_lock().is_err() && part.path().extension().is_some_and(|ending| ending == "mp4"));
}
