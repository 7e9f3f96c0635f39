//! A device that is lost, memory that runs out, a small heap, planted by `INSTGS_FAULTS`: at every point of a short render and of a
//! short training the program ends with one line, or recovers; the training then goes on to the same bytes. INSTGS_CRASHES=100 tries
//! a hundred points of each kind.

use std::fs;
use std::path::Path;
use std::process::{Command, Output};

use instgs_io::save_scene;

use crate::common::chairs::chairs;
use crate::common::crash::{rounds, run_whole, temporaries};
use crate::common::program::skips_gpu;
use crate::disturbed::{error_line, instgs_vk, photos, training};

fn command(faults: &str) -> Command {
    let mut command = instgs_vk();
    command.env("INSTGS_FAULTS", faults);
    command
}

/// The error of a command that failed as a fault of the device should: exit code 1, one line, with the words.
fn failed(output: &Output, words: &[&str]) -> bool {
    if output.status.success() {
        return false;
    }
    let line = error_line(output);
    assert!(words.iter().any(|word| line.contains(word)), "{line}");
    true
}

/// Kinds of faults by number, with words of the error.
const KINDS: [(&str, &[&str]); 3] = [
    ("lost", &["the device was lost"]),
    ("dies", &["the device was lost"]),
    ("refused", &["out of device memory for "]),
];

/// The first ones, then ever fewer: `count` numbers.
fn points(count: usize, most: f64) -> Vec<u64> {
    let mut points: Vec<u64> =
        (0..count).map(|k| (most + 1.0).powf((k + 1) as f64 / count as f64) as u64 - 1).collect();
    points.iter_mut().for_each(|n| *n = (*n).max(1));
    points.dedup();
    points
}

#[test]
fn a_plan_that_cannot_be_read_is_an_error() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    save_scene(&folder.path().join("scene.instgs"), &chairs()).unwrap();
    let output = render(folder.path(), "lost=soon", "x");
    assert!(failed(&output, &["INSTGS_FAULTS"]), "{output:?}");
}

fn render(at: &Path, faults: &str, out: &str) -> Output {
    let mut render = command(faults);
    render.args(["render", "--scene"]).arg(at.join("scene.instgs")).args(["--orbit", "2", "--size", "96x54", "--out"]);
    render.arg(at.join(out)).output().unwrap()
}

#[test]
fn a_render_ends_with_one_line_or_is_right() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    save_scene(&at.join("scene.instgs"), &chairs()).unwrap();
    assert!(render(at, "heap=4096", "whole").status.success());
    let picture = |out: &str| ["000.png", "001.png"].map(|name| fs::read(at.join(out).join(name)).ok());
    let whole = picture("whole");
    for (kind, words) in KINDS {
        let (mut ended, mut went_on) = (0, 0);
        for number in points(rounds(4), 100.0) {
            let out = format!("{kind}_{number}");
            let output = render(at, &format!("{kind}={number}"), &out);
            match failed(&output, words) {
                true => ended += 1,
                false => went_on += 1,
            }
            // Pictures that are there are right.
            let found = picture(&out);
            let right = found.iter().zip(&whole).all(|(a, b)| a.is_none() || a == b);
            assert!(right && (found == whole || !output.status.success()), "{kind}={number}");
            assert!(temporaries(at).is_empty());
        }
        println!("render, {kind}: {ended} ended with one line, {went_on} went on");
        assert!(ended > 0, "{kind}: no fault happened");
    }
    // A heap too small for the picture.
    let mut large = command("heap=1");
    large.args(["render", "--scene"]).arg(at.join("scene.instgs")).args(["--orbit", "1", "--size", "640x360", "--out"]);
    assert!(failed(&large.arg(at.join("large")).output().unwrap(), &["the budget is 1.0 MiB"]));
}

#[test]
fn a_training_can_be_resumed_after_any_fault() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    photos(at);
    let settings = ["--steps", "24", "--max-gaussians", "600", "--set", "checkpoint_every=8"];
    let settings = [&settings[..], &["--set", "densify.start=5", "--set", "densify.every=4"]].concat();
    let start = |command: Command, out: &str| training(command, at, out, &settings);
    run_whole(&mut start(instgs_vk(), "whole"));
    let of = |out: &str, file: &str| fs::read(at.join(out).join(file)).unwrap();
    for (kind, words) in KINDS {
        let (mut ended, mut went_on) = (0, 0);
        for number in points(rounds(3), 200.0) {
            let output = start(command(&format!("{kind}={number}")), "run").output().unwrap();
            match failed(&output, words) {
                true => ended += 1,
                false => went_on += 1,
            }
            run_whole(&mut start(instgs_vk(), "run"));
            // Memory that is refused to a densification ends growth, which the log says; the scene is then a smaller one.
            let is_smaller = String::from_utf8(of("run", "events.jsonl")).unwrap().contains("\"device_full\"");
            for file in ["scene.instgs", "checkpoints/step_0000024.safetensors"] {
                let same = of("run", file) == of("whole", file);
                assert!(same || (is_smaller && kind == "refused"), "{kind}={number}: {file} differs");
            }
            assert!(temporaries(&at.join("run")).is_empty(), "{kind}={number}");
            fs::remove_dir_all(at.join("run")).unwrap();
        }
        println!("training, {kind}: {ended} ended with one line and went on when resumed, {went_on} went on at once");
        assert!(ended > 0, "{kind}: no fault happened");
    }
}
