//! `instgs-vk synth` as a user runs it, read back with the library's readers.

use crate::program::built;
use std::fs;

use assert_cmd::Command;
use instgs_io::dataset::Split;
use instgs_io::groups::read_groups;
use instgs_io::{load_view, read_points, read_views};
use serde_json::Value;

fn synth(args: &[&str]) -> Command {
    let mut command = Command::new(built("instgs-vk"));
    command.arg("synth").args(args);
    command
}

#[test]
fn a_tiny_data_set_is_read_back() {
    let folder = tempfile::tempdir().unwrap();
    let out = folder.path().join("deep/facade");
    let options = ["--views", "10", "--size", "33x19", "--instances", "5", "--pose-noise", "2:0.02", "--json"];
    let mut command = synth(&["facade", "--out", out.to_str().unwrap()]);
    let output = command.args(options).assert().success().get_output().clone();
    let report: Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!((&report["views"], &report["groups"][0]["instances"]), (&10.into(), &5.into()));
    let dataset = read_views(&out).unwrap();
    assert_eq!((dataset.views.len(), dataset.split(Split::Test).count()), (10, 2));
    for view in &dataset.views {
        let loaded = load_view(view, None).unwrap();
        assert_eq!((loaded.image.width, loaded.image.height), (33, 19));
        assert!(out.join("masks").join(format!("{}.png", view.camera.name)).is_file());
        assert!(out.join("depth").join(format!("{}.ktx2", view.camera.name)).is_file());
    }
    assert!(read_points(&out).unwrap().unwrap().points.len() > 1000);
    let [truth, noisy] = ["groups.json", "groups_noisy.json"].map(|file| read_groups(&out.join(file)).unwrap());
    assert_eq!((truth.len(), truth[0].instances.len(), noisy[0].instances.len()), (1, 5, 5));
    assert_ne!(truth, noisy);
    // Again into the same folder, but not into one that holds something else.
    synth(&["facade", "--out", out.to_str().unwrap(), "--views", "2", "--size", "8x8"]).assert().success();
    assert_eq!(read_views(&out).unwrap().views.len(), 2);
    assert_eq!(fs::read_dir(out.join("images")).unwrap().count(), 2);
}

#[test]
fn failures_are_one_line() {
    let folder = tempfile::tempdir().unwrap();
    fs::write(folder.path().join("diary.txt"), "mine").unwrap();
    let out = folder.path().to_str().unwrap();
    for (args, words) in [
        (vec!["castle", "--out", out], "cars, hall, orchard, facade, unrelated"),
        (vec!["cars", "--out", out], "not empty"),
        (vec!["cars", "--out", out, "--instances", "65"], "2 to 64"),
    ] {
        let output = synth(&args).assert().code(1).get_output().clone();
        let text = String::from_utf8(output.stderr).unwrap();
        assert!(text.starts_with("error: ") && text.lines().count() == 1 && text.contains(words), "{text}");
    }
    for wrong in [["--size", "0x5"], ["--views", "1"], ["--pose-noise", "2"]] {
        synth(&["cars", "--out", out]).args(wrong).assert().code(2);
    }
}
