//! `train --method instgs` and `compare` as a user runs them, on a small ray-traced data set.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use crate::common::program::{built, program, skips_gpu};
use crate::made_once::three_cars;
use assert_cmd::Command;
use instgs_io::checkpoint::{self, Checkpoint};
use instgs_io::{load_scene, read_exposures, read_groups, write_groups, write_ply};
use instgs_vk::scene::PosedGroup;
use instgs_vk::scene::instanced_scene::SAME_COLOR;
use serde_json::Value;

/// A folder with `data`: three cars in 16 small photos, and poses that are off.
fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().to_path_buf();
    three_cars(&at.join("data"));
    (folder, at)
}

fn train(at: &Path, out: &str, more: &[&str]) -> Command {
    let mut command = program();
    command.args(["train", "--data"]).arg(at.join("data")).arg("--out").arg(at.join(out));
    command.args(FEW).args(["--steps", "120", "--joint-steps", "60", "--groups"]);
    command.arg(at.join("data/groups_noisy.json")).args(more);
    command
}

/// The configuration, with so few Gaussians that steps are short.
const FEW: [&str; 4] = ["--config", "instgs_quick", "--max-gaussians", "6000"];

fn json(path: PathBuf) -> Value {
    serde_json::from_slice(&fs::read(&path).unwrap()).unwrap()
}

fn last_checkpoint(at: &Path, out: &str) -> Vec<u8> {
    let (path, _) = checkpoint::latest(&at.join(out).join("checkpoints")).unwrap().found.unwrap();
    fs::read(path).unwrap()
}

/// All stages under the validation layers: files, counts that fit together, and quality not below that of the cloud.
#[test]
fn all_stages_leave_their_files_and_lose_no_quality() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    train(&at, "run", &[]).env("INSTGS_VALIDATION", "1").assert().success();
    let run = at.join("run");
    for file in [
        "config.toml",
        "groups.json",
        "point_cloud.ply",
        "labels.safetensors",
        "initial.instgs",
        "scene.instgs",
        "events.jsonl",
        "report.html",
        "review.html",
        "vanilla/report.json",
    ] {
        assert!(run.join(file).exists(), "{file}");
    }
    // Four views, three cars of which one is the reference, and one template before and after the joint phase.
    for (stage, pictures) in [("1_masks", 4), ("2_objects", 4), ("3_labels", 4), ("4_pose", 9), ("5_template", 4)] {
        let names = fs::read_dir(run.join("stages")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
        assert_eq!(names.filter(|name| name.starts_with(stage)).count(), pictures, "{stage}");
    }
    let page = fs::read_to_string(run.join("report.html")).unwrap();
    for title in ["The scene", "Masks, objects and labels", "Registered poses", "Templates", "Pictures"] {
        assert!(page.contains(&format!("<h2>{title}</h2>")), "{title}");
    }
    assert!(page.contains("srcdoc=\"&lt;!DOCTYPE html&gt;"), "the scene is drawn within the page");
    let report = json(run.join("report.json"));
    assert!(report["stages"].as_array().unwrap().iter().any(|stage| stage["name"] == "pictures"));
    assert_eq!((report["method"].as_str(), report["steps"].as_u64()), (Some("instgs"), Some(60)));
    let scene = load_scene(&run.join("scene.instgs")).unwrap().scene;
    assert_eq!((scene.instances.len(), scene.template_ranges.len()), (3, 1));
    assert_eq!(scene.groups[0].instance_ids, [1, 2, 3]);
    assert_eq!(report["gaussians"]["template"].as_u64(), Some(scene.templates.len() as u64));
    assert_eq!(scene.offsets.len(), 3 * scene.templates.len());
    assert!(scene.templates.len() > 50, "{}", scene.templates.len());
    let psnr = |report: &Value| report["eval"]["psnr"].as_f64().unwrap();
    let (ours, vanilla) = (psnr(&report), psnr(&report["vanilla"]));
    println!("instgs {ours:.2} dB, its start {vanilla:.2} dB");
    assert!(ours > vanilla - MOST_LOSS_DB, "{ours} {vanilla}");
    // It is also not the start: the joint phase learned something.
    let initial = load_scene(&run.join("initial.instgs")).unwrap().scene;
    assert_ne!(initial.templates, scene.templates);
    assert_ne!(initial.instances, scene.instances);
    assert!((0..3).all(|k| initial.instances[k].template == scene.instances[k].template));
}

