//! `instgs-player` as a user runs it: without a window, and in a real one on a virtual display.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

use assert_cmd::Command;
use glam::DVec3;
use instgs_io::{load_scene, read_cameras, save_scene};
use instgs_player::gizmo::{Gizmo, GizmoMode, Handle};
use instgs_player::navigation::Navigator;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::edit::template_centres;
use instgs_vk::scene::trajectory::Orbit;
use instgs_vk::scene::{Camera, InstancedScene};
use serde_json::Value;

use crate::common::chairs::chairs;
use crate::common::program::{built, error_of, program, skips_gpu};

pub(crate) fn player() -> Command {
    let mut player = Command::new(built("instgs-player"));
    player.env("INSTGS_VALIDATION", "1").env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    // Else winit takes it from the display's millimetres.
    player.env("WINIT_X11_SCALE_FACTOR", "1");
    player
}

fn scene(folder: &Path) -> PathBuf {
    let scene = folder.join("scene.instgs");
    save_scene(&scene, &chairs()).unwrap();
    scene
}

pub(crate) fn pixels(path: &Path) -> (u32, u32, Vec<u8>) {
    let picture = image::open(path).unwrap().to_rgb8();
    (picture.width(), picture.height(), picture.into_raw())
}

/// An X server without a screen, killed when dropped.
pub(crate) struct VirtualDisplay(Child, pub(crate) String);

impl VirtualDisplay {
    /// # Panics
    /// Without Xvfb, unless INSTGS_SKIP_WINDOW=1 says that tests with a window are not wanted.
    #[allow(clippy::print_stderr, reason = "a skipped test must be heard")]
    pub(crate) fn open() -> Option<Self> {
        Self::open_of("800x600x24")
    }

    /// A display of a size and depth, as Xvfb names them.
    pub(crate) fn open_of(screen: &str) -> Option<Self> {
        if std::env::var_os("INSTGS_SKIP_WINDOW").is_some_and(|v| v == "1") {
            eprintln!("INSTGS_SKIP_WINDOW=1: A TEST THAT NEEDS A VIRTUAL DISPLAY IS SKIPPED");
            return None;
        }
        let mut server = std::process::Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", screen, "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb starts (package xvfb; tools/setup installs it; INSTGS_SKIP_WINDOW=1 skips this test)");
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        Some(Self(server, format!(":{}", number.trim())))
    }
}

impl Drop for VirtualDisplay {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// A display, and a scene in a folder of its own; `None` where tests with a device or a window are not wanted.
pub(crate) fn open_display() -> Option<(VirtualDisplay, tempfile::TempDir, PathBuf)> {
    let display = if skips_gpu() { None } else { VirtualDisplay::open() }?;
    let folder = tempfile::tempdir().unwrap();
    let file = scene(folder.path());
    Some((display, folder, file))
}

/// The picture without a window is that of `render`; the one from a window is the same, byte for byte.
#[test]
fn pictures_are_those_of_render_with_and_without_a_window() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let (size, frames) = ("160x90", "3");
    let shot = |name: &str| folder.path().join(name);
    let play = |player: &mut Command, shot: &Path| -> Value {
        player.arg(&scene).args(["--frames", frames, "--size", size, "--background", "0.2,0.4,0.6", "--json", "-"]);
        serde_json::from_slice(&player.arg("--screenshot").arg(shot).assert().success().get_output().stdout).unwrap()
    };
    let report = play(player().arg("--headless"), &shot("headless.png"));
    assert_eq!((&report["frames"], &report["window"]), (&3.into(), &false.into()));
    assert_eq!(report["resolution"], serde_json::json!([160, 90]));
    assert!(report["fps"].as_f64().unwrap() > 0.0 && report["gaussians"]["visible"].as_u64().unwrap() > 0);
    assert!(report["passes_ms"]["tile_blend"].as_f64().unwrap() > 0.0 && report["present_ms"].as_f64().unwrap() > 0.0);
    assert!(report["ui_ms"].is_null(), "there is no interface without a window");

