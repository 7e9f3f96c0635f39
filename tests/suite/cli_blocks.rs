//! `split` and `join` as a user runs them: a car park in two blocks, trained for a few steps by the list of commands.

use std::fs;
use std::path::Path;
use std::process::Command as Process;

use crate::common::program::{built, error_of, program, skips_gpu};
use crate::made_once::synth;
use instgs_blocks::Plan;
use instgs_io::{Split, load_scene, read_views};
use instgs_vk::math::sh::widened;
use serde_json::Value;

/// Eight cars in 24 small photos, below `folder/a lot`: a name with a space.
fn lot(folder: &Path) {
    synth(&["lot", "--views", "24", "--size", "96x54", "--instances", "8"], &folder.join("a lot"));
}

fn json(command: &mut assert_cmd::Command) -> Value {
    serde_json::from_slice(&command.assert().success().get_output().stdout).unwrap()
}

fn split(folder: &Path, more: &[&str]) -> assert_cmd::Command {
    let mut command = program();
    command.arg("split").arg(folder.join("a lot")).arg("--out").arg(folder.join("blocks")).args(more);
    command
}

/// Without a device: blocks are data sets that the reader takes, with the photos where they were.
#[test]
fn blocks_are_data_sets_of_the_same_photos() {
    let folder = tempfile::tempdir().unwrap();
    lot(folder.path());
    let said = json(&mut split(folder.path(), &["--blocks", "3", "--json"]));
    assert_eq!(said["blocks"].as_array().unwrap().len(), 3);
    let whole = read_views(&folder.path().join("a lot")).unwrap();
    let mut seen = std::collections::BTreeSet::new();
    for block in said["blocks"].as_array().unwrap() {
        let own = folder.path().join("blocks").join(block["name"].as_str().unwrap());
        let views = read_views(&own).unwrap();
        assert_eq!(views.split(Split::Train).count() as u64, block["train_views"].as_u64().unwrap());
        for view in &views.views {
            let same = whole.views.iter().find(|other| other.camera.name == view.camera.name).unwrap();
            assert_eq!(view.split, same.split);
            let file = |path: &Path| fs::canonicalize(path).unwrap();
            assert_eq!(file(&view.image_path), file(&same.image_path));
            let pairs = view.camera.view_from_world.iter().flatten().zip(same.camera.view_from_world.iter().flatten());
            assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-9));
            seen.insert(view.camera.name.clone());
        }
        assert!(own.join("masks/categories.json").is_file());
        let pictures = fs::read_dir(&own).unwrap().filter(|e| e.as_ref().unwrap().path().is_dir()).count();
        assert_eq!(pictures, 1, "nothing but the link to the masks");
    }
    assert_eq!(seen.len(), whole.views.len());
    // The same again changes nothing; another division needs another folder.
    split(folder.path(), &["--blocks", "3"]).assert().success();
    assert!(error_of(&mut split(folder.path(), &["--blocks", "2"])).contains("divided in another way"));
    let text = error_of(&mut split(folder.path(), &["--blocks", "9000"]));
    assert!(text.contains("too few for 9000 blocks") && text.contains("fewer blocks"), "{text}");
}