/// The joint phase goes on from a trained cloud. Measured: it gains 1.3 dB (16.7 to 18.0).
const MOST_LOSS_DB: f64 = 0.5;

/// Twice the same bytes; and a run whose joint phase was killed ends in them too, without repeating the stages before. The
/// joint phase has everything: all kinds of offsets, colour matrices, exposures of photos that go on from those of the plain
/// cloud, and growth before and after the kill, of templates and of single instances, by halves and with room made for them as in
/// the defaults.
#[test]
fn runs_repeat_bit_by_bit_after_a_kill_too() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    let sets = [
        "checkpoint_every=10",
        "offsets.sh_degree=3",
        "offsets.covariance=true",
        "densify.start=15",
        "densify.every=10",
        "densify.growth=halves",
        "densify.recycle=0.05",
        "densify.recycle_every=15",
        "joint.instances_every=4",
        "joint.grow_fraction=0.8",
        "joint.max_expanded=2",
        "joint.own_share=0.4",
        "joint.color_matrix_rate=1e-3",
        "exposure.rate=1e-2",
    ];
    let every: Vec<&str> = sets.iter().flat_map(|set| ["--set", set]).collect();
    train(&at, "a", &every).assert().success();
    let [initial, grown] =
        ["initial.instgs", "scene.instgs"].map(|file| load_scene(&at.join("a").join(file)).unwrap().scene);
    let [before, after] = [&initial, &grown].map(|scene| scene.templates.len() + scene.own.len());
    assert!(after > before, "{after} {before}");
    assert_eq!(grown.offsets.len(), 3 * grown.templates.len());
    assert!(grown.own.len() > 10 && grown.own_ranges.len() == 3, "{}", grown.own.len());
    assert!(grown.color_from_template.len() == 3 && grown.color_from_template.iter().any(|m| *m != SAME_COLOR));
    let mut child = std::process::Command::new(built("instgs-vk"))
        .args(["train", "--data"])
        .arg(at.join("data"))
        .arg("--out")
        .arg(at.join("b"))
        .args(FEW)
        .args(["--steps", "120", "--joint-steps", "60", "--groups"])
        .arg(at.join("data/groups_noisy.json"))
        .args(&every)
        .stdout(std::process::Stdio::null())
        .stderr(std::process::Stdio::null())
        .spawn()
        .unwrap();
    let checkpoint = at.join("b/checkpoints").join(checkpoint::file_name(20));
    let deadline = Instant::now() + Duration::from_secs(300);
    while !checkpoint.exists() && Instant::now() < deadline && child.try_wait().unwrap().is_none() {
        std::thread::sleep(Duration::from_millis(5));
    }
    child.kill().unwrap();
    child.wait().unwrap();
    assert!(checkpoint.exists(), "no checkpoint of step 20");
    let vanilla = fs::metadata(at.join("b/vanilla/report.json")).unwrap().modified().unwrap();
    let mut resume = program();
    resume.args(["train", "--resume", "--data"]).arg(at.join("data")).arg("--out").arg(at.join("b"));
    resume.assert().success();
    assert_eq!(fs::metadata(at.join("b/vanilla/report.json")).unwrap().modified().unwrap(), vanilla);
    assert!(last_checkpoint(&at, "a") == last_checkpoint(&at, "b"), "after a kill");
    assert!(fs::read(at.join("a/scene.instgs")).unwrap() == fs::read(at.join("b/scene.instgs")).unwrap());
    let [plain, a, b] =
        ["a/vanilla", "a", "b"].map(|run| read_exposures(&at.join(run).join("exposures.json")).unwrap());
    assert!(a == b && a.len() == plain.len() && a != plain);
    // What the objects came from is settled; what the joint phase alone goes by is not.
    let resume = |more: [&str; 2]| {
        let mut command = program();
        command.args(["train", "--resume", "--data"]).arg(at.join("data")).arg("--out").arg(at.join("b")).args(more);
        command
    };
    let configs = || ["b/config.toml", "b/vanilla/config.toml"].map(|path| fs::read(at.join(path)).unwrap());
    let before = configs();
    let text = resume(["--steps", "240"]).assert().code(1).get_output().stderr.clone();
    let text = String::from_utf8(text).unwrap();
    assert!(text.contains("steps = 120") && text.contains("240") && text.contains("another folder"), "{text}");
    assert!(configs() == before);
    // Without labels the templates are there still, and without these there are no stages to keep, but the plain cloud is.
    let of_stages = ["b/labels.safetensors", "b/prepared.json", "b/initial.instgs"].map(|path| at.join(path));
    let kept = of_stages.each_ref().map(|path| fs::read(path).unwrap());
    fs::remove_file(&of_stages[0]).unwrap();
    let text = resume(["--set", "segment.alpha=0.5"]).assert().code(1).get_output().stderr.clone();
    assert!(String::from_utf8(text).unwrap().contains("its objects were found with segment.alpha"));
    // Without their report, templates are those of stages that were done one by one.
    fs::remove_file(&of_stages[1]).unwrap();
    let text = resume(["--joint-steps", "70"]).assert().code(1).get_output().stderr.clone();
    assert!(String::from_utf8(text).unwrap().contains("was begun stage by stage"));
    fs::remove_file(&of_stages[2]).unwrap();
    let text = resume(["--set", "rates.opacity=0.04"]).assert().code(1).get_output().stderr.clone();
    let text = String::from_utf8(text).unwrap();
    assert!(text.contains("plain cloud was trained with rates.opacity = 0.025") && text.contains("0.04"), "{text}");
    assert!(configs() == before);
    of_stages.iter().zip(kept).for_each(|(path, bytes)| fs::write(path, bytes).unwrap());
    resume(["--joint-steps", "70"]).assert().success();
    assert_eq!(json(at.join("b/report.json"))["steps"], 70);
    // What is refused later, by a checkpoint and by its photos, leaves the folder as it was, too.
    let before = configs();
    let text = error_of(&mut resume(["--joint-steps", "50"]));
    assert!(text.contains("is of step 70, the configuration has steps = 50"), "{text}");
    let photos = ["view_001", "view_002"].map(|name| at.join("data/images").join(format!("{name}.png")));
    let photo = fs::read(&photos[0]).unwrap();
    fs::copy(&photos[1], &photos[0]).unwrap();
    let text = error_of(&mut resume(["--set", "joint.prune_opacity=0.5"]));
    assert!(text.contains("view_001") && text.contains("--accept-changed-data"), "{text}");
    assert!(configs() == before);
    fs::write(&photos[0], &photo[..photo.len() / 2]).unwrap();
    error_of(&mut train(&at, "never", &[]));
    for left in ["never/config.toml", "never/vanilla"] {
        assert!(!at.join(left).exists(), "a run that never began left {left}");
    }
    fs::write(&photos[0], photo).unwrap();
    // Poses and offsets are in the checkpoint.
    let (path, _) = checkpoint::latest(&at.join("a/checkpoints")).unwrap().found.unwrap();
    let state = Checkpoint::read(&path).unwrap();
    for name in [
        "parameter.world_from_template",
        "moment.poses",
        "parameter.offset_quats",
        "moment.offset_means",
        "moment.color_from_template",
        "layout.template_ranges",
        "layout.own",
        "exposure.photo_from_scene",
        "moment.exposure",
        "statistics.records",
    ] {
        assert!(state.tensors.contains_key(name), "{name}");
    }
}