    let out = folder.path().join("rendered");
    let mut render = program();
    render.args(["render", "--orbit", frames, "--size", size, "--background", "0.2,0.4,0.6", "--scene"]).arg(&scene);
    render.arg("--out").arg(&out).assert().success();
    let (want, got) = (pixels(&out.join("002.png")), pixels(&shot("headless.png")));
    assert_eq!((want.0, want.1), (got.0, got.1));
    // Host and device round to bytes alike, but for a device that fuses the product with the sum.
    assert!(want.2.iter().zip(&got.2).all(|(a, b)| a.abs_diff(*b) <= 1));
    assert!(want.2.iter().zip(&got.2).filter(|(a, b)| a != b).count() * 1000 <= want.2.len());
    assert!(want.2.chunks_exact(3).any(|rgb| rgb != [51, 102, 153]), "there is something to see");

    let Some(display) = VirtualDisplay::open() else { return };
    let report = play(player().env("DISPLAY", &display.1), &shot("window.png"));
    assert_eq!((&report["frames"], &report["window"]), (&3.into(), &true.into()));
    assert!(report["ui_ms"].as_f64().unwrap() > 0.0 && report["present_ms"].as_f64().unwrap() > 0.0);
    assert_eq!(pixels(&shot("window.png")), got);
}

/// A scene that takes most of the memory to draw with stays in host memory: the same picture.
#[test]
fn scenes_larger_than_the_memory_are_played_from_the_host() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("large.instgs");
    let mut scene = chairs();
    let (cloud, mut rng) = (scene.background.clone(), Rng::new(5));
    // 11 MB as f32: a dust of copies around the chairs.
    while scene.background.len() < 200_000 {
        scene.background.push_from(&cloud, 0);
        let last = scene.background.len() - 1;
        scene.background.means[last] = std::array::from_fn(|_| (3.0 * rng.normal()) as f32);
        scene.background.log_scales[last] = [0.01f32.ln(); 3];
    }
    save_scene(&file, &scene).unwrap();
    let shot = |name: &str| folder.path().join(name);
    let play = |name: &str, more: &[&str]| -> Value {
        let mut player = player();
        player.arg(&file).args([
            "--headless",
            "--frames",
            "4",
            "--size",
            "160x90",
            "--device-precision",
            "f32",
            "--json",
            "-",
        ]);
        player.args(more).arg("--screenshot").arg(shot(name));
        serde_json::from_slice(&player.assert().success().get_output().stdout).unwrap()
    };
    let whole = play("whole.png", &[]);
    assert!(whole["scene_on_host_bytes"].is_null());
    let little = play("little.png", &["--device-memory-mb", "13"]);
    assert!(little["scene_on_host_bytes"].as_u64().unwrap() > 10_000_000, "{little}");
    let (want, got) = (pixels(&shot("whole.png")), pixels(&shot("little.png")));
    assert_eq!(want, got);
}

/// Without a display, --frames goes on without a window and says so; alone it is an error that says what to do.
#[test]
fn without_a_display_it_says_what_to_do() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let text = error_of(player().arg(&scene));
    assert!(text.contains("window") && text.contains("--headless"), "{text}");
    let output =
        player().arg(&scene).args(["--frames", "1", "--size", "33x17"]).assert().success().get_output().clone();
    let warning = String::from_utf8(output.stderr).unwrap();
    assert!(warning.starts_with("warning: ") && warning.contains("without a window"), "{warning}");
    assert!(String::from_utf8(output.stdout).unwrap().contains("1 frames of 33x17"));
}

