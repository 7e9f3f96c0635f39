//! How a run begins: what `train --dry-run` says of it, and the folder that it gets without `--out`.

use std::fs;
use std::path::Path;

use assert_cmd::Command;
use serde_json::Value;

use crate::common::program::{built, error_of, program, skips_gpu};
use crate::made_once::car_park;

const VIEWS: u32 = 16;
const SIZE: (u32, u32) = (128, 72);

/// A folder with `data`: 16 photos of the embedded car park, two of them for test, points, and masks of two photos, of which
/// one has the ids 1 and 2, the other 1 to 3.
fn folder() -> tempfile::TempDir {
    let folder = tempfile::tempdir().unwrap();
    car_park(VIEWS, SIZE, folder.path());
    let masks = folder.path().join("data/masks");
    fs::create_dir(&masks).unwrap();
    for (name, ids) in [("001.png", 2), ("002.png", 3)] {
        let mask =
            image::GrayImage::from_fn(SIZE.0, SIZE.1, |x, _| image::Luma([if x < ids { x as u8 + 1 } else { 0 }]));
        mask.save(masks.join(name)).unwrap();
    }
    folder
}

/// The program in the folder of the data.
fn train(at: &Path, args: &[&str]) -> Command {
    let mut command = Command::new(built("instgs-vk"));
    command.current_dir(at).arg("train").args(args);
    command
}

fn json_of(mut command: Command) -> Value {
    serde_json::from_slice(&command.assert().success().get_output().stdout).unwrap()
}

fn entries(at: &Path) -> Vec<String> {
    let mut out: Vec<String> =
        fs::read_dir(at).unwrap().map(|entry| entry.unwrap().file_name().into_string().unwrap()).collect();
    out.sort();
    out
}

/// What the dry run says of memory is what the run then uses, and the sum is nearly all of it.
#[test]
fn a_dry_run_says_what_the_run_uses() {
    if skips_gpu() {
        return;
    }
    let folder = folder();
    let at = folder.path();
    let before = entries(at);
    let options = ["data", "--config", "quick", "--steps", "20", "--max-gaussians", "3000", "--set", "init=random"];
    let options =
        [&options[..], &["--set", "init_count=3000", "--set", "strategy=none", "--out", "run", "--json"]].concat();
    let planned = json_of(train(at, &[&options[..], &["--dry-run"]].concat()));
    assert_eq!(entries(at), before, "nothing is written");
    assert_eq!((&planned["train_views"], &planned["test_views"]), (&14.into(), &2.into()), "{planned}");
    assert_eq!((&planned["steps"], &planned["method"]), (&20.into(), &"3dgs".into()), "{planned}");
    assert_eq!(planned["pictures_px"], serde_json::json!([[128, 72], [128, 72]]));
    assert!(planned["start"].as_str().unwrap().contains("3,000 random") && planned["masks"].is_null(), "{planned}");
    train(at, &options).assert().success();
    let facts: Value = serde_json::from_slice(&fs::read(at.join("run/trained.json")).unwrap()).unwrap();
    let used = |name: &Value| {
        let all = facts["memory_explained"].as_array().unwrap();
        all.iter().find(|used| used["name"] == *name).unwrap()["bytes"].as_f64().unwrap()
    };
    for plan in planned["memory"].as_array().unwrap() {
        let (plan, used) = (plan["bytes"].as_f64().unwrap(), used(&plan["name"]));
        // Buffers are rounded up to whole work-groups.
        assert!((0.95..=1.001).contains(&(plan / used)), "planned {plan}, used {used}");
    }
    let least = planned["least_device_bytes"].as_f64().unwrap();
    let peak = facts["bytes"]["device_peak"].as_f64().unwrap();
    assert!(least <= peak, "at least {least}, used {peak}");
}