/// Runs, wants exit code 1 and exactly one line on stderr that starts with `error:`, which it returns.
fn error_of(command: &mut Command) -> String {
    let output = command.assert().code(1).get_output().clone();
    let text = String::from_utf8(output.stderr).unwrap();
    let errors: Vec<&str> = text.lines().filter(|line| line.starts_with("error: ")).collect();
    assert_eq!(errors.len(), 1, "{text:?}");
    errors[0].into()
}

/// Without groups, the masks' objects are registered: the same three cars, posed against one of them.
#[test]
fn objects_are_registered_without_groups() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    let mut command = program();
    command.args(["train", "--method", "instgs", "--data"]).arg(at.join("data")).arg("--out").arg(at.join("run"));
    command.args(FEW).args(["--steps", "120", "--joint-steps", "10"]).assert().success();
    let report = json(at.join("run/report.json"));
    let registered = report["registration"].as_array().unwrap();
    assert_eq!(registered.len(), 3);
    assert!(
        registered.iter().all(|r| r["accepted"] == true && r["name"] == "car" && r["group"] == 0),
        "{registered:?}"
    );
    let stages: Vec<&str> = report["stages"].as_array().unwrap().iter().map(|s| s["name"].as_str().unwrap()).collect();
    assert!(stages.contains(&"consensus") && stages.contains(&"register"), "{stages:?}");
    let truth = read_groups(&at.join("data/groups.json")).unwrap().remove(0);
    let found = read_groups(&at.join("run/groups.json")).unwrap().remove(0);
    let pose =
        |group: &PosedGroup, id: u32| group.instances.iter().find(|i| i.id == id).unwrap().world_from_template.linear();
    let reference = found.instances[0].id;
    for instance in &found.instances {
        let from_reference = |group: &PosedGroup| pose(group, instance.id) * pose(group, reference).inverse();
        let error = from_reference(&found) * from_reference(&truth).transpose();
        let cosine = 0.5 * (error.x_axis.x + error.y_axis.y + error.z_axis.z - 1.0);
        let degrees = cosine.clamp(-1.0, 1.0).acos().to_degrees();
        println!("car {}: {degrees:.2} degrees", instance.id);
        assert!(degrees < MOST_POSE_ERROR_DEGREES, "car {}: {degrees}", instance.id);
    }
}