#[test]
fn every_view_can_be_asked_for() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let shot = folder.path().join("shot.png");
    let look = |flags: &[&str]| {
        let mut player = player();
        player.arg(&scene).args(["--headless", "--frames", "1", "--size", "96x54", "--show"]).args(flags);
        player.arg("--screenshot").arg(&shot);
        player
    };
    let mut pictures = Vec::new();
    for flags in [
        &["color"][..],
        &["alpha"],
        &["depth"],
        &["instances"],
        &["templates"],
        &["tile-load"],
        &["tile-load", "--level", "3"],
        &["offsets"],
        &["offsets", "--level", "0.01"],
        &["points"],
        &["ellipses"],
        &["ellipses", "--level", "0.9"],
    ] {
        look(flags).assert().success();
        let picture = pixels(&shot).2;
        assert!(!pictures.contains(&picture), "{flags:?}: as another");
        pictures.push(picture);
    }
    let text = error_of(&mut look(&["depth", "--level", "3"]));
    assert!(text.contains("--level") && text.contains("tile-load"), "{text}");
    look(&["offsets", "--level", "0"]).assert().code(2);
}

#[test]
fn bad_files_and_flags_end_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let bad = folder.path().join("bad.instgs");
    std::fs::write(&bad, "no scene").unwrap();
    let text = error_of(player().arg(&bad).args(["--headless", "--frames", "1"]));
    assert!(text.contains("bad.instgs"), "{text}");
    for usage in [&["--headless"][..], &["--json", "-"], &["--frames", "0"], &["--size", "0x1", "--frames", "1"]] {
        player().arg(&bad).args(usage).assert().code(2);
    }
}

/// Runs a script in a window of 320x240; the picture files and the scene are in `folder`.
pub(crate) fn play_script(display: &VirtualDisplay, scene: &Path, text: &str) -> std::process::Output {
    play_script_on(display, 1, scene, text)
}

/// The same on a screen with so many pixels a point.
fn play_script_on(display: &VirtualDisplay, per_point: u32, scene: &Path, text: &str) -> std::process::Output {
    let script = scene.with_file_name("script.txt");
    std::fs::write(&script, text).unwrap();
    let mut player = player();
    player.env("WINIT_X11_SCALE_FACTOR", per_point.to_string());
    player.env("DISPLAY", &display.1).arg(scene).args(["--size", "320x240", "--script"]).arg(&script);
    player.timeout(std::time::Duration::from_secs(300)).output().unwrap()
}

/// Where one of the chairs is in the window at the start, pixels.
pub(crate) fn chair_px(scene: &instgs_vk::scene::InstancedScene) -> [f64; 2] {
    let camera = Navigator::around(&Orbit::around(scene, None)).camera([320, 240]);
    let centre = template_centres(scene)[scene.instances[0].template as usize];
    let view =
        camera.rotation() * (scene.instances[0].world_from_template.transform_point(centre) - camera.position_world());
    [camera.fx * view.x / view.z + camera.cx, camera.fy * view.y / view.z + camera.cy]
}

/// Open, orbit, choose, move, duplicate, take back, save, reopen: each as events of the window, with validation on.
#[test]
fn a_scene_is_edited_in_a_window() {
    let Some((display, folder, file)) = open_display() else { return };
    let before = chairs();
    let [x, y] = chair_px(&before);
    let text = format!(
        "key KeyH\n shot start.png\n click {x} {y}\n shot chosen.png\n key ArrowRight\n key ArrowRight\n shot moved.png\n \
         key ctrl+KeyD\n shot copied.png\n key ctrl+KeyZ\n shot undone.png\n key ctrl+KeyY\n key Escape\n \
         drag left 10 200 60 190\n shot orbited.png\n key KeyR\n shot edited.png\n key ctrl+KeyS\n quit\n"
    );
    let output = play_script(&display, &file, &text);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let shot = |name: &str| pixels(&folder.path().join(name)).2;
    let steps = ["start", "chosen", "moved", "copied"].map(|name| shot(&format!("{name}.png")));
    assert!(steps.windows(2).all(|two| two[0] != two[1]), "each step shows");
    assert_eq!(shot("undone.png"), steps[2], "taken back");
    assert_ne!(shot("orbited.png"), shot("edited.png"));

    let after = load_scene(&file).unwrap().scene;
    assert_eq!(after.instances.len(), before.instances.len() + 1);
    // The chair in front may be another than the first.
    let moved: Vec<usize> =
        (0..before.instances.len()).filter(|&k| after.instances[k] != before.instances[k]).collect();
    assert_eq!(moved.len(), 1);
    assert_eq!(after.instances.last().unwrap().template, before.instances[moved[0]].template);
    // Opened again, it is what was saved.
    let output = play_script(&display, &file, "frames 2\n shot reopened.png\n quit");
    assert!(output.status.success());
    // The start of the view depends on the scene, which has one chair more.
    let camera = Navigator::around(&Orbit::around(&after, None)).camera([320, 240]);
    assert_eq!((pixels(&folder.path().join("reopened.png")).0, camera.width), (320, 320));
    assert_ne!(shot("reopened.png"), steps[0]);
}

