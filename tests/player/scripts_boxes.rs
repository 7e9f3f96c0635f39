//! Boxes around objects, drawn and found in a window of `instgs-player` on a virtual display.

use std::path::Path;

use glam::{DQuat, DVec3};
use instgs_io::{ExportFormat, export_scene, load_scene, read_boxes};
use instgs_player::box_handles::{BoxHandles, BoxPart};
use instgs_player::gizmo::GizmoMode;
use instgs_player::navigation::Navigator;
use instgs_vk::math::covariance::logit;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::trajectory::Orbit;
use instgs_vk::scene::{Camera, Gaussians, InstancedScene, ObjectBox};

use crate::common::program::{error_of, skips_gpu};
use crate::scripts::{VirtualDisplay, play_script, player};

/// Of a block: middle, and edges.
type Block = (DVec3, DVec3);

/// A bench with a back at one end: no turn but a whole one brings it onto itself.
const BENCH: [Block; 2] =
    [(DVec3::new(0.0, 0.0, 0.25), DVec3::new(1.6, 0.8, 0.5)), (DVec3::new(-0.65, 0.1, 0.8), DVec3::new(0.3, 0.6, 0.6))];
/// What else stands there: a post and a case.
const POST: [Block; 1] = [(DVec3::new(0.0, 0.0, 0.8), DVec3::new(0.3, 0.3, 1.6))];
const CASE: [Block; 1] = [(DVec3::new(0.0, 0.0, 0.3), DVec3::new(0.6, 0.6, 0.6))];
/// Middle of the floor under each bench, and its turn about the vertical.
const BENCHES: [([f64; 2], f64); 4] = [([0.2, -2.6], 0.4), ([-2.6, 0.3], 2.0), ([2.4, 0.6], -1.1), ([0.0, 2.8], 3.0)];
/// A larger bench: how many times as large, and where.
const LARGER: f64 = 1.5;
const LARGE_PLACE: [f64; 2] = [-3.4, 3.4];
/// Gaussians for a square unit of surface.
const DENSITY: f64 = 220.0;

/// Benches, a post and a case on a floor at height 0; z is up. Surfaces are opaque discs.
fn place() -> Gaussians {
    let mut rng = Rng::new(5);
    let mut out = Gaussians::with_capacity(0, 0);
    let floor = (DVec3::new(0.0, 0.0, -0.05), DVec3::new(10.0, 10.0, 0.1));
    surface(&mut out, &mut rng, &[floor], ([0.0; 2], 0.0), [0.35, 0.4, 0.3]);
    for (k, place) in BENCHES.into_iter().enumerate() {
        surface(&mut out, &mut rng, &BENCH, place, [0.9 - 0.2 * k as f32, 0.3, 0.2 + 0.2 * k as f32]);
    }
    surface(&mut out, &mut rng, &POST, ([-2.5, -2.5], 0.3), [0.2, 0.2, 0.9]);
    surface(&mut out, &mut rng, &CASE, ([2.7, -2.2], 0.8), [0.9, 0.9, 0.2]);
    out
}

/// The sides and tops of blocks, as flat Gaussians.
fn surface(out: &mut Gaussians, rng: &mut Rng, blocks: &[Block], ([x, y], turn): ([f64; 2], f64), rgb: [f32; 3]) {
    let turn = DQuat::from_rotation_z(turn);
    for &(middle, edges) in blocks {
        for (axis, side) in [(0, 0.5), (0, -0.5), (1, 0.5), (1, -0.5), (2, 0.5)] {
            let area = edges[(axis + 1) % 3] * edges[(axis + 2) % 3];
            // A floor needs fewer.
            let count = if area > 50.0 { 2500 } else { (DENSITY * area) as usize };
            for _ in 0..count {
                let mut p = DVec3::new(rng.range(-0.5, 0.5), rng.range(-0.5, 0.5), rng.range(-0.5, 0.5));
                p[axis] = side;
                let mean = DVec3::new(x, y, 0.0) + turn * (middle + p * edges);
                let spread = (0.5 * (area / count as f64).sqrt()) as f32;
                let mut scales = [spread.max(0.02).ln(); 3];
                scales[axis] = 0.01f32.ln();
                out.means.push(mean.as_vec3().to_array());
                out.quats.push([turn.w as f32, turn.x as f32, turn.y as f32, turn.z as f32]);
                out.log_scales.push(scales);
                out.opacity_logits.push(logit(0.95) as f32);
                out.sh.push(rgb.map(|c| (c - 0.5) / 0.282));
            }
        }
    }
}

/// The cloud as a file, and as the player opens it.
fn cloud_file(folder: &Path) -> (std::path::PathBuf, Camera) {
    file_of(folder, place())
}