/// Measured: 2.0 and 2.3, on blurred cars of a hundred training steps; a car that faces the wrong way is 180 off.
const MOST_POSE_ERROR_DEGREES: f64 = 5.0;

/// A trained cloud to start from, groups that do not fit, and what is missing.
#[test]
fn bad_input_is_named() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    let mut plain = program();
    plain
        .args(["train", "--steps", "60", "--config", "quick", "--max-gaussians", "6000", "--data"])
        .arg(at.join("data"));
    plain.arg("--out").arg(at.join("plain")).assert().success();
    let cloud = at.join("plain/point_cloud.ply").display().to_string();
    let start = ["--init", cloud.as_str()];

    let mut groups = read_groups(&at.join("data/groups.json")).unwrap();
    groups[0].instances.iter_mut().for_each(|instance| instance.id += 70);
    let strangers = at.join("strangers.json");
    write_groups(&strangers, &groups).unwrap();
    let mut other = program();
    other.args(["train", "--method", "instgs", "--data"]).arg(at.join("data")).args(FEW).args(start);
    other.args(["--joint-steps", "10", "--groups"]).arg(&strangers).arg("--out").arg(at.join("x2"));
    let text = String::from_utf8(other.assert().success().get_output().stderr.clone()).unwrap();
    assert!(text.contains("nothing is shared") && text.contains("same ids"), "{text}");
    assert!(load_scene(&at.join("x2/scene.instgs")).unwrap().scene.instances.is_empty());

    // A photo that only the joint phase needs: the objects that were found are kept, with what they were found by.
    let photo = at.join("data/images/view_001.png");
    let whole = fs::read(&photo).unwrap();
    fs::write(&photo, &whole[..whole.len() / 2]).unwrap();
    let text = error_of(&mut train(&at, "x5", &start));
    assert!(text.contains("view_001"), "{text}");
    let [config, prepared] = ["x5/config.toml", "x5/prepared.json"].map(|file| fs::read(at.join(file)).unwrap());
    fs::write(&photo, whole).unwrap();
    program()
        .args(["train", "--resume", "--data"])
        .arg(at.join("data"))
        .arg("--out")
        .arg(at.join("x5"))
        .assert()
        .success();
    assert!(fs::read(at.join("x5/config.toml")).unwrap() == config);
    assert!(fs::read(at.join("x5/prepared.json")).unwrap() == prepared && at.join("x5/scene.instgs").is_file());

    fs::rename(at.join("data/masks"), at.join("masks")).unwrap();
    let text = error_of(&mut train(&at, "x3", &start));
    assert!(text.contains("has no masks") && text.contains("--masks"), "{text}");
    let masks = at.join("masks").display().to_string();
    train(&at, "x4", &[&start[..], &["--masks", &masks]].concat()).assert().success();
    let report = json(at.join("x4/report.json"));
    assert!(report["vanilla"]["eval"]["psnr"].as_f64().unwrap() > 5.0);
    assert_eq!(report["vanilla"]["stages"][0]["name"], "load");

    // The run keeps the cloud that its joint phase began with, whatever becomes of the given file.
    let own = fs::read(at.join("x4/point_cloud.ply")).unwrap();
    let mut moved = load_scene(Path::new(&cloud)).unwrap().scene;
    moved.background.means[0][0] += 1.0;
    write_ply(Path::new(&cloud), &moved.background, moved.pixel_filter).unwrap();
    let text = error_of(&mut train(&at, "x4", &["--resume", "--masks", &masks]));
    assert!(text.contains("its joint phase began with another plain cloud"), "{text}");
    assert!(fs::read(at.join("x4/point_cloud.ply")).unwrap() == own);
    fs::remove_file(&cloud).unwrap();
    train(&at, "x4", &["--resume", "--masks", &masks]).assert().success();
}

