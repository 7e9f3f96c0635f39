//! Commands that are killed at random moments: each file is what it was or what it becomes, what goes on ends in the same bytes, and
//! no temporary file outlives the next run. INSTGS_CRASHES=100 kills each a hundred times.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use instgs_io::save_scene;
use instgs_vk::math::rng::Rng;

use crate::common::chairs::chairs;
use crate::common::crash::{End, kill_within, rounds, run_whole, temporaries};
use crate::common::program::skips_gpu;
use crate::disturbed::{instgs_vk, photos, training};
use crate::made_once::three_cars;

/// A folder with a file of chairs as `old.instgs`.
fn chairs_in_a_folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let old = folder.path().join("old.instgs");
    save_scene(&old, &chairs()).unwrap();
    (folder, old)
}

/// Kills a command that replaces `file`, whose content is `old`, until it has been killed often enough; returns how often.
fn replaced_or_not(file: &Path, old: &[u8], replace: &dyn Fn() -> Command, rng: &mut Rng, times: usize) -> usize {
    let restore = || fs::write(file, old).unwrap();
    restore();
    let time = run_whole(&mut replace());
    let new = fs::read(file).unwrap();
    assert!(new != old, "{}: nothing changes", file.display());
    let mut killed = 0;
    for _ in 0..times {
        restore();
        let end = kill_within(&mut replace(), time, rng);
        let found = fs::read(file).unwrap();
        assert!(found == new || (found == old && end == End::Killed), "{}: neither old nor new", file.display());
        killed += usize::from(end == End::Killed);
    }
    restore();
    run_whole(&mut replace());
    assert!(fs::read(file).unwrap() == new, "{}: other bytes after kills", file.display());
    let folder = file.parent().unwrap();
    assert!(temporaries(folder).is_empty(), "{:?}", temporaries(folder));
    killed
}

#[test]
fn edits_and_exports_are_whole_or_not_there() {
    let (folder, old) = chairs_in_a_folder();
    let mut rng = Rng::new(1);
    let scene = fs::read(&old).unwrap();
    let file = folder.path().join("scene.instgs");
    let edit = || {
        let mut edit = instgs_vk();
        edit.arg("edit").arg(&file).args(["--recolour", "0", "rgb=0.2,0,0", "--out"]).arg(&file);
        edit
    };
    let mut killed = replaced_or_not(&file, &scene, &edit, &mut rng, rounds(8));
    let formats = ["instgs", "ply", "spz", "sog", "glb", "usda", "html"];
    for format in formats {
        let file = folder.path().join(format!("exported.{format}"));
        let export = || {
            let mut export = instgs_vk();
            export.args(["export", "--pack", "small", "--scene"]).arg(&old).arg("--to").arg(&file);
            export
        };
        let export_alone = || {
            let mut export = instgs_vk();
            export.args(["export", "--scene"]).arg(&old).arg("--to").arg(&file);
            export
        };
        let is_packed = ["instgs", "html"].contains(&format);
        let export: &dyn Fn() -> Command = if is_packed { &export } else { &export_alone };
        killed += replaced_or_not(&file, b"old", export, &mut rng, rounds(16).div_ceil(formats.len()));
    }
    println!("edit and export were killed {killed} times");
    assert!(killed * 3 > rounds(8), "{killed} kills came in time");
}

/// Kills a run again and again, each time on the same folder, until it ends; then begins anew.
fn killed_run(at: &Path, times: usize, start: &dyn Fn(&str) -> Command, results: &[&str], rng: &mut Rng) {
    let time = run_whole(&mut start("whole"));
    let whole = at.join("whole");
    let same = || {
        for result in results {
            let [run, want] = ["run", "whole"].map(|folder| fs::read(at.join(folder).join(result)).unwrap());
            assert!(run == want, "{result} differs after kills");
        }
        run_whole(&mut start("run"));
        assert!(temporaries(&at.join("run")).is_empty(), "{:?}", temporaries(&at.join("run")));
        fs::remove_dir_all(at.join("run")).unwrap();
    };
    let (mut killed, mut ended) = (0, 0);
    while killed < times {
        // What remains to be done gets less with each kill.
        match kill_within(&mut start("run"), time.max(Duration::from_millis(200)), rng) {
            End::Killed => killed += 1,
            End::Finished => {
                same();
                ended += 1;
            }
        }
    }
    run_whole(&mut start("run"));
    same();
    println!(
        "killed {killed} times; {} runs ended as {} did, in {:.1} s",
        ended + 1,
        whole.display(),
        time.as_secs_f64()
    );
}

#[test]
fn a_cloud_is_trained_through_kills() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    photos(at);
    let settings = ["--steps", "96", "--max-gaussians", "1200", "--set", "checkpoint_every=16"];
    let settings = [&settings[..], &["--set", "densify.start=10", "--set", "densify.every=8"]].concat();
    let start = |out: &str| training(instgs_vk(), at, out, &settings);
    let results = ["scene.instgs", "point_cloud.ply", "checkpoints/step_0000096.safetensors"];
    killed_run(at, rounds(3), &start, &results, &mut Rng::new(2));
}

/// Kills a run on the data set of [`three_cars`], whose poses are known but not exact; `command_line` is the command with
/// what it needs besides.
fn killed_run_of_cars(kills: usize, command_line: &[&str], results: &[&str], seed: u64) {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    three_cars(&at.join("data"));
    let start = |out: &str| {
        let mut run = instgs_vk();
        run.args(command_line).args(["--config", "instgs_quick"]).arg("--data").arg(at.join("data"));
        run.arg("--out").arg(at.join(out)).arg("--groups").arg(at.join("data/groups_noisy.json"));
        run
    };
    killed_run(at, kills, &start, results, &mut Rng::new(seed));
}

#[ignore = "eight trainings with all stages take minutes"]
#[test]
fn all_stages_of_an_instanced_run_go_on_after_kills() {
    let train = ["train", "--resume", "--steps", "60", "--joint-steps", "30", "--set", "checkpoint_every=15"];
    let results = ["scene.instgs", "initial.instgs", "point_cloud.ply", "labels.safetensors", "groups.json"];
    killed_run_of_cars(rounds(2), &train, &results, 3);
}

#[ignore = "each comparison is three trainings: minutes"]
#[test]
fn a_comparison_goes_on_after_kills() {
    let compare = ["compare", "--frames", "0", "--more-steps", "20", "--set", "steps=40"];
    let compare = [&compare[..], &["--set", "joint.steps=20", "--set", "checkpoint_every=10"]].concat();
    let results = ["seed_0/instgs/scene.instgs", "seed_0/instgs/point_cloud.ply"];
    killed_run_of_cars(rounds(1), &compare, &results, 4);
}
