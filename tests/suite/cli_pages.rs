//! Scenes in pages as a user has them: `export --pages`, and `render` with little memory.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use instgs_io::nerf_write::write_transforms;
use instgs_io::{load_scene, save_scene, write_cameras};
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::{Camera, Gaussians, InstancedScene};
use serde_json::Value;

use crate::common::program::{program, skips_gpu};
use crate::common::scale;

/// Balls above a wide ground of 40,000 Gaussians.
fn scene() -> InstancedScene {
    let mut rng = Rng::new(3);
    let mut scene = scale::field(100);
    scene.instances.truncate(4);
    let mut ground = Gaussians::with_capacity(1, 40_000);
    for _ in 0..40_000 {
        ground.means.push([rng.range(-20.0, 20.0) as f32, rng.range(-20.0, 20.0) as f32, -1.0]);
        ground.quats.push([1.0, 0.0, 0.0, 0.0]);
        ground.log_scales.push([-2.2, -2.2, -5.0]);
        ground.opacity_logits.push(rng.range(-1.0, 2.0) as f32);
        (0..4).for_each(|_| ground.sh.push([0; 3].map(|_| rng.range(-0.3, 0.6) as f32)));
    }
    scene.background = ground;
    scene
}

fn exported(folder: &Path, more: &[&str]) -> std::path::PathBuf {
    let (from, to) = (folder.join("whole.instgs"), folder.join("pages.instgs"));
    save_scene(&from, &scene()).unwrap();
    program().arg("export").arg("--scene").arg(&from).arg("--to").arg(&to).args(more).assert().success();
    to
}

/// Three views from above the ground. (`--orbit` goes round the means, and stand-ins have others.)
fn cameras() -> [Camera; 3] {
    [0, 1, 2].map(|k| {
        let (sin, cos) = (2.0 * f64::from(k)).sin_cos();
        let view_from_world =
            [[cos, -sin, 0.0, 0.0], [0.0, 0.0, -1.0, 0.5], [sin, cos, 0.0, 6.0], [0.0, 0.0, 0.0, 1.0]];
        let name = format!("{k}.png");
        Camera { name, width: 96, height: 54, fx: 80.0, fy: 80.0, cx: 48.0, cy: 27.0, view_from_world }
    })
}

/// Renders the three views into a folder.
fn render(scene: &Path, out: &Path, more: &[&str]) -> Command {
    let file = scene.with_file_name("cameras.json");
    write_cameras(&file, &cameras()).unwrap();
    let mut command = program();
    command.env("INSTGS_VALIDATION", "1").args(["render", "--json", "--scene"]).arg(scene);
    command.arg("--camera").arg(&file).arg("--out").arg(out).args(more);
    command
}

fn report(command: &mut Command) -> (Value, String) {
    let output = command.assert().success().get_output().clone();
    (serde_json::from_slice(&output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap())
}

fn total(report: &Value, field: &str) -> u64 {
    report["frames"].as_array().unwrap().iter().map(|frame| frame[field].as_u64().unwrap()).sum()
}

#[test]
fn pages_are_read_where_memory_is_short_and_pictures_stay() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let scene = exported(folder.path(), &["--pages", "--pack", "f16"]);
    // Any reader has all of the scene.
    assert_eq!(load_scene(&scene).unwrap().scene.background.len(), 40_000);
    let (whole, warnings) = report(&mut render(&scene, &at("whole"), &[]));
    assert_eq!((total(&whole, "pages_read"), warnings.as_str()), (0, ""));
    let (in_pages, warnings) = report(&mut render(&scene, &at("pages"), &["--host-memory-mb", "1"]));
    assert!(total(&in_pages, "pages_read") > 3, "{in_pages}");
    assert_eq!((total(&in_pages, "pages_without_room"), warnings.as_str()), (0, ""));
    for frame in whole["frames"].as_array().unwrap() {
        let name = frame["files"][0].as_str().unwrap();
        assert!(fs::read(at("whole").join(name)).unwrap() == fs::read(at("pages").join(name)).unwrap(), "{name}");
    }
    let little = ["--host-memory-mb", "1", "--device-memory-mb", "6"];
    let (coarser, warnings) = report(&mut render(&scene, &at("little"), &little));
    assert!(total(&coarser, "pages_without_room") > 0, "{coarser}");
    assert!(warnings.contains("coarser in places"), "{warnings}");
    // Memory of the device alone loses nothing.
    let (host, _) = report(&mut render(&scene, &at("host"), &little[2..]));
    assert_eq!(total(&host, "pages_read"), 0);
    let none = ["--host-memory-mb", "1", "--device-memory-mb", "1"];
    let output = render(&scene, &at("none"), &none).assert().failure().get_output().clone();
    let error = String::from_utf8(output.stderr).unwrap();
    assert!(error.contains("two pages") && error.contains("--device-memory-mb"), "{error}");
    let output = program().args(["inspect", "--json"]).arg(&scene).assert().success().get_output().stdout.clone();
    let inspected: Value = serde_json::from_slice(&output).unwrap();
    assert!(inspected["file_sums"]["pages"].as_u64().unwrap() > 100_000, "{}", inspected["bytes"]);
}