/// The whole way. Every part of the scene comes from the block that owns it, and all cars share one template.
#[test]
fn two_blocks_become_one_scene_with_one_template() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    lot(folder.path());
    let groups = folder.path().join("a lot/groups.json").display().to_string();
    let mut blocks = split(folder.path(), &["--blocks", "2", "--emit-jobs", "--json", "--"]);
    blocks.args(["--config", "instgs_quick", "--steps", "250", "--joint-steps", "60", "--max-gaussians", "4000"]);
    blocks.args(["--groups", &groups]);
    json(&mut blocks);
    let out = folder.path().join("blocks");
    let jobs = fs::read_to_string(out.join("jobs.txt")).unwrap();
    assert_eq!(jobs.lines().count(), 2);
    // As a shell runs it, with this program in the path.
    let path = std::env::join_paths([built("instgs-vk").parent().unwrap(), Path::new("/usr/bin"), Path::new("/bin")]);
    let train = |line: &str| {
        let output = Process::new("sh").args(["-c", line]).env("PATH", path.as_ref().unwrap()).output().unwrap();
        assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
    };
    jobs.lines().for_each(train);
    let scenes = [0, 1].map(|b| out.join(format!("block_0{b}/run/scene.instgs")));
    let before = scenes.each_ref().map(|scene| fs::read(scene).unwrap());
    // A finished block is not trained again.
    jobs.lines().take(1).for_each(train);
    assert_eq!(fs::read(&scenes[0]).unwrap(), before[0]);
    let joined = folder.path().join("lot.instgs");
    let join = |more: &[&str], runs: &[&str]| {
        let mut command = program();
        command.arg("join").args(runs.iter().map(|run| out.join(run))).arg("--out").arg(&joined).args(more);
        command
    };
    assert!(error_of(&mut join(&[], &["block_00/run"])).contains("no run of this block is given"));
    let both = ["block_00/run", "block_01/run"];
    let said = json(&mut join(&["--json"], &both));
    let scene = load_scene(&joined).unwrap().scene;
    let [left, right] = scenes.each_ref().map(|scene| load_scene(scene).unwrap().scene);
    println!("{said}");
    assert_eq!((scene.template_ranges.len(), scene.groups.len()), (1, 1), "{said}");
    assert_eq!(scene.groups[0].name.as_deref(), Some("car"));
    assert!((7..=9).contains(&scene.instances.len()), "{said}");
    assert_eq!(said["instances"].as_u64(), Some(scene.instances.len() as u64));
    assert!(scene.templates == left.templates || scene.templates == right.templates);
    // No two cars at one place, and every Gaussian of the background is its owner's.
    for (k, a) in scene.instances.iter().enumerate() {
        for b in &scene.instances[k + 1..] {
            let apart = a.world_from_template.translation().distance(b.world_from_template.translation());
            assert!(apart > 1.0, "{apart}");
        }
    }
    let plan = Plan::read(&out).unwrap();
    let owned = |b: usize, cloud: &instgs_vk::scene::Gaussians| {
        cloud.means.iter().filter(|m| plan.owner(plan.ground.flat(widened(**m))) == Some(b)).count()
    };
    for (b, of) in [&left, &right].into_iter().enumerate() {
        let counts = &said["blocks"][b];
        let kept = counts["background"].as_u64().unwrap() + counts["covered"].as_u64().unwrap();
        assert_eq!(owned(b, &of.background) as u64, kept);
        assert_eq!(owned(b, &scene.background) as u64, counts["background"].as_u64().unwrap());
    }
    // Refined on the whole data set: another scene of the same parts, no worse on photos that were never trained on.
    let run = folder.path().join("refined").display().to_string();
    let psnr = || {
        let mut command = program();
        command.arg("eval").arg("--scene").arg(&joined).arg("--data").arg(folder.path().join("a lot")).arg("--json");
        json(&mut command)["mean"]["psnr"].as_f64().unwrap()
    };
    let unrefined = psnr();
    join(&["--refine", &run, "--refine-steps", "40"], &both).assert().success();
    let refined = load_scene(&joined).unwrap().scene;
    assert_eq!((refined.instances.len(), refined.template_ranges.len()), (scene.instances.len(), 1));
    println!("joined {unrefined:.2} dB, refined {:.2} dB", psnr());
    assert!(psnr() > unrefined - 0.1);
    // Again: it is done, and stays as it is. Another run's folder is not touched.
    join(&["--refine", &run, "--refine-steps", "40"], &both).assert().success();
    assert!(load_scene(&joined).unwrap().scene == refined);
    let other = out.join("block_00/run").display().to_string();
    // Before anything is joined, so that nothing is said of that.
    assert!(error_of(&mut join(&["--refine", &other], &both)).contains("holds another run"));
}