fn file_of(folder: &Path, cloud: Gaussians) -> (std::path::PathBuf, Camera) {
    let file = folder.join("place.ply");
    let scene = InstancedScene::from_cloud(cloud);
    export_scene(&file, &scene, ExportFormat::of(&file, None).unwrap(), DVec3::Z).unwrap();
    let opened = load_scene(&file).unwrap().scene;
    let orbit = Orbit::around(&opened, None);
    assert_eq!(orbit.up, DVec3::Z);
    (file, Navigator::around(&orbit).camera([320, 240]))
}

/// Where the middle of the top of a bench's seat is in the window, pixels.
fn seat_px(camera: &Camera, bench: usize) -> [f64; 2] {
    let ([x, y], turn) = BENCHES[bench];
    camera.pixel_of(DVec3::new(x, y, 0.5) + DQuat::from_rotation_z(turn) * DVec3::new(0.2, 0.0, 0.0)).unwrap()
}

/// The bench whose place a box has, if it is about as large.
fn bench_of(object: &ObjectBox) -> Option<usize> {
    let fits = |&k: &usize| {
        let ([x, y], turn) = BENCHES[k];
        let along = DQuat::from_rotation_z(turn) * DVec3::X;
        object.center.distance(DVec3::new(x, y, 0.55)) < 0.12
            && (object.size - DVec3::new(1.6, 0.8, 1.1)).abs().max_element() < 0.25
            && (object.world_from_box * DVec3::X).dot(along).abs() > 0.99
    };
    (0..BENCHES.len()).find(fits)
}

/// Click a bench: a box goes around it. The other benches are found; the file says where all are.
#[test]
fn one_is_clicked_and_the_rest_is_found() {
    let Some(display) = (if skips_gpu() { None } else { VirtualDisplay::open() }) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (file, camera) = cloud_file(folder.path());
    let [x, y] = seat_px(&camera, 0);
    let output = play_script(
        &display,
        &file,
        &format!(
            "key KeyH\n frames 2\n shot plain.png\n key KeyB\n double {x} {y}\n boxes none.json\n key KeyR\n frames 40\n \
             click {x} {y}\n key ctrl+KeyS\n key KeyF\n found\n frames 40\n double {x} {y}\n \
             boxes all.json\n key KeyR\n key Delete\n boxes left.json\n key ctrl+KeyZ\n lose\n frames 2\n \
             boxes after.json\n key KeyB\n frames 1\n shot again.png\n quit\n"
        ),
    );
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let boxes = |name: &str| read_boxes(&folder.path().join(name)).unwrap().objects;
    assert!(!folder.path().join("none.json").exists(), "a double click leaves no box to save");
    let drawn = boxes("place.boxes.json");
    assert_eq!(drawn.iter().map(bench_of).collect::<Vec<_>>(), [Some(0)], "{drawn:?}");
    let all = boxes("all.json");
    let mut found: Vec<usize> = all.iter().filter_map(bench_of).collect();
    found.sort();
    assert_eq!(found, [0, 1, 2, 3], "each bench once: {all:?}");
    let ids: Vec<u32> = all.iter().map(|object| object.id).collect();
    // The double click's box had 1.
    assert_eq!(ids, (2..=all.len() as u32 + 1).collect::<Vec<_>>());
    // The chosen one is the one that was clicked.
    assert_eq!((all[0].clone(), boxes("left.json")), (drawn[0].clone(), all[1..].to_vec()));
    assert_eq!(boxes("after.json"), all, "another device has the boxes too");
    let shot = |name: &str| image::open(folder.path().join(name)).unwrap().to_rgb8().into_raw();
    assert!(shot("plain.png") == shot("again.png"), "boxes are over the picture, not in it");
}

#[test]
fn nothing_but_the_rest_is_found() {
    let Some(display) = (if skips_gpu() { None } else { VirtualDisplay::open() }) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (file, camera) = cloud_file(folder.path());
    let [x, y] = seat_px(&camera, 0);
    let steps = format!("key KeyH\n frames 2\n key KeyB\n click {x} {y}\n key KeyF\n found\n boxes all.json\n quit\n");
    let output = play_script(&display, &file, &steps);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let all = read_boxes(&folder.path().join("all.json")).unwrap().objects;
    assert!(all.len() == 4 && all.iter().all(|object| bench_of(object).is_some()), "{all:?}");
}

