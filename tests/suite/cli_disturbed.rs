//! Trainings that are killed, interrupted and disturbed, as a user may.

use std::fs;
use std::io::Write;
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};
use std::time::{Duration, Instant};

use crate::common::program::{built, error_of, program, skips_gpu};
use crate::made_once::car_park;
use assert_cmd::Command;
use instgs_io::{checkpoint, read_exposures};
use serde_json::Value;

/// A folder with `data`: 12 photos, two of them for test, and points.
fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().to_path_buf();
    car_park(12, (96, 54), &at);
    (folder, at)
}

/// Checkpoints at steps of a report and between two of them.
const OPTIONS: [&str; 12] = [
    "--config",
    "quick",
    "--steps",
    "96",
    "--max-gaussians",
    "1200",
    "--set",
    "checkpoint_every=16",
    "--set",
    "densify.start=10",
    "--set",
    "densify.every=8",
];

fn arguments(at: &Path, out: &str, more: &[&str]) -> Vec<String> {
    let path = |name: &str| at.join(name).display().to_string();
    let given = ["train".into(), "--data".into(), path("data"), "--out".into(), path(out)];
    given.into_iter().chain(OPTIONS.iter().chain(more).map(|text| (*text).to_owned())).collect()
}

fn train(at: &Path, out: &str, more: &[&str]) -> Command {
    let mut command = program();
    command.args(arguments(at, out, more));
    command
}

fn start(at: &Path, out: &str, more: &[&str]) -> Child {
    let mut command = std::process::Command::new(built("instgs-vk"));
    command.args(arguments(at, out, more)).stdout(Stdio::null()).stderr(Stdio::piped()).spawn().unwrap()
}

/// Waits until a checkpoint of `step` steps, or of more, is there.
fn wait_for(at: &Path, out: &str, step: u64, child: &mut Child) {
    let step_of = |path: PathBuf| {
        let name = path.file_stem()?.to_string_lossy().into_owned();
        name.strip_prefix("step_")?.parse::<u64>().ok()
    };
    let folder = at.join(out).join("checkpoints");
    let reached = || fs::read_dir(&folder).is_ok_and(|f| f.flatten().any(|e| step_of(e.path()) >= Some(step)));
    let start = Instant::now();
    while !reached() {
        assert!(start.elapsed() < Duration::from_secs(120), "no checkpoint of step {step}");
        assert!(child.try_wait().unwrap().is_none(), "it ended before step {step}");
        std::thread::sleep(Duration::from_millis(2));
    }
}

/// Trains until there is a checkpoint of `step` steps, and kills it.
fn killed_after(at: &Path, out: &str, step: u64, more: &[&str]) {
    let mut child = start(at, out, more);
    wait_for(at, out, step, &mut child);
    child.kill().unwrap();
    child.wait().unwrap();
}

fn scene_bytes(at: &Path, out: &str) -> Vec<u8> {
    fs::read(at.join(out).join("scene.instgs")).unwrap()
}

/// The checkpoint after the last step.
fn last_checkpoint(at: &Path, out: &str) -> Vec<u8> {
    fs::read(at.join(out).join("checkpoints").join(checkpoint::file_name(96))).unwrap()
}

