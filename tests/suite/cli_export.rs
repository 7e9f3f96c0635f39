//! `export` and `prune` as a user runs them: the files that they write.

use std::fs;
use std::path::PathBuf;

use glam::DVec3;
use instgs_io::{load_scene, write_cameras};
use instgs_vk::scene::{Camera, InstancedScene};
use serde_json::Value;

use super::cli::{folder, instanced_scene, json_of, stdout_of};
use crate::common::dataset::transforms;
use crate::common::program::{error_of, program, skips_gpu};

#[test]
fn export_flattens_and_reads_back() {
    let (_folder, at) = folder();
    let scene = instanced_scene();
    let export = |to: &str| {
        let mut command = program();
        command.args(["export", "--scene"]).arg(at("scene.instgs")).arg("--to").arg(at(to));
        command
    };
    let text = stdout_of(&mut export("x.ply"));
    assert!(text.contains("15 Gaussians, 4 instances expanded"), "{text}");
    assert_eq!(load_scene(&at("x.ply")).unwrap().scene.background, scene.flatten());
    assert_eq!(fs::read(at("x.ply")).unwrap(), fs::read(at("flat.ply")).unwrap());
    let report = json_of(export("x.spz").arg("--json"));
    assert_eq!((&report["gaussians"], &report["flattened_instances"]), (&Value::from(15), &Value::from(4)));
    assert_eq!(load_scene(&at("x.spz")).unwrap().scene.background.len(), 15);
    stdout_of(&mut export("again.instgs"));
    assert_eq!(fs::read(at("again.instgs")).unwrap(), fs::read(at("scene.instgs")).unwrap());
    assert!(error_of(&mut export("x.obj")).contains("unknown format"));
    assert!(!at("x.glb").exists());
}

#[test]
fn packed_exports_are_smaller_and_load() {
    let (_folder, at) = folder();
    let scene = instanced_scene();
    let export = |to: &str, pack: &str| {
        let mut command = program();
        command.args(["export", "--scene"]).arg(at("scene.instgs")).arg("--to").arg(at(to)).args(["--pack", pack]);
        command
    };
    let mut bytes = vec![fs::metadata(at("scene.instgs")).unwrap().len()];
    for pack in ["f16", "q8"] {
        let name = format!("{pack}.instgs");
        let report = json_of(export(&name, pack).arg("--json"));
        bytes.push(report["bytes"].as_u64().unwrap());
        let back = load_scene(&at(&name)).unwrap().scene;
        assert_eq!((&back.instances, &back.templates.means), (&scene.instances, &scene.templates.means));
        let near = |a: &[f32], b: &[f32]| a.iter().zip(b).all(|(x, y)| (x - y).abs() <= x.abs() / 2048.0);
        assert!(near(scene.templates.sh.as_flattened(), back.templates.sh.as_flattened()));
        // Every instance has the same offset for all of its Gaussians, which 8 bits keep to the bit.
        assert!(near(scene.offsets.means.as_flattened(), back.offsets.means.as_flattened()));
        assert_eq!(back.offsets == scene.offsets, pack == "q8");
        let inspected = json_of(program().args(["inspect", "--json"]).arg(at(&name)));
        let sums = inspected["file_sums"].as_object().unwrap().values().map(|v| v.as_u64().unwrap()).sum::<u64>();
        assert_eq!(Some(&sums), bytes.last());
    }
    assert!(bytes[1] < bytes[0], "{bytes:?}");
    let report = json_of(export("small.instgs", "small").arg("--json"));
    let back = load_scene(&at("small.instgs")).unwrap().scene;
    assert_eq!((&back.instances, back.offsets.len()), (&scene.instances, scene.offsets.len()));
    assert_eq!(back.templates.len(), scene.templates.len());
    let pairs = scene.offsets.sh_dc.as_flattened().iter().zip(back.offsets.sh_dc.as_flattened());
    assert!(back.templates != scene.templates && pairs.into_iter().all(|(a, b)| (a - b).abs() < 0.021));
    let inspected = json_of(program().args(["inspect", "--json"]).arg(at("small.instgs")));
    let sums = inspected["file_sums"].as_object().unwrap();
    assert_eq!(sums.values().map(|v| v.as_u64().unwrap()).sum::<u64>(), report["bytes"].as_u64().unwrap());
    assert_eq!(sums["foreign"], 0);
    // As precisely as the views of a data set need: fewer bytes for a lower demand.
    fs::create_dir(at("data")).unwrap();
    let eye = DVec3::new(0.2, -0.3, -6.0);
    let camera = Camera::look_at("000", eye, DVec3::ZERO, DVec3::NEG_Y, 1.0, (48, 32));
    let cameras: Vec<Camera> = (0..3).map(|k| Camera { name: format!("{k:03}"), ..camera.clone() }).collect();
    fs::write(at("data/transforms.json"), transforms(&cameras).to_string()).unwrap();
    if !skips_gpu() {
        let needed = |psnr: &str| {
            let mut command = export("needed.instgs", "small");
            let report = json_of(command.arg("--json").arg("--data").arg(at("data")).args(["--picture-psnr", psnr]));
            load_scene(&at("needed.instgs")).unwrap();
            report["bytes"].as_u64().unwrap()
        };
        let bytes = ["30", "60"].map(needed);
        assert!(bytes[0] < bytes[1], "{bytes:?}");
        finishes(&cameras, &at);
        prunes(&scene, &at);
    }
    let text = error_of(&mut export("x.ply", "f16"));
    assert!(text.contains("--pack is for .instgs"), "{text}");
    assert!(!at("x.ply").exists());
}