/// The digits show nine pictures, and a click among ellipses chooses what is there.
#[test]
fn digits_choose_views() {
    let Some((display, folder, file)) = open_display() else { return };
    let [x, y] = chair_px(&chairs());
    let views: String = (1..=9).map(|k| format!("key Digit{k}\n shot {k}.png\n")).collect();
    let click = format!("click {x} {y}\n shot among_ellipses.png\n key Digit1\n shot chosen.png\n");
    let output = play_script(&display, &file, &format!("key KeyH\n{views}{click}quit\n"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let shot = |name: &str| pixels(&folder.path().join(format!("{name}.png"))).2;
    let mut views: Vec<Vec<u8>> = (1..=9).map(|k| shot(&k.to_string())).collect();
    assert!(shot("chosen") != views[0] && shot("among_ellipses") != views[8]);
    views.sort();
    views.dedup();
    assert_eq!(views.len(), 9);
}

/// The last arrow that shows at a place: its axis, and where it ends.
pub(crate) fn arrow_tip(centre: DVec3, camera: &Camera) -> (usize, [f64; 2]) {
    let gizmo = Gizmo::new(GizmoMode::Move, centre, camera).unwrap();
    let mut arrows = gizmo.lines().into_iter().filter_map(|line| match line.handle {
        Handle::Arrow(axis) => Some((axis, line.points_px[1])),
        _ => None,
    });
    arrows.next_back().unwrap()
}

/// Places of the second chair in a window of 320x240 at the start, pixels.
struct MiddleChair {
    /// Where a Gaussian of it shows.
    shows: [f64; 2],
    /// Its middle, where handles are.
    centre: [f64; 2],
    /// As [`arrow_tip`].
    arrow: (usize, [f64; 2]),
}

fn middle_chair(scene: &InstancedScene) -> MiddleChair {
    let camera = Navigator::around(&Orbit::around(scene, None)).camera([320, 240]);
    let of_template = |point: DVec3| scene.instances[1].world_from_template.transform_point(point);
    let px = |point: DVec3| camera.pixel_of(of_template(point)).unwrap();
    let centre = template_centres(scene)[0];
    let shows = px(DVec3::from_array(scene.templates.means[2].map(f64::from)));
    MiddleChair { shows, centre: px(centre), arrow: arrow_tip(of_template(centre), &camera) }
}

/// On a screen of half the pixels' size an arrow is twice as many pixels long.
#[test]
fn handles_are_as_large_on_a_fine_screen() {
    let Some((display, _folder, file)) = open_display() else { return };
    let before = chairs();
    let place = before.instances[1].world_from_template;
    let camera = Navigator::around(&Orbit::around(&before, None)).camera([320, 240]);
    let [x, y] =
        camera.pixel_of(place.transform_point(DVec3::from_array(before.templates.means[2].map(f64::from)))).unwrap();
    let centre = place.transform_point(template_centres(&before)[0]);
    let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v / 2.0);
    let (axis, [tip_x, tip_y]) = arrow_tip(centre, &Camera { fx, fy, cx, cy, ..camera.clone() });
    let (from, middle) = ([2.0 * tip_x, 2.0 * tip_y], camera.pixel_of(centre).unwrap());
    let to = [0, 1].map(|k| from[k] + 0.3 * (from[k] - middle[k]));
    let text = format!(
        "key KeyH\n click {x} {y}\n frames 1\n drag left {} {} {} {}\n frames 1\n key ctrl+KeyS\n quit\n",
        from[0], from[1], to[0], to[1]
    );
    let output = play_script_on(&display, 2, &file, &text);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let translation = |scene: &InstancedScene| scene.instances[1].world_from_template.translation();
    let by = translation(&load_scene(&file).unwrap().scene) - translation(&before);
    assert!(by[axis].abs() > 0.05 && (by - by[axis] * DVec3::AXES[axis]).length() < 1e-6, "{by}");
}

/// Closing the window or opening another file asks once before changes are lost, and Ctrl+S of a plain cloud does not write
/// over a scene of the same name.
#[test]
fn unsaved_work_is_asked_for() {
    let Some((display, folder, file)) = open_display() else { return };
    let [x, y] = chair_px(&chairs());
    let cloud = folder.path().join("scene.ply");
    program().args(["export", "--scene"]).arg(&file).arg("--to").arg(&cloud).assert().success();
    std::fs::copy(&cloud, folder.path().join("other.ply")).unwrap();
    // Two files at once are two questions, not one and its answer.
    let text = format!(
        "key KeyH\n click {x} {y}\n key Delete\n close\n drop scene.ply\n drop other.ply\n frames 1\n key ctrl+KeyS\n \
         drop scene.ply\n frames 1\n key ctrl+KeyS\n frames 1\n close\n"
    );
    let output = play_script(&display, &file, &text);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(
        load_scene(&file).unwrap().scene.instances.len(),
        chairs().instances.len() - 1,
        "still there to be saved"
    );
    let saved = load_scene(&folder.path().join("scene.000.instgs")).unwrap().scene;
    assert!(saved.instances.is_empty() && !saved.background.is_empty(), "the cloud, beside it");
}

/// A camera file that is not ours stays as it is when a camera is kept.
#[test]
fn unreadable_cameras_are_not_written_over() {
    let Some((display, _folder, file)) = open_display() else { return };
    let cameras = file.with_extension("cameras.json");
    std::fs::write(&cameras, b"no cameras").unwrap();
    let output = play_script(&display, &file, "frames 1\n key KeyC\n frames 1\n quit\n");
    let words = String::from_utf8_lossy(&output.stderr);
    assert!(output.status.success() && std::fs::read(&cameras).unwrap() == b"no cameras", "{words}");
}

/// Ctrl+S while there is no scene leaves the file that could not be opened as it is.
#[test]
fn what_cannot_be_opened_is_not_written_over() {
    let Some((display, _folder, file)) = open_display() else { return };
    std::fs::write(&file, b"no scene").unwrap();
    let output = play_script(&display, &file, "frames 1\n key ctrl+KeyS\n frames 1\n quit\n");
    let words = String::from_utf8_lossy(&output.stderr);
    assert_eq!(std::fs::read(&file).unwrap(), b"no scene", "{words}");
}

/// What is not saved when the device is lost for good is written beside the scene, and only then.
#[test]
fn unsaved_work_outlives_the_device() {
    let Some((display, folder, file)) = open_display() else { return };
    let [x, y] = chair_px(&chairs());
    let text = format!("key KeyH\n click {x} {y}\n key Delete\n lose\n frames 1\n lose\n");
    let output = play_script(&display, &file, &text);
    let words = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && words.contains("scene.000.recovered.instgs"), "{words}");
    let saved = load_scene(&folder.path().join("scene.000.recovered.instgs")).unwrap().scene;
    assert_eq!(saved.instances.len(), chairs().instances.len() - 1);
    assert_eq!(load_scene(&file).unwrap().scene.instances.len(), chairs().instances.len());
}