/// A photo that was exchanged, a mask, a camera, or a view that is gone: the run says so and does not go on, unless that is
/// wanted. As it was, it goes on to the bytes of the uninterrupted run.
#[test]
fn a_changed_data_set_is_refused_or_accepted() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    let exposures = ["--set", "exposure.rate=1e-2"];
    train(&at, "whole", &exposures).assert().success();
    killed_after(&at, "run", 32, &exposures);
    let config = fs::read(at.join("run/config.toml")).unwrap();
    let refused = |words: &[&str]| {
        let text = error_of(&mut train(&at, "run", &["--resume"]));
        words.iter().chain(&["--accept-changed-data"]).for_each(|word| assert!(text.contains(word), "{word}: {text}"));
        assert!(fs::read(at.join("run/config.toml")).unwrap() == config && !at.join("run/scene.instgs").exists());
    };
    // Two photos are exchanged: as many as before, and of the same size.
    let photo = |name: &str| at.join("data/images").join(name);
    let exchange = || {
        fs::rename(photo("003.png"), photo("x.png")).unwrap();
        fs::rename(photo("005.png"), photo("003.png")).unwrap();
        fs::rename(photo("x.png"), photo("005.png")).unwrap();
    };
    exchange();
    refused(&["003.png", "photo", "2 changes", "step "]);
    exchange();
    let transforms = at.join("data/transforms.json");
    let good = fs::read_to_string(&transforms).unwrap();
    let mut views: Value = serde_json::from_str(&good).unwrap();
    let place = &mut views["frames"][4]["transform_matrix"][0][3];
    *place = (place.as_f64().unwrap() + 0.01).into();
    fs::write(&transforms, views.to_string()).unwrap();
    refused(&["004.png", "its camera changed"]);
    fs::write(&transforms, &good).unwrap();

    // Of another run the photo is exchanged and one is gone, and that is wanted.
    copy_folder(&at.join("run"), &at.join("other"));
    let kept = fs::read(photo("003.png")).unwrap();
    fs::copy(photo("005.png"), photo("003.png")).unwrap();
    fs::rename(photo("007.png"), at.join("007.png")).unwrap();
    let accepted = train(&at, "other", &["--resume", "--accept-changed-data"]).assert().success();
    let said = String::from_utf8(accepted.get_output().stderr.clone()).unwrap();
    assert!(said.contains("003.png") && said.contains("continuing on the changed data set"), "{said}");
    let exposed = read_exposures(&at.join("other/exposures.json")).unwrap();
    assert_eq!(exposed.len() + 1, read_exposures(&at.join("whole/exposures.json")).unwrap().len());
    // What was accepted is what the run now has.
    train(&at, "other", &["--resume"]).assert().success();
    fs::write(photo("003.png"), kept).unwrap();
    fs::rename(at.join("007.png"), photo("007.png")).unwrap();

    // Points are needed only to start from, as long as cameras give the scene's extent.
    fs::remove_file(at.join("data/points3d.ply")).unwrap();
    train(&at, "run", &["--resume"]).assert().success();
    assert!(last_checkpoint(&at, "run") == last_checkpoint(&at, "whole"));
    assert!(scene_bytes(&at, "run") == scene_bytes(&at, "whole"));
}

fn copy_folder(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(|entry| entry.unwrap()) {
        let target = to.join(entry.file_name());
        match entry.file_type().unwrap().is_dir() {
            true => copy_folder(&entry.path(), &target),
            false => {
                fs::copy(entry.path(), target).unwrap();
            }
        }
    }
}

/// The events of a log as `docs/reliability.md` compares them: without times, and without the lines of processes that went on or
/// were asked to stop; of the path of a checkpoint the file's name.
fn comparable_events(at: &Path, out: &str) -> Vec<Value> {
    let text = fs::read_to_string(at.join(out).join("events.jsonl")).unwrap();
    assert!(text.ends_with('\n'));
    let comparable = |line: &str| {
        let mut event: Value = serde_json::from_str(line).unwrap();
        let fields = event.as_object_mut().unwrap();
        fields.remove("seconds");
        fields.remove("steps_per_second");
        if let Some(path) = fields.get_mut("path") {
            *path = Path::new(path.as_str().unwrap()).file_name().unwrap().to_string_lossy().into();
        }
        let is_of_process = event["resumed"] == true || event["interrupted"] == true;
        (!is_of_process).then_some(event)
    };
    text.lines().filter_map(comparable).collect()
}

