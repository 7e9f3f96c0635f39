//! `segment`, `register` and `merge` as a user runs them; and what `train --method instgs` and they say of bad input.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::program::{error_of, program, skips_gpu};
use crate::made_once::{once, synth};
use assert_cmd::Command;
use instgs_io::{Mask, load_scene, read_groups, read_mask, write_mask};
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::PixelFilter;
use serde_json::Value;

/// A folder with `data` (a small ray-traced scene) and `plain/point_cloud.ply` (a cloud trained on it for a moment).
pub(super) struct Folder {
    at: PathBuf,
    _removed_at_the_end: tempfile::TempDir,
}

impl Folder {
    pub(super) fn new(scene: &[&str]) -> Self {
        let folder = tempfile::tempdir().unwrap();
        let out = Self { at: folder.path().to_path_buf(), _removed_at_the_end: folder };
        once(&format!("{} and a cloud", scene.join(" ")), &out.at, |at| {
            synth(&[scene, &["--views", "10", "--size", "128x72"]].concat(), &at.join("data"));
            let mut plain = program();
            plain.args(["train", "--config", "quick", "--steps", "120", "--max-gaussians", "6000", "--data"]);
            plain.arg(at.join("data")).arg("--out").arg(at.join("plain")).assert().success();
        });
        out
    }

    pub(super) fn path(&self, name: &str) -> PathBuf {
        self.at.join(name)
    }

    pub(super) fn cloud(&self) -> PathBuf {
        self.path("plain/point_cloud.ply")
    }

    /// Masks of the views, by name.
    pub(super) fn masks(&self) -> Vec<PathBuf> {
        let entries = fs::read_dir(self.path("data/masks")).unwrap().map(|entry| entry.unwrap().path());
        let mut masks: Vec<PathBuf> = entries.filter(|path| path.extension().is_some_and(|e| e == "png")).collect();
        masks.sort();
        masks
    }

    /// `train --method instgs` from the dataset's points.
    pub(super) fn train_all(&self, out: &str) -> Command {
        let mut command = program();
        command.args(["train", "--method", "instgs", "--config", "instgs_quick", "--max-gaussians", "6000", "--data"]);
        command.arg(self.path("data")).args(["--set", "joint.steps=10", "--out"]).arg(self.path(out));
        command
    }

    /// The same from the trained cloud.
    pub(super) fn train(&self, out: &str) -> Command {
        let mut command = self.train_all(out);
        command.arg("--init").arg(self.cloud());
        command
    }

    fn segment(&self, out: &str) -> Command {
        let mut command = program();
        command.args(["segment", "--config", "instgs_quick", "--scene"]).arg(self.cloud());
        command.arg("--data").arg(self.path("data")).arg("--out").arg(self.path(out));
        command
    }

    fn register(&self, segments: &str, out: &str) -> Command {
        let mut command = program();
        command.args(["register", "--segments"]).arg(self.path(segments)).arg("--out").arg(self.path(out));
        command
    }

    fn merge(&self, segments: &str, groups: &str, out: &str) -> Command {
        let mut command = program();
        command.args(["merge", "--segments"]).arg(self.path(segments)).arg("--groups").arg(self.path(groups));
        command.arg("--out").arg(self.path(out));
        command
    }

    fn scene(&self, name: &str) -> InstancedScene {
        load_scene(&self.path(name)).unwrap().scene
    }

    fn report(&self, run: &str) -> Value {
        serde_json::from_slice(&fs::read(self.path(run).join("report.json")).unwrap()).unwrap()
    }
}

/// What a command that succeeds warns of.
pub(super) fn warnings_of(command: &mut Command) -> String {
    String::from_utf8(command.assert().success().get_output().stderr.clone()).unwrap()
}

pub(super) fn json_of(command: &mut Command) -> Value {
    serde_json::from_slice(&command.arg("--json").assert().success().get_output().stdout).unwrap()
}

pub(super) fn has_all(text: &str, words: &[&str]) {
    words.iter().for_each(|word| assert!(text.contains(word), "{word:?} is not in {text}"));
}