/// `export --finish` of the scene `scene.instgs`, for photos of itself.
fn finishes(cameras: &[Camera], at: &impl Fn(&str) -> PathBuf) {
    let finish = |to: &str, more: &[&str]| {
        let mut command = program();
        command.args(["export", "--scene"]).arg(at("scene.instgs")).arg("--to").arg(at(to));
        command.arg("--data").arg(at("data")).args(["--finish", "2"]).args(more);
        command
    };
    let missing = finish("finished.instgs", &["--pack", "small"]).assert().failure().get_output().stderr.clone();
    let missing = String::from_utf8_lossy(&missing).into_owned();
    assert!(missing.contains("lies in no run's folder") && missing.contains("000.png"), "{missing}");
    // The folder of a run, as far as this command sees.
    fs::write(at("config.toml"), "").unwrap();
    write_cameras(&at("views.json"), cameras).unwrap();
    let mut render = program();
    render.args(["render", "--scene"]).arg(at("scene.instgs")).arg("--camera").arg(at("views.json"));
    render.arg("--out").arg(at("data/images")).assert().success();
    finish("finished.instgs", &["--pack", "small"]).assert().success();
    let (before, after) = (load_scene(&at("needed.instgs")).unwrap(), load_scene(&at("finished.instgs")).unwrap());
    assert_eq!(before.scene.parameter_rows(), after.scene.parameter_rows());
    finish("finished.html", &[]).assert().success();
    let text = error_of(&mut finish("x.instgs", &["--pack", "f16", "--pages"]));
    assert!(text.contains("--finish is for --pack small") && !at("x.instgs").exists(), "{text}");
    let output = finish("x.instgs", &["--pack", "f16"]).output().unwrap();
    assert!(output.status.success() && String::from_utf8_lossy(&output.stderr).contains("--finish"));
}

/// `prune` of the scene `scene.instgs`, from the views of `data`.
fn prunes(scene: &InstancedScene, at: &impl Fn(&str) -> PathBuf) {
    let prune = |out: &str, goal: [&str; 2]| {
        let mut command = program();
        command.args(["prune", "--json", "--scene"]).arg(at("scene.instgs")).arg("--data").arg(at("data"));
        command.arg("--out").arg(at(out)).args(goal);
        command
    };
    let report = json_of(&mut prune("half.instgs", ["--keep", "0.5"]));
    let half = load_scene(&at("half.instgs")).unwrap().scene;
    let of_report = |name: &str| report[name].as_u64().unwrap();
    assert_eq!(of_report("drawn_before"), scene.expanded_len());
    assert_eq!(
        (of_report("gaussians"), of_report("drawn") + of_report("hidden")),
        (half.source_len() as u64, half.expanded_len())
    );
    // What instances hide is in no other file.
    let mut export = program();
    export.args(["export", "--scene"]).arg(at("half.instgs")).arg("--to").arg(at("half_flat.ply")).assert().success();
    assert_eq!(load_scene(&at("half_flat.ply")).unwrap().scene.background.len() as u64, of_report("drawn"));
    assert!(
        of_report("hidden") > 0
            && of_report("drawn") < scene.expanded_len()
            && half.instances.len() == scene.instances.len()
    );
    let all = json_of(&mut prune("all.instgs", ["--keep", "1"]));
    assert!(all["picture_psnr"].as_f64() > report["picture_psnr"].as_f64(), "{all} {report}");
    assert_eq!(fs::read(at("all.instgs")).unwrap(), fs::read(at("scene.instgs")).unwrap());
    let text = error_of(&mut prune("half.ply", ["--keep", "0.5"]));
    assert!(text.contains("is written as .instgs"), "{text}");
    prune("half.instgs", ["--keep", "0"]).assert().code(2);
}