/// An arrow is dragged: the chair goes along it and nowhere else, as one change. Escape puts it back.
#[test]
fn a_chair_is_dragged_by_its_handle() {
    let Some((display, folder, file)) = open_display() else { return };
    let before = chairs();
    let MiddleChair { shows: [x, y], centre: [mid_x, mid_y], arrow: (axis, [tip_x, tip_y]) } = middle_chair(&before);
    let [to_x, to_y] = [tip_x + 0.3 * (tip_x - mid_x), tip_y + 0.3 * (tip_y - mid_y)];
    let text = format!(
        "key KeyH\n click {x} {y}\n shot chosen.png\n drag left {tip_x} {tip_y} {to_x} {to_y}\n frames 1\n shot dragged.png\n \
         key ctrl+KeyS\n key ctrl+KeyZ\n shot undone.png\n pointer {tip_x} {tip_y}\n press left\n pointer {to_x} {to_y}\n \
         frames 1\n shot held.png\n key Escape\n shot back.png\n release left\n frames 1\n quit\n"
    );
    let output = play_script(&display, &file, &text);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let shot = |name: &str| pixels(&folder.path().join(name)).2;
    assert_ne!(shot("chosen.png"), shot("dragged.png"));
    assert_eq!(shot("undone.png"), shot("chosen.png"), "one step");
    assert_eq!(shot("held.png"), shot("dragged.png"), "seen while it is held");
    assert_eq!(shot("back.png"), shot("chosen.png"), "put back");
    let after = load_scene(&file).unwrap().scene;
    let by = |k: usize| {
        let translation = |scene: &InstancedScene| scene.instances[k].world_from_template.translation();
        translation(&after) - translation(&before)
    };
    assert!(by(1)[axis] > 0.05 && (by(1) - by(1)[axis] * DVec3::AXES[axis]).length() < 1e-6, "{}", by(1));
    assert!(by(0) == DVec3::ZERO && by(2) == DVec3::ZERO);
}