/// Every row of the protocol is there, and a second call trains nothing again.
#[test]
fn the_comparison_has_all_its_rows_and_is_not_done_twice() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    let command = || {
        let mut command = program();
        command.args(["compare", "--json", "--config", "instgs_quick", "--set", "max_gaussians=6000"]);
        command.args(["--set", "steps=60", "--set", "joint.steps=30"]);
        command.args(["--seeds", "3,4", "--frames", "2", "--more-steps", "30", "--data"]).arg(at.join("data"));
        command.arg("--groups").arg(at.join("data/groups_noisy.json")).arg("--out").arg(at.join("c"));
        command
    };
    let compare = || serde_json::from_slice::<Value>(&command().assert().success().get_output().stdout).unwrap();
    let first = compare();
    let results = first.as_array().unwrap();
    assert_eq!(results.len(), 2);
    for result in results {
        let rows = result["rows"].as_array().unwrap();
        let names: Vec<&str> = rows.iter().map(|r| r["name"].as_str().unwrap()).collect();
        let ours = ["InstGS", "InstGS, f16", "InstGS, q8", "InstGS, small"];
        assert_eq!(names[..3], ["3DGS, the start", "3DGS, same time", "3DGS, same bytes"]);
        assert_eq!(names[3..], ours);
        assert!(rows.iter().all(|r| r["psnr"].as_f64().unwrap() > 5.0 && r["psnr_in_masks"].is_number()));
        let file = |i: usize| rows[i]["file_bytes"].as_u64().unwrap();
        assert!(2 * file(6) < file(5) && file(5) < file(4) && file(4) < file(3));
        // Both packed as f16.
        assert!(file(2) <= file(4), "{rows:?}");
        assert_eq!(rows[1]["steps"], 90);
        // The time of a cloud that was trained on is that of all its steps, once.
        let report = json(at.join(format!("c/seed_{}/same_time/report.json", result["seed"])));
        let train = report["stages"].as_array().unwrap().iter().find(|stage| stage["name"] == "train").unwrap();
        assert_eq!(rows[1]["seconds"], train["seconds"]);
        assert!(rows[1]["seconds"].as_f64() > rows[0]["seconds"].as_f64(), "{rows:?}");
        assert!(rows[2]["host_bytes"].as_u64().unwrap() <= rows[3]["host_bytes"].as_u64().unwrap());
        assert!(result["fps"][0].as_f64().unwrap() > 0.0);
        // 62 numbers a Gaussian, for as many as the merge says it took from the plain cloud.
        let merged = json(at.join(format!("c/seed_{}/instgs/report.json", result["seed"])));
        let groups = merged["groups"].as_array().unwrap();
        let gaussians = |i: &Value| i["gaussians"].as_u64().unwrap();
        let of_group = |g: &Value| -> u64 { g["instances"].as_array().unwrap().iter().map(gaussians).sum() };
        let taken: u64 = groups.iter().map(of_group).sum();
        assert!(taken > 0 && result["replaced_ply"] == 248 * taken, "{result}");
    }
    assert!(fs::read_to_string(at.join("c/compare.md")).unwrap().contains("| InstGS |"));
    let written = |name: &str| fs::metadata(at.join("c/seed_3").join(name)).unwrap().modified().unwrap();
    let before = ["instgs/report.json", "same_time/report.json"].map(written);
    assert_eq!(compare()[0]["rows"], results[0]["rows"]);
    assert_eq!(before, ["instgs/report.json", "same_time/report.json"].map(written));
    let capped = || fs::read_dir(at.join("c/seed_3")).unwrap().map(|e| e.unwrap().file_name().into_string().unwrap());
    assert_eq!(capped().filter(|name| name.starts_with("same_bytes_")).count(), 1);
    // Results of other rates must not be taken for these.
    let text = error_of(command().args(["--set", "offset_rates.means=1e-5"]));
    assert!(text.contains("another comparison") && text.contains("--out"), "{text}");
}