/// Killed while it is evaluated, between reports and before a densification, with a line cut off, and stopped by Ctrl-C: the
/// log is that of the uninterrupted run.
#[cfg(unix)]
#[test]
fn the_log_of_a_killed_run_is_that_of_an_uninterrupted_one() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    let often = ["--set", "eval_every=16", "--set", "sh_every=24", "--set", "exposure.rate=1e-2"];
    train(&at, "whole", &often).assert().success();
    let whole = comparable_events(&at, "whole");
    let has = |kind: &str| whole.iter().filter(|event| event["event"] == kind).count();
    assert_eq!(["step", "checkpoint", "evaluated", "finished"].map(has), [10, 6, 6, 1], "{whole:?}");
    assert!(has("densified") > 2 && has("sh_degree") > 1, "{whole:?}");
    // Before the first checkpoint: all of it begins anew.
    let mut child = start(&at, "run", &often);
    while !fs::read_to_string(at.join("run/events.jsonl")).is_ok_and(|text| text.contains("started")) {
        assert!(child.try_wait().unwrap().is_none());
        std::thread::sleep(Duration::from_millis(2));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    let resume = [&often[..], &["--resume"]].concat();
    for step in [16, 32, 48] {
        killed_after(&at, "run", step, &resume);
        let mut log = fs::OpenOptions::new().append(true).open(at.join("run/events.jsonl")).unwrap();
        log.write_all(br#"{"event":"step","step":"#).unwrap();
    }
    // Asked to stop at a step of no report.
    let mut child = start(&at, "run", &resume);
    wait_for(&at, "run", 64, &mut child);
    let stopped = std::process::Command::new("kill").args(["-INT", &child.id().to_string()]).status().unwrap();
    assert!(stopped.success() && !child.wait().unwrap().success());
    train(&at, "run", &resume).assert().success();
    let run = comparable_events(&at, "run");
    let differs = whole.iter().zip(&run).find(|(a, b)| a != b);
    assert!(whole == run, "{} and {} events; {differs:?}", whole.len(), run.len());
    assert!(last_checkpoint(&at, "run") == last_checkpoint(&at, "whole"));
    // Started again when all is done, it ends as it did.
    train(&at, "run", &resume).assert().success();
    assert!(comparable_events(&at, "run") == whole);
}

/// The log, and then the whole folder, are removed while the run goes on: it ends with all its results.
#[cfg(unix)]
#[test]
fn a_folder_removed_in_the_middle_is_made_again() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    train(&at, "whole", &[]).assert().success();
    for removed in ["log/events.jsonl", "folder"] {
        let out = removed.split('/').next().unwrap();
        let mut child = start(&at, out, &[]);
        wait_for(&at, out, 32, &mut child);
        let path = at.join(removed);
        match path.is_dir() {
            // A file that appears meanwhile makes the removal fail.
            true => while fs::remove_dir_all(&path).is_err_and(|e| e.kind() != std::io::ErrorKind::NotFound) {},
            false => fs::remove_file(&path).unwrap(),
        }
        let output = child.wait_with_output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        assert!(output.status.success(), "{removed}: {said}");
        assert!(said.lines().all(|line| line.starts_with("warning: ")) && said.contains("was removed"), "{said}");
        assert!(scene_bytes(&at, out) == scene_bytes(&at, "whole"), "{removed}");
        assert!(comparable_events(&at, out) == comparable_events(&at, "whole"), "{removed}");
        for file in ["config.toml", "report.json", "report.html", "trained.json", "point_cloud.ply"] {
            assert!(at.join(out).join(file).is_file(), "{removed}: {file}");
        }
    }
}

/// Too little device memory: one line with the budget, what memory is used for, and what would fit.
#[test]
fn what_would_fit_is_said_when_memory_runs_out() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    let with = |out: &str, mb: u64| train(&at, out, &["--set", &format!("device_memory_mb={mb}")]);
    let mut advised = 0;
    let enough = (0..8).map(|k| 1 << k).find(|&budget: &u64| {
        let output = with(&format!("run{budget}"), budget).output().unwrap();
        let said = String::from_utf8(output.stderr).unwrap();
        if output.status.success() {
            return true;
        }
        let errors: Vec<&str> = said.lines().filter(|line| line.starts_with("error: ")).collect();
        assert_eq!(errors.len(), 1, "{said}");
        let words = ["out of device memory for ", &format!("the budget is {budget}.0 MiB, and "), "iB are in use ("];
        words.iter().for_each(|word| assert!(errors[0].contains(word), "{word}: {said}"));
        // Before the first step too little is known for advice.
        if let Some((_, least)) = errors[0].split_once("device_memory_mb=") {
            let least: u64 = least.split(')').next().unwrap().parse().unwrap();
            assert!(least > budget, "{said}");
            advised += 1;
        }
        false
    });
    let enough = enough.filter(|&budget| budget > 8 && advised > 1).expect("some budget is enough, others need advice");
    // With the least that will do, evaluations on the way make room for themselves.
    let ends = |mb: u64| with(&format!("least{mb}"), mb).output().unwrap().status.success();
    let (mut too_little, mut least) = (enough / 2, enough);
    while least - too_little > 1 {
        let middle = u64::midpoint(too_little, least);
        if ends(middle) { least = middle } else { too_little = middle }
    }
    let memory = format!("device_memory_mb={least}");
    train(&at, "evaluated", &["--set", &memory, "--set", "eval_every=16"]).assert().success();
    assert!(scene_bytes(&at, "evaluated") == scene_bytes(&at, &format!("run{enough}")), "{least} MiB");
}

/// A densification that would leave nothing changes nothing: with other settings the run goes on from there.
#[test]
fn settings_that_leave_nothing_cost_no_steps() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    train(&at, "whole", &[]).assert().success();
    let all = ["--set", "densify.opacity_min=0.99", "--set", "checkpoint_every=0"];
    let output = train(&at, "none", &all).assert().code(1).get_output().clone();
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.contains("would be left") && text.contains("checkpoints/step_"), "{text}");
    train(&at, "none", &["--resume", "--set", "densify.opacity_min=0.005"]).assert().success();
    assert!(scene_bytes(&at, "none") == scene_bytes(&at, "whole"));
}
