//! Levels of detail as a user asks for them: `bench --lod`, `render --lod`, and flights of `synth`.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use instgs_io::save_scene;
use serde_json::Value;

use crate::common::program::{program, skips_gpu};
use crate::common::scale;

/// The program under the validation layers.
fn watched(args: &[&str], scene: &Path) -> Command {
    let mut command = program();
    command.env("INSTGS_VALIDATION", "1").args(args).arg("--scene").arg(scene);
    command
}

fn json_of(command: &mut Command) -> Value {
    serde_json::from_slice(&command.assert().success().get_output().stdout).unwrap()
}

/// Thirty balls of 400 Gaussians.
fn balls(folder: &Path) -> std::path::PathBuf {
    let mut scene = scale::field(400);
    scene.instances.truncate(30);
    let path = folder.join("balls.instgs");
    save_scene(&path, &scene).unwrap();
    path
}

#[test]
fn bench_says_what_levels_cost_and_save() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = balls(folder.path());
    let orbit = ["bench", "--orbit", "2", "--size", "64x48", "--frames", "4", "--lod", "1,8"];
    let report = json_of(watched(&orbit, &scene).arg("--json"));
    let rows = report["rows"].as_array().unwrap();
    assert_eq!(rows.iter().map(|row| row["lod_px"].as_f64().unwrap()).collect::<Vec<_>>(), [0.0, 1.0, 8.0]);
    let number = |row: usize, field: &str| rows[row][field].as_f64().unwrap();
    assert!(rows[0]["psnr_to_full"].is_null() && rows[1]["psnr"].is_null() && rows[1]["psnr_loss"].is_null());
    assert!(number(2, "psnr_to_full") < number(1, "psnr_to_full") && number(2, "psnr_to_full") > 10.0);
    assert!(number(2, "visible") < number(1, "visible") && number(1, "visible") <= number(0, "visible"));
    assert!((number(2, "fps_ratio") - number(2, "fps") / number(0, "fps")).abs() < 1e-9);
    assert_eq!(rows[2]["cameras"].as_array().unwrap().len(), 2);
    let text = watched(&orbit, &scene).assert().success().get_output().stdout.clone();
    let text = String::from_utf8(text).unwrap();
    assert!(text.contains("PSNR to full") && text.contains("8 px") && text.contains("by full"), "{text}");
}

/// A flight's photos are compared with, and its cameras come nearer.
#[test]
fn flights_have_photos_to_lose_against() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let flight = folder.path().join("flight");
    let size = ["--views", "3", "--size", "32x18", "--instances", "4", "--flight", "40:10"];
    program().args(["synth", "orchard", "--out"]).arg(&flight).args(size).assert().success();
    let mut command = watched(&["bench", "--split", "all", "--frames", "3", "--lod", "4"], &balls(folder.path()));
    let report = json_of(command.arg("--data").arg(&flight).arg("--json"));
    let row = &report["rows"][1];
    let [full, own] = [&report["rows"][0], row].map(|row| row["psnr"].as_f64().unwrap());
    assert!((row["psnr_loss"].as_f64().unwrap() - (full - own)).abs() < 1e-9);
    let distance = |k: usize| {
        let views = instgs_io::read_views(&flight).unwrap().views;
        views[k].camera.position_world().length()
    };
    assert!(distance(0) > 1.9 * distance(1) && distance(1) > 1.8 * distance(2));
}

#[test]
fn rendering_with_levels_is_asked_for() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = balls(folder.path());
    let picture = |name: &str, more: &[&str]| {
        let out = folder.path().join(name);
        let mut command = watched(&["render", "--orbit", "1", "--size", "48x32"], &scene);
        command.args(more).arg("--out").arg(&out).assert().success();
        fs::read(out.join("000.png")).unwrap()
    };
    let full = picture("full", &[]);
    assert!(picture("again", &[]) == full && picture("lod", &["--lod", "6"]) != full);
}

#[test]
fn errors_that_make_no_sense_are_wrong_usage() {
    let orbit = ["bench", "--scene", "x.ply", "--orbit", "1", "--lod"];
    for wrong in [&["0"][..], &["-1"], &["2,x"], &["nan"], &["2", "--against", "y.ply"]] {
        program().args(orbit).args(wrong).assert().code(2);
    }
    for wrong in ["60", "0:5", "60:x"] {
        program().args(["synth", "orchard", "--out", "x", "--flight", wrong]).assert().code(2);
    }
}

/// Optimised levels are nearer to the full picture, are kept once, and say what they are of.
#[test]
fn levels_are_optimised_and_stored() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = |name: &str| folder.path().join(name);
    let scene = balls(folder.path());
    let levels = |scene: &Path, out: &Path, more: &[&str]| {
        let mut command = program();
        command.env("INSTGS_VALIDATION", "1").arg("levels").arg(scene).arg("--out").arg(out);
        command.args(["--steps", "60", "--views", "12", "--json"]).args(more);
        command
    };
    let first = json_of(&mut levels(&scene, &at("a.instgs"), &[]));
    let rows = first["templates"][0]["levels"].as_array().unwrap();
    assert!(rows.len() > 3 && first["templates"][0]["gaussians"] == 400);
    let db = |row: &Value, field: &str| row[field].as_f64().unwrap();
    let gains: Vec<f64> = rows.iter().map(|row| db(row, "fitted_psnr_db") - db(row, "merged_psnr_db")).collect();
    assert!(gains.iter().all(|&gain| gain > 1.0) && rows.iter().all(|row| row["is_kept"] == true), "{gains:?}");
    // The same command, the same bytes; levels that are there are not made again.
    levels(&scene, &at("b.instgs"), &[]).assert().success();
    assert!(fs::read(at("a.instgs")).unwrap() == fs::read(at("b.instgs")).unwrap());
    let second = json_of(&mut levels(&at("a.instgs"), &at("c.instgs"), &[]));
    assert!(
        second["templates"][0]["skipped"] == true && second["templates"][0]["levels"].as_array().unwrap().is_empty()
    );
    assert!(fs::read(at("a.instgs")).unwrap() == fs::read(at("c.instgs")).unwrap());
    let again = json_of(&mut levels(&at("a.instgs"), &at("d.instgs"), &["--again", "--seed", "1"]));
    assert!(again["templates"][0]["skipped"] == false);
    assert!(fs::read(at("a.instgs")).unwrap() != fs::read(at("d.instgs")).unwrap());
    // What they are for.
    let to_full = |scene: &Path| {
        let bench = ["bench", "--orbit", "3", "--size", "64x48", "--frames", "3", "--lod", "2", "--json"];
        json_of(&mut watched(&bench, scene))["rows"][1]["psnr_to_full"].as_f64().unwrap()
    };
    let [merged, fitted] = [to_full(&scene), to_full(&at("a.instgs"))];
    assert!(fitted > merged + 1.0, "{fitted} {merged}");
    program().arg("levels").arg(&scene).args(["--out", "x.ply"]).assert().code(1);
    let cloud = at("cloud.ply");
    program().args(["export", "--scene"]).arg(&scene).arg("--to").arg(&cloud).assert().success();
    let refused = program().arg("levels").arg(&cloud).arg("--out").arg(at("x.instgs")).assert().code(1);
    let text = String::from_utf8(refused.get_output().stderr.clone()).unwrap();
    assert!(text.contains("has no instances") && text.trim_end().lines().count() == 1, "{text}");
}