/// Every method is a row, every table a file, and a second call measures nothing again.
#[test]
fn the_evidence_is_written_for_people_pages_and_scripts() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    let list = r#"
config = "instgs_quick"
[sizes.ci]
views = 16
pixels = [96, 54]
set = ["steps=40", "joint.steps=20", "max_gaussians=6000"]
more_steps = 20
frames = 2
[[scenes]]
data = "data"
true_groups = true
ablations = true
[[scenes]]
data = "data_of_somebody_else"
[[ablations]]
table = "init"
name = "difference"
[[ablations]]
table = "init"
name = "zero"
set = ["offsets.init=zero"]
"#;
    fs::write(at.join("list.toml"), list).unwrap();
    let command = |more: &[&str]| {
        let mut command = program();
        command.arg("tables").arg(at.join("list.toml")).arg("--out").arg(at.join("t"));
        command.args(["--note", "Here, today."]).args(more);
        command
    };
    let output = command(&["--json"]).assert().success().get_output().clone();
    assert!(String::from_utf8_lossy(&output.stderr).contains("data_of_somebody_else"), "it is named");
    let results: Value = serde_json::from_slice(&output.stdout).unwrap();
    let scene = &results[0];
    let names: Vec<&str> =
        scene["seeds"][0]["rows"].as_array().unwrap().iter().map(|r| r["name"].as_str().unwrap()).collect();
    let wanted = [
        "3DGS, the start",
        "3DGS, same time",
        "3DGS, same time at once",
        "3DGS-MCMC, same time",
        "3DGS, same bytes",
        "3DGS, same time, .spz",
        "3DGS, same time, small",
        "rigid copies",
        "InstGS",
        "InstGS, f16",
        "InstGS, q8",
        "InstGS, small",
    ];
    assert_eq!(names, wanted);
    let row = |name: &str| {
        let rows = scene["seeds"][0]["rows"].as_array().unwrap().iter();
        rows.into_iter().find(|r| r["name"] == name).unwrap().clone()
    };
    let psnr = |row: &Value| row["psnr"].as_f64().unwrap();
    // A rigid copy has no offsets to store, and cannot look as right.
    assert!(row("rigid copies")["file_bytes"].as_u64() < row("InstGS")["file_bytes"].as_u64());
    assert!(psnr(&row("rigid copies")) < psnr(&row("InstGS")));
    assert!(row("3DGS, same time, .spz")["file_bytes"].as_u64() < row("3DGS, same time")["file_bytes"].as_u64());
    assert!(
        4 * row("3DGS, same time, small")["file_bytes"].as_u64().unwrap()
            < row("3DGS, same time")["file_bytes"].as_u64().unwrap()
    );
    assert_eq!(row("3DGS, same time at once")["steps"], 60);
    assert_eq!(row("rigid copies")["steps"], 60);
    assert!(scene["segmentation"]["mean_accuracy"].as_f64().unwrap() > 0.7, "{}", scene["segmentation"]);
    // The first setting is the scene itself: not trained again, and just as good.
    let ablations = scene["ablations"].as_array().unwrap();
    assert_eq!(psnr(&ablations[0]["row"]), psnr(&row("InstGS")));
    assert_ne!(psnr(&ablations[1]["row"]), psnr(&row("InstGS")));
    let page = fs::read_to_string(at.join("t/tables.md")).unwrap();
    assert!(page.contains("Here, today.") && page.contains("| rigid copies |") && page.contains("### Figure 8"));
    let csv = fs::read_to_string(at.join("t/tables/methods_real.csv")).unwrap();
    assert!(csv.contains("\"3DGS, same time\","), "{csv}");
    assert!(at.join("t/scenes/data/pictures.png").is_file());
    let report = at.join("t/scenes/data/seed_0/same_time/report.json");
    let before = fs::metadata(&report).unwrap().modified().unwrap();
    let text = String::from_utf8(command(&[]).assert().success().get_output().stdout.clone()).unwrap();
    assert!(text.contains("as measured before") && text.contains("rigid copies"), "{text}");
    assert_eq!(fs::metadata(&report).unwrap().modified().unwrap(), before);
    // Less of it, from the runs that are there.
    let output = command(&["--also", "small", "--no-ablations", "--json"]).assert().success().get_output().clone();
    let fewer: Value = serde_json::from_slice(&output.stdout).unwrap();
    let names = |scene: &Value| {
        let rows = scene["seeds"][0]["rows"].as_array().unwrap().clone();
        rows.iter().map(|r| r["name"].as_str().unwrap().to_owned()).collect::<Vec<_>>()
    };
    assert_eq!(names(&fewer[0])[..3], ["3DGS, the start", "3DGS, same time", "3DGS, same time, small"]);
    assert!(names(&fewer[0]).len() == 7 && fewer[0]["ablations"].as_array().unwrap().is_empty());
    assert_eq!(fs::metadata(&report).unwrap().modified().unwrap(), before);
    let text = error_of(&mut command(&["--only", "boat"]));
    assert!(text.contains("boat") && text.contains("data"), "{text}");
    let text = error_of(&mut command(&["--size", "huge"]));
    assert!(text.contains("huge") && text.contains("ci"), "{text}");
}