#[test]
fn three_stages_make_the_scene_that_training_starts_from() {
    if skips_gpu() {
        return;
    }
    let folder = Folder::new(&["cars", "--instances", "3"]);
    folder.train("run").assert().success();

    let report = json_of(folder.segment("segments").env("INSTGS_VALIDATION", "1"));
    assert_eq!(report["consensus"]["objects"].as_array().unwrap().len(), 3);
    assert!(report["background"].as_u64().unwrap() < report["gaussians"].as_u64().unwrap());
    let report = json_of(folder.register("segments", "new/groups.json").env("INSTGS_VALIDATION", "1"));
    let instances = report["instances"].as_array().unwrap();
    assert_eq!(instances.len(), 3);
    for instance in instances {
        ["group", "instance", "verdict", "inliers", "rmse", "photometric", "note"]
            .iter()
            .for_each(|field| assert!(instance.get(field).is_some(), "{field}: {instance}"));
    }
    let report = json_of(&mut folder.merge("segments", "new/groups.json", "merged.instgs"));
    assert_eq!(report["instances"].as_u64(), Some(folder.scene("merged.instgs").instances.len() as u64));
    let same = |a: &str, b: &str| fs::read(folder.path(a)).unwrap() == fs::read(folder.path(b)).unwrap();
    assert!(same("new/groups.json", "run/groups.json"));
    assert!(same("merged.instgs", "run/initial.instgs"), "the same cloud and options give another scene");
    assert!(!folder.scene("merged.instgs").instances.is_empty());

    // Another value gives another scene; a run's folder serves as segments.
    let mut other = folder.merge("run", "new/groups.json", "other.instgs");
    other.args(["--set", "template.source=single"]).assert().success();
    assert!(!same("other.instgs", "merged.instgs"));
    let output = folder.register("run", "again.json").assert().success().get_output().stdout.clone();
    has_all(&String::from_utf8(output).unwrap(), &["group", "verdict", "inliers", "RMSE", "photometric", "note"]);
    assert!(same("again.json", "run/groups.json"));
    let flags = ["--similarity", "--set", "seed=3"];
    folder.register("segments", "similar.json").args(flags).assert().success();
    let scales: Vec<f64> = read_groups(&folder.path("similar.json")).unwrap()[0]
        .instances
        .iter()
        .map(|instance| instance.world_from_template.scale())
        .collect();
    assert!(scales.iter().any(|scale| (scale - 1.0).abs() > 1e-6), "{scales:?}");
}

#[test]
fn stages_name_what_they_cannot_use() {
    if skips_gpu() {
        return;
    }
    let folder = Folder::new(&["cars", "--instances", "2"]);
    folder.segment("segments").assert().success();
    has_all(&error_of(&mut folder.segment("segments")), &["segments", "labels.safetensors", "another folder"]);
    has_all(&error_of(&mut folder.segment("plain")), &["holds segments or a run already"]);
    for command in [&mut folder.register("data", "g.json"), &mut folder.merge("none", "data/groups.json", "x.instgs")] {
        has_all(&error_of(command), &["holds no segmented scene", "instgs-vk segment"]);
    }
    folder.merge("segments", "data/groups.json", "x.instgs").assert().success();
    let mut instanced = program();
    instanced.args(["segment", "--scene"]).arg(folder.path("x.instgs")).arg("--data").arg(folder.path("data"));
    let text = error_of(instanced.arg("--out").arg(folder.path("s2")));
    has_all(&text, &["x.instgs", "has 2 instances already", "export --to"]);
    assert!(!folder.path("s2").exists());
    has_all(&error_of(&mut folder.merge("segments", "g.json", "y.instgs")), &["g.json", "cannot read"]);
    has_all(&error_of(&mut folder.merge("segments", "data/groups.json", "y.ply")), &["y.ply", ".instgs"]);
    // Labels of another cloud.
    fs::copy(folder.path("x.instgs"), folder.path("segments/scene.instgs")).unwrap();
    let cloud = folder.scene("segments/point_cloud.ply").background;
    let mut moved = cloud.clone();
    moved.means[0][0] += 1.0;
    for other in [cloud.filtered(|i| i > 0), moved] {
        instgs_io::write_ply(&folder.path("segments/point_cloud.ply"), &other, PixelFilter::default()).unwrap();
        let text = error_of(&mut folder.register("segments", "g.json"));
        has_all(&text, &["labels.safetensors", "another point_cloud.ply"]);
    }
}

/// A damaged mask, as bytes, and what the error says besides its name.
fn bad_masks(whole: &Path) -> Vec<(Vec<u8>, Vec<&'static str>)> {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("bad.png");
    let Mask { width, height, mut ids } = read_mask(whole).unwrap();
    ids.truncate((width * (height - 1)) as usize);
    write_mask(&path, &Mask { width, height: height - 1, ids }).unwrap();
    let small = fs::read(&path).unwrap();
    let deep_color = image::Rgb([1u16, 2, 3]);
    image::ImageBuffer::from_pixel(width, height, deep_color).save(&path).unwrap();
    let colored = fs::read(&path).unwrap();
    let mut deep = fs::read(whole).unwrap();
    deep[24] = 32;
    let cut = fs::read(whole).unwrap()[..60].to_vec();
    vec![
        (small, vec!["128x71", "128x72"]),
        (colored, vec!["16 bits of Rgb", "8 or 16 bits of grey"]),
        (deep, vec!["cannot decode the mask"]),
        (cut, vec!["cannot decode the mask"]),
        (b"II*\0 a TIFF of 32 bits".to_vec(), vec!["cannot decode the mask"]),
    ]
}