#[test]
fn a_dry_run_counts_masks_and_objects() {
    if skips_gpu() {
        return;
    }
    let folder = folder();
    let at = folder.path();
    let plan = |more: &[&str]| {
        json_of(train(at, &[&["data", "--config", "instgs_quick", "--dry-run", "--json"], more].concat()))
    };
    let masked = plan(&[]);
    let text = masked["masks"].as_str().unwrap();
    assert!(text.contains("2 of 14 training views") && text.contains("up to 3 objects each and 3 ids"), "{text}");
    assert_eq!((&masked["objects"], &masked["method"]), (&3.into(), &"instgs".into()));
    assert!(masked["notes"][0].as_str().unwrap().contains("12 of 14 training views have no mask"), "{masked}");
    let pose = "[[1,0,0,0],[0,1,0,0],[0,0,1,0],[0,0,0,1]]";
    let instance = |id: u32| format!("{{\"instance_id\":{id},\"transform\":{pose}}}");
    let groups = format!("[{{\"template_id\":0,\"instances\":[{},{}]}}]", instance(1), instance(2));
    fs::write(at.join("groups.json"), groups).unwrap();
    let grouped = plan(&["--groups", "groups.json"]);
    assert_eq!(grouped["objects"], 2);
    assert!(grouped["groups"].as_str().unwrap().starts_with("1 groups in"), "{grouped}");
    // Masks from words are made by the run.
    let prompted = plan(&["--prompt", "car. bench.", "--models", "models"]);
    assert!(prompted["masks"].as_str().unwrap().contains("car. bench."), "{prompted}");
    let text = train(at, &["data", "--config", "instgs_quick", "--dry-run"]).assert().success().get_output().clone();
    let text = String::from_utf8(text.stdout).unwrap();
    assert!(text.contains("steps") && text.contains("MiB") && text.contains("nothing was written"), "{text}");
    fs::write(at.join("data/masks/003.png"), "no picture").unwrap();
    assert!(error_of(&mut train(at, &["data", "--config", "instgs_quick", "--dry-run"])).contains("003.png"));
    assert!(error_of(&mut train(at, &["no-such", "--dry-run"])).contains("no-such: there is no such folder"));
    assert!(!at.join("runs").exists());
}

#[test]
fn a_run_without_a_name_gets_one_of_its_own() {
    if skips_gpu() {
        return;
    }
    let folder = folder();
    let at = folder.path();
    for _ in 0..2 {
        let args = ["data", "--config", "quick", "--steps", "10", "--width", "64"];
        let said = train(at, &args).assert().success().get_output().stdout.clone();
        assert!(String::from_utf8(said).unwrap().contains("the run folder is runs/data-20"));
    }
    let runs = entries(&at.join("runs"));
    assert_eq!(runs.len(), 2, "{runs:?}");
    // The second has a number, unless midnight was between them.
    assert!(runs[1].strip_prefix(&runs[0]).is_none_or(|rest| rest == "-2"), "{runs:?}");
    for run in &runs {
        assert!(at.join("runs").join(run).join("scene.instgs").is_file(), "{run}");
    }
    // A run that cannot begin leaves no folder behind.
    fs::remove_file(at.join("data/points3d.ply")).unwrap();
    assert!(error_of(&mut train(at, &["data", "--config", "quick", "--steps", "10"])).contains("point cloud"));
    assert_eq!(entries(&at.join("runs")), runs);
}

/// Photos stay alone, a folder to resume that has no run is said to begin one, and steps that nobody trains are not promised.
#[test]
fn what_a_run_would_not_do_is_said() {
    if skips_gpu() {
        return;
    }
    let folder = folder();
    let at = folder.path();
    let (before, quick) = (entries(&at.join("data")), ["data", "--config", "instgs_quick"]);
    for more in [&["--dry-run"][..], &["--steps", "5"]] {
        let text = error_of(&mut train(at, &[&quick[..], &["--out", "data"], more].concat()));
        assert!(text.contains("is the folder of the data set") && text.contains("another folder"), "{text}");
    }
    assert_eq!(entries(&at.join("data")), before);
    let said = |args: &[&str]| {
        let output = train(at, args).output().unwrap();
        [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap())
    };
    // A scene to start from is read, as the run would.
    fs::write(at.join("points.ply"), "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n0\n")
        .unwrap();
    let text = error_of(&mut train(at, &["data", "--config", "quick", "--init", "points.ply", "--dry-run"]));
    assert!(text.contains("points.ply"), "{text}");
    let text = error_of(&mut train(at, &["data", "--config", "quick", "--out", "points.ply", "--dry-run"]));
    assert!(text.contains("points.ply: is a file, and a run needs a folder"), "{text}");
    let begin = ["data", "--config", "quick", "--steps", "5", "--out", "plain", "--resume"];
    assert!(said(&begin)[1].contains("plain holds no run to resume: a new one begins"));
    assert!(!said(&begin)[1].contains("to resume"));
    let given = ["--init", "plain/point_cloud.ply", "--steps", "5000", "--joint-steps", "7", "--dry-run"];
    let [plan, warnings] = said(&[&quick[..], &given].concat());
    assert!(plan.contains("7 joint ones; the plain cloud is given") && !plan.contains("5,000"), "{plan}");
    assert!(warnings.contains("--steps are those of the plain cloud"), "{warnings}");
}

#[test]
fn wrong_usage_of_train_exits_with_2() {
    for args in [
        &["train"][..],
        &["train", "a", "--data", "b"],
        &["train", "a", "--resume"],
        &["train", "a", "--out", "b", "--resume", "--dry-run"],
    ] {
        program().args(args).assert().code(2);
    }
}