/// A picture of a drag takes two submissions, one that draws and one that fills the window. Before each, the host waits for
/// those of two pictures ago at most, so that the device is never without work.
#[test]
fn a_drag_keeps_the_device_busy() {
    let Some((display, folder, file)) = open_display() else { return };
    let MiddleChair { shows: [x, y], centre, arrow: (_, tip) } = middle_chair(&chairs());
    let moves = |range: std::ops::Range<u32>| -> String {
        let at = |k: u32| [0, 1].map(|axis| tip[axis] + 0.02 * f64::from(k) * (tip[axis] - centre[axis]));
        range.map(at).map(|[x, y]| format!("pointer {x} {y}\n")).collect()
    };
    let text = format!(
        "key KeyH\n click {x} {y}\n frames 2\n pointer {} {}\n press left\n {} counts before.json\n {} counts after.json\n \
         release left\n key ctrl+KeyS\n quit\n",
        tip[0],
        tip[1],
        moves(8..12),
        moves(12..23)
    );
    let output = play_script(&display, &file, &text);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(load_scene(&file).unwrap().scene != chairs(), "something was dragged");
    let counts =
        |name: &str| -> Value { serde_json::from_slice(&std::fs::read(folder.path().join(name)).unwrap()).unwrap() };
    let (before, after) = (counts("before.json"), counts("after.json"));
    let [submissions, waits, drains] =
        ["submissions", "waits", "drains"].map(|what| after[what].as_u64().unwrap() - before[what].as_u64().unwrap());
    // That of the first step is the twelfth.
    let pictures = 12;
    assert!(
        submissions == 2 * pictures && waits <= 2 * pictures && drains == 0,
        "{submissions} submissions, {waits} waits, {drains} of them for all of it, in {pictures} pictures"
    );
}