/// Nothing is trained or written before masks are known to be good.
#[test]
fn masks_that_cannot_be_used_are_named_before_anything_is_trained() {
    if skips_gpu() {
        return;
    }
    let folder = Folder::new(&["cars", "--instances", "2"]);
    let mask = folder.masks()[3].clone();
    let name = mask.file_name().unwrap().to_str().unwrap();
    let whole = fs::read(&mask).unwrap();
    let both = |words: &[&str]| {
        for command in [&mut folder.train_all("run"), &mut folder.segment("segments")] {
            has_all(&error_of(command), words);
            assert!(!folder.path("run").exists() && !folder.path("segments").exists(), "{words:?}");
        }
    };
    for (bytes, words) in bad_masks(&mask) {
        fs::write(&mask, bytes).unwrap();
        both(&[&[name][..], &words].concat());
    }
    fs::write(&mask, whole).unwrap();

    let categories = folder.path("data/masks/categories.json");
    let names = fs::read(&categories).unwrap();
    fs::write(&categories, r#"{"70000": "car"}"#).unwrap();
    both(&["categories.json", "70000", "1 to 65535"]);
    fs::write(&categories, names).unwrap();

    let groups = folder.path("broken.json");
    fs::write(&groups, "[{").unwrap();
    has_all(&error_of(folder.train_all("run").arg("--groups").arg(&groups)), &["broken.json", "not valid JSON"]);
    assert!(!folder.path("run").exists());

    for mask in folder.masks() {
        let Mask { width, height, ids } = read_mask(&mask).unwrap();
        write_mask(&mask, &Mask { width, height, ids: vec![0; ids.len()] }).unwrap();
    }
    both(&["no training view has a mask with an object", "ids above 0"]);
    fs::rename(folder.path("data/masks"), folder.path("elsewhere")).unwrap();
    both(&["data: has no masks", "--masks"]);
    fs::create_dir(folder.path("data/masks")).unwrap();
    both(&["masks: has no masks", "a mask is a PNG"]);
}

/// Two views have no mask, and one of three cars has a name of its own: the other two are shared all the same.
#[test]
fn missing_masks_and_single_objects_are_told_and_the_rest_comes_out() {
    if skips_gpu() {
        return;
    }
    let folder = Folder::new(&["cars", "--instances", "3"]);
    let masks = folder.masks();
    let stem = |i: usize| masks[i].file_stem().unwrap().to_str().unwrap().to_owned();
    // The first is a test view's; that one is not missed.
    [0, 3, 5].iter().for_each(|&i| fs::remove_file(&masks[i]).unwrap());
    fs::write(folder.path("data/masks/categories.json"), r#"{"1": "car", "2": "lorry", "3": "car"}"#).unwrap();
    let views = format!("2 of 8 training views have no mask ({}, {})", stem(3), stem(5));
    let lorry = "lorry 2 stays in the background: the only lorry";
    let text = warnings_of(&mut folder.train("run"));
    has_all(&text, &[&views, lorry]);
    assert_eq!(text.matches(&views).count(), 1, "told once: {text}");
    let report = folder.report("run");
    has_all(&report["warnings"].to_string(), &[&views, lorry]);
    has_all(&fs::read_to_string(folder.path("run/report.html")).unwrap(), &["lorry 2 stays in the background"]);
    let scene = folder.scene("run/scene.instgs");
    assert_eq!((scene.instances.len(), scene.groups[0].instance_ids.contains(&2)), (2, false));
    has_all(&warnings_of(&mut folder.segment("segments")), &[&views]);
    has_all(&warnings_of(&mut folder.register("segments", "g.json")), &[lorry]);
}

/// A car and a chair: nothing is alike. The scene comes out as background, trained on like any other.
#[test]
fn a_scene_without_anything_alike_comes_out_as_background() {
    if skips_gpu() {
        return;
    }
    let folder = Folder::new(&["unrelated"]);
    let mut train = folder.train("run");
    let text = warnings_of(train.args(["--joint-steps", "60"]).env("INSTGS_VALIDATION", "1"));
    has_all(&text, &["nothing is shared", "no two objects are alike", "stays in the background"]);
    let report = folder.report("run");
    has_all(&report["warnings"].to_string(), &["nothing is shared"]);
    has_all(&fs::read_to_string(folder.path("run/report.html")).unwrap(), &["nothing is shared"]);
    let scene = folder.scene("run/scene.instgs");
    assert!(scene.instances.is_empty() && scene.templates.is_empty() && scene.background.len() > 1000);
    assert_ne!(scene.background, folder.scene("run/initial.instgs").background, "the joint phase trains it");
    let psnr = |report: &Value| report["eval"]["psnr"].as_f64().unwrap();
    assert!(psnr(&report) > psnr(&report["vanilla"]), "{} {}", report["eval"], report["vanilla"]["eval"]);
    // It is a scene like any other, and a run that can be gone on with.
    let mut resume = program();
    resume.args(["train", "--resume", "--joint-steps", "70", "--data"]).arg(folder.path("data"));
    resume.arg("--out").arg(folder.path("run")).assert().success();
    assert_eq!(folder.report("run")["steps"].as_u64(), Some(70));

    folder.segment("segments").assert().success();
    has_all(&warnings_of(&mut folder.register("segments", "g.json")), &["no two objects are alike", "g.json"]);
    has_all(&warnings_of(&mut folder.merge("segments", "g.json", "x.instgs")), &["nothing is shared"]);
    assert!(fs::read(folder.path("x.instgs")).unwrap() == fs::read(folder.path("run/initial.instgs")).unwrap());
}