/// A bench half as large again is found if other sizes are asked for, and no longer if they are not.
#[test]
fn other_sizes_are_found_when_they_are_asked_for() {
    let Some(display) = (if skips_gpu() { None } else { VirtualDisplay::open() }) else { return };
    let folder = tempfile::tempdir().unwrap();
    let mut cloud = place();
    let large = BENCH.map(|(middle, edges)| (LARGER * middle, LARGER * edges));
    surface(&mut cloud, &mut Rng::new(6), &large, (LARGE_PLACE, 0.9), [0.3, 0.8, 0.3]);
    let (file, camera) = file_of(folder.path(), cloud);
    let [x, y] = seat_px(&camera, 0);
    let steps = format!(
        "key KeyH\n frames 2\n key KeyB\n click {x} {y}\n key KeyO\n key KeyF\n found\n boxes all.json\n key KeyO\n key KeyF\n \
         found\n boxes same.json\n quit\n"
    );
    let output = play_script(&display, &file, &steps);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let read = |name: &str| read_boxes(&folder.path().join(name)).unwrap().objects;
    let is_large = |object: &&ObjectBox| {
        let [x, y] = LARGE_PLACE;
        object.center.distance(DVec3::new(x, y, LARGER * 0.55)) < 0.2
            && (object.size - LARGER * DVec3::new(1.6, 0.8, 1.1)).abs().max_element() < 0.35
    };
    let (all, same) = (read("all.json"), read("same.json"));
    assert_eq!((all.iter().filter(is_large).count(), all.len()), (1, 5), "{all:?}");
    assert!(same.len() == 4 && same.iter().all(|object| bench_of(object).is_some()), "{same:?}");
}

/// A dot moves one face of the box; what comes from a file can be changed; the ground gets no box.
#[test]
fn a_box_of_a_file_is_resized_by_its_dots() {
    let Some(display) = (if skips_gpu() { None } else { VirtualDisplay::open() }) else { return };
    let folder = tempfile::tempdir().unwrap();
    let (file, camera) = cloud_file(folder.path());
    let object = ObjectBox {
        id: 7,
        category: Some("bench".into()),
        center: DVec3::new(0.2, -2.6, 0.55),
        size: DVec3::new(1.7, 0.9, 1.1),
        world_from_box: DQuat::from_rotation_z(0.4),
    };
    let text = r#"{"objects": [{"id": 7, "category": "bench", "center": [0.2, -2.6, 0.55], "size": [1.7, 0.9, 1.1],
        "rotation": [0.980066577841, 0, 0, 0.198669330795]}], "views": {"a": [{"box_px": [1, 2, 3, 4]}]}}"#;
    let given = folder.path().join("given.json");
    std::fs::write(&given, text).unwrap();
    let handles = BoxHandles::new(&object, GizmoMode::Move, &camera);
    let top = BoxPart::Face(2, true);
    let [x, y] = handles.dots().into_iter().find(|(part, _)| *part == top).unwrap().1;
    let [to_x, to_y] = camera.pixel_of(object.center + DVec3::new(0.0, 0.0, 0.55 + 0.4)).unwrap();
    let [seat_x, seat_y] = seat_px(&camera, 0);
    let [floor_x, floor_y] = camera.pixel_of(DVec3::new(1.5, -1.2, 0.0)).unwrap();
    let script = folder.path().join("script.txt");
    let steps = format!(
        "key KeyH\n frames 1\n click {seat_x} {seat_y}\n frames 1\n drag left {x} {y} {to_x} {to_y}\n frames 1\n boxes taller.json\n \
         click {floor_x} {floor_y}\n boxes same.json\n key ctrl+KeyZ\n boxes undone.json\n quit\n"
    );
    std::fs::write(&script, steps).unwrap();
    let mut player = player();
    player.env("DISPLAY", &display.1).arg(&file).args(["--size", "320x240", "--script"]).arg(&script);
    player.arg("--boxes").arg(&given).timeout(std::time::Duration::from_secs(300)).assert().success();
    let read = |name: &str| read_boxes(&folder.path().join(name)).unwrap();
    let taller = read("taller.json");
    assert_eq!((taller.objects.len(), taller.views.len()), (1, 1));
    let got = &taller.objects[0];
    assert_eq!((got.id, got.category.as_deref()), (7, Some("bench")));
    // To a pixel of the pointer, here 0.02 units.
    assert!((got.size - DVec3::new(1.7, 0.9, 1.5)).abs().max_element() < 0.04, "{got:?}");
    assert!((got.center - DVec3::new(0.2, -2.6, 0.75)).abs().max_element() < 0.02, "{got:?}");
    assert_eq!(read("same.json"), taller, "the ground gets no box");
    assert_eq!(read("undone.json").objects[0].size, object.size);
}

#[test]
fn bad_boxes_end_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let (file, _) = cloud_file(folder.path());
    let boxes = folder.path().join("boxes.json");
    std::fs::write(&boxes, r#"{"objects": [{"id": 1, "center": [0, 0, 0], "size": [1, 1, -1]}]}"#).unwrap();
    let text = error_of(player().arg(&file).arg("--boxes").arg(&boxes));
    assert!(text.contains("boxes.json") && text.contains("objects[0]"), "{text}");
}