/// A handle that is pressed without a drag moves nothing, and a double click on the one in the middle of what is chosen is
/// one: the view turns about what is there.
#[test]
fn handles_that_are_clicked_move_nothing() {
    let Some((display, folder, file)) = open_display() else { return };
    let before = chairs();
    let MiddleChair { shows: [x, y], centre: [mid_x, mid_y], arrow: (_, [tip_x, tip_y]) } = middle_chair(&before);
    let text = format!(
        "key KeyH\n click {x} {y}\n pointer {tip_x} {tip_y}\n press left\n frames 1\n pointer {} {}\n frames 1\n release left\n \
         key ctrl+KeyS\n frames 40\n shot before.png\n double {mid_x} {mid_y}\n frames 2\n shot turned.png\n \
         key ctrl+KeyS\n quit\n",
        tip_x + 2.0,
        tip_y + 1.0
    );
    let output = play_script(&display, &file, &text);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert!(load_scene(&file).unwrap().scene.instances == before.instances);
    let shot = |name: &str| pixels(&folder.path().join(name)).2;
    assert_ne!(shot("before.png"), shot("turned.png"));
}

/// Windows that change their size all the time neither leak nor offend the validation layers; 10,000 pictures with 100 sizes
/// are in `a_long_session`.
#[test]
fn sizes_change_all_the_time() {
    long_session(20, 5);
}

#[test]
#[ignore = "10,000 pictures take minutes"]
fn a_long_session() {
    long_session(100, 100);
}

fn long_session(sizes: usize, pictures: usize) {
    let Some((display, folder, file)) = open_display() else { return };
    let mut text = String::from("hold KeyA 20\n");
    for k in 0..sizes {
        let size = [[96, 64], [33, 70], [160, 90], [1, 1]][k % 4];
        text += &format!("size {} {}\n hold KeyA {pictures}\n", size[0], size[1]);
    }
    text += "size 64 48\n frames 3\n shot last.png\n quit\n";
    let output = play_script(&display, &file, &text);
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    assert_eq!(pixels(&folder.path().join("last.png")).0, 64);
}

/// After the loss of the device the scene, what was changed and what can be taken back are still there; a second loss at once
/// is the end, in words.
#[test]
fn a_lost_device_is_opened_anew() {
    let Some((display, folder, file)) = open_display() else { return };
    let [x, y] = chair_px(&chairs());
    let text = format!(
        "key KeyH\n click {x} {y}\n shot first.png\n key ArrowRight\n shot before.png\n lose\n frames 2\n shot after.png\n \
         key ctrl+KeyZ\n shot undone.png\n key ctrl+KeyS\n"
    );
    let output = play_script(&display, &file, &(text.clone() + "quit"));
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let shot = |name: &str| pixels(&folder.path().join(name)).2;
    assert_ne!(shot("first.png"), shot("before.png"));
    assert_eq!(shot("before.png"), shot("after.png"));
    assert_eq!(shot("undone.png"), shot("first.png"));
    let output = play_script(&display, &file, &(text + "lose\n quit"));
    let words = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success() && words.contains("the device was lost"), "{words}");
}

/// A recorded path is a camera file that `render` takes.
#[test]
fn a_recorded_path_can_be_rendered() {
    let Some((display, folder, file)) = open_display() else { return };
    let output = play_script(&display, &file, "frames 1\n key KeyP\n hold KeyA 12\n key KeyP\n quit");
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    let path = folder.path().join("scene.000.path.json");
    let cameras = read_cameras(&path).unwrap();
    assert!(cameras.len() > 1 && cameras[0].view_from_world != cameras.last().unwrap().view_from_world);
    let out = folder.path().join("frames");
    let mut render = program();
    render.arg("render").arg("--scene").arg(&file).arg("--camera").arg(&path).arg("--out").arg(&out).assert().success();
    assert_eq!(std::fs::read_dir(&out).unwrap().count(), cameras.len());
}

#[test]
fn scripts_are_checked_before_a_window_opens() {
    let folder = tempfile::tempdir().unwrap();
    let file = scene(folder.path());
    let script = folder.path().join("bad.txt");
    std::fs::write(&script, "frames 1\njump 2\n").unwrap();
    let text = error_of(player().arg(&file).arg("--script").arg(&script));
    assert!(text.contains("bad.txt") && text.contains("line 2") && text.contains("jump 2"), "{text}");
}