#[test]
fn a_scene_in_pages_is_evaluated() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = exported(folder.path(), &["--pages", "--pack", "f16"]);
    let data = folder.path().join("data");
    render(&scene, &data, &[]).assert().success();
    let cameras = cameras();
    let views: Vec<_> = cameras.iter().map(|camera| (camera, camera.name.clone())).collect();
    write_transforms(&data.join("transforms.json"), &views, None).unwrap();
    let eval = |more: &[&str]| {
        let mut command = program();
        command.env("INSTGS_VALIDATION", "1").args(["eval", "--json", "--split", "all", "--scene"]).arg(&scene);
        report(command.arg("--data").arg(&data).args(more))
    };
    let psnr = |report: &Value| report["mean"]["psnr"].as_f64().unwrap();
    let (whole, _) = eval(&[]);
    assert!(psnr(&whole) > 50.0, "{whole}");
    let (in_pages, warnings) = eval(&["--host-memory-mb", "1"]);
    assert_eq!(in_pages, whole);
    assert!(!warnings.contains("coarser"), "{warnings}");
    let (coarser, warnings) = eval(&["--host-memory-mb", "1", "--device-memory-mb", "9"]);
    assert!((15.0..psnr(&whole) - 3.0).contains(&psnr(&coarser)), "{coarser}");
    assert_eq!((coarser["coarser_views"].as_u64(), whole.get("coarser_views")), (Some(3), None));
    assert!(warnings.contains("3 of 3 views") && !warnings.contains("--lod"), "{warnings}");
}

#[test]
fn frames_of_a_scene_in_pages_are_timed() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = exported(folder.path(), &["--pages", "--pack", "f16"]);
    let file = folder.path().join("cameras.json");
    write_cameras(&file, &cameras()).unwrap();
    let bench = |more: &[&str]| {
        let mut command = program();
        command.env("INSTGS_VALIDATION", "1").args(["bench", "--json", "--scene"]).arg(&scene);
        command.arg("--camera").arg(&file).args(more);
        if !more.contains(&"--frames") {
            command.args(["--frames", "4"]);
        }
        command
    };
    let (whole, _) = report(&mut bench(&[]));
    let (in_pages, warnings) = report(&mut bench(&["--host-memory-mb", "1"]));
    assert!(!warnings.contains("coarser"), "{warnings}");
    assert_eq!(in_pages["gaussians"], whole["gaussians"]);
    for (camera, as_whole) in (0..3).map(|k| (&in_pages["cameras"][k], &whole["cameras"][k])) {
        assert!(camera["visible"].as_u64() > Some(1_000), "{camera}");
        assert_eq!(camera["visible"], as_whole["visible"]);
    }
    // Less of it is in memory, and no view saw it coarser.
    let bytes = |report: &Value, of: &str| report["bytes"][of].as_u64().unwrap();
    assert!(bytes(&in_pages, "host") < bytes(&whole, "host") / 3, "{in_pages}");
    assert!(bytes(&in_pages, "device_peak") > bytes(&in_pages, "device_scene"), "{in_pages}");
    assert_eq!((in_pages.get("coarser_views"), whole.get("coarser_views")), (None, None));
    // Each camera is drawn several times, and counted once.
    let (coarser, warnings) = report(&mut bench(&["--host-memory-mb", "1", "--device-memory-mb", "6"]));
    assert_eq!(coarser["coarser_views"].as_u64(), Some(3), "{coarser}");
    assert!(warnings.contains("3 of 3 views"), "{warnings}");
    let little = ["--frames", "2", "--host-memory-mb", "1", "--device-memory-mb", "6"];
    let (of_two, warnings) = report(&mut bench(&little));
    assert_eq!(of_two["coarser_views"].as_u64(), Some(2), "{of_two}");
    assert!(warnings.contains("2 of 2 views") && warnings.contains("too few for 3 cameras"), "{warnings}");
    // Scenes that are compared are read as a whole.
    let (both, _) = report(&mut bench(&["--against", scene.to_str().unwrap()]));
    assert_eq!(bytes(&both, "host"), bytes(&whole, "host"));
    for flag in [&["--lod", "1"][..], &["--against", scene.to_str().unwrap()]] {
        let output = bench(&[flag, &["--host-memory-mb", "1"]].concat()).assert().code(2).get_output().clone();
        let error = String::from_utf8(output.stderr).unwrap();
        assert!(error.contains("cannot be used with"), "{error}");
    }
}

#[test]
fn what_has_no_pages_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let scene = exported(folder.path(), &[]);
    for (name, more, words) in [
        ("a.ply", &["--pages"][..], "--pages is for .instgs files"),
        ("a.instgs", &["--pages", "--pack", "small"], "use --pack f16"),
    ] {
        let mut command = program();
        command.arg("export").arg("--scene").arg(&scene).arg("--to").arg(folder.path().join(name)).args(more);
        let error = String::from_utf8(command.assert().failure().get_output().stderr.clone()).unwrap();
        assert!(error.contains(words), "{error}");
    }
    if skips_gpu() {
        return;
    }
    let (_, warnings) = report(&mut render(&scene, &folder.path().join("out"), &["--host-memory-mb", "1"]));
    assert!(warnings.contains("export --pages"), "{warnings}");
}
