//! `instgs-vk edit` and the `.glb` export as a user runs them: edited scenes load, list, inspect, export and render.

use std::fs;
use std::path::PathBuf;

use assert_cmd::Command;
use glam::DVec3;
use instgs_io::{load_scene, save_scene};
use serde_json::Value;

use crate::common::chairs::chairs;
use crate::common::program::{error_of, program, skips_gpu};

fn json_of(command: &mut Command) -> Value {
    serde_json::from_slice(&command.assert().success().get_output().stdout).unwrap()
}

fn folder() -> (tempfile::TempDir, impl Fn(&str) -> PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().to_path_buf();
    save_scene(&root.join("room.instgs"), &chairs()).unwrap();
    (folder, move |name: &str| root.join(name))
}

#[test]
fn edits_are_done_in_order_and_the_result_loads() {
    let (_folder, at) = folder();
    let mut command = program();
    command.arg("edit").arg(at("room.instgs")).arg("--json").arg("--list").arg("--out").arg(at("new.instgs"));
    // Instance 0 goes first, so that 0 is id 7 afterwards.
    command.args(["--delete", "0", "--move", "0", "by=0,0,5", "--duplicate", "id:7", "by=-1,0,0", "yaw=90"]);
    command.args([
        "--recolour",
        "id:11",
        "rgb=0,0.2,0",
        "--scatter",
        "template=0",
        "count=2",
        "point=0,1,0",
        "extent=3,3",
    ]);
    let report = json_of(&mut command);
    let names: Vec<_> =
        report["operations"].as_array().unwrap().iter().map(|o| o["operation"].as_str().unwrap()).collect();
    assert_eq!(names, ["delete", "move", "duplicate", "recolour", "scatter"]);
    assert_eq!((report["instances"].as_u64(), report["gaussians"].as_u64()), (Some(5), Some(21)));
    assert_eq!(report["operations"][0]["removed"], serde_json::json!([0]));
    assert_eq!(report["operations"][4]["added"], serde_json::json!([3, 4]));
    let list = report["list"].as_array().unwrap();
    let column = |name: &str| list.iter().map(|row| row[name].clone()).collect::<Vec<_>>();
    assert_eq!(Value::from(column("id")), serde_json::json!([7, 11, 12, 13, 14]));
    assert_eq!(Value::from(column("offsets")), serde_json::json!(["shared", "own", "shared", "none", "none"]));
    let edited = load_scene(&at("new.instgs")).unwrap().scene;
    edited.validate().unwrap();
    assert_eq!((edited.offsets.len(), edited.groups[0].instance_ids.as_slice()), (8, [7, 11, 12, 13, 14].as_slice()));
    assert_eq!(edited.instances[0].world_from_template.translation(), DVec3::new(1.0, 0.0, 5.0));
    assert_eq!(load_scene(&at("room.instgs")).unwrap().scene, chairs(), "the original is left alone");
    let inspected = json_of(program().arg("inspect").arg(at("new.instgs")).arg("--json"));
    assert_eq!(inspected["gaussians"]["instances"], 5);
}

/// The template loses the same Gaussians in all instances, offsets follow, and what cannot be done is said.
#[test]
fn templates_are_cropped_and_erased_once_for_all() {
    let (_folder, at) = folder();
    let mut command = program();
    command.arg("edit").arg(at("room.instgs")).arg("--json").arg("--out").arg(at("new.instgs"));
    // Means: (0.1, 0, 0), (-0.1, 0, 0), (0, -0.2, 0.1), (0, -0.4, -0.1).
    command.args(["--crop", "template=0", "box=-inf,-0.3,-1/inf,1,1"]);
    command.args(["--erase", "template=0", "at=5,5,5/-0.1,0.02,0", "radius=0.05"]);
    let report = json_of(&mut command);
    assert_eq!((report["instances"].as_u64(), report["gaussians"].as_u64()), (Some(3), Some(3 * 2 + 1)));
    for (k, name) in ["crop", "erase"].into_iter().enumerate() {
        let done = &report["operations"][k];
        assert_eq!((&done["operation"], &done["changed"]), (&name.into(), &serde_json::json!([0, 1, 2])));
    }
    let (before, edited) = (chairs(), load_scene(&at("new.instgs")).unwrap().scene);
    edited.validate().unwrap();
    assert_eq!(edited.templates.means, [before.templates.means[0], before.templates.means[2]]);
    assert_eq!((edited.offsets.len(), edited.instances[1].first_offset), (4, Some(2)));
    // What is left looks as it did.
    let (was, is) = (before.flatten(), edited.flatten());
    assert_eq!(is, was.filtered(|i| i == 12 || [0, 2].contains(&(i % 4))));

    let error = |arguments: &[&str]| {
        let mut command = program();
        command.arg("edit").arg(at("room.instgs")).args(arguments).arg("--out").arg(at("no.instgs"));
        let text = error_of(&mut command);
        assert!(!at("no.instgs").exists());
        text
    };
    for (arguments, want) in [
        (["--crop", "template=0", "box=5,5,5/6,6,6"], "--crop: all 4 Gaussians of template 0 would be removed"),
        (["--crop", "template=3", "box=0,0,0/1,1,1"], "--crop: there is no template 3: the only one is 0"),
        (["--crop", "template=0", "box=1,0,0/0,1,1"], "--crop: no box reaches from"),
        (["--crop", "template=0", "box=0,0,0"], "--crop: box=0,0,0: want the lower and the upper corner"),
        (["--erase", "template=0", "at=0,0,0"], "--erase: radius=... is missing"),
    ] {
        let text = error(&arguments);
        assert!(text.contains(want), "{text}");
    }
    let text = error(&["--erase", "template=0", "at=0,0,0", "radius=-1"]);
    assert!(text.contains("--erase: -1 is not a radius"), "{text}");
    let mut command = program();
    command.arg("edit").arg(at("room.instgs")).args(["--erase", "template=0", "at=9,9,9", "radius=1", "--out"]);
    let output = command.arg(at("same.instgs")).assert().success().get_output().clone();
    let warning = String::from_utf8(output.stderr).unwrap();
    assert!(warning.contains("--erase: no Gaussian of template 0 is in the region to remove"), "{warning}");
    assert_eq!(load_scene(&at("same.instgs")).unwrap().scene, before);
}

#[test]
fn lists_and_reports_in_words() {
    let (_folder, at) = folder();
    let text_of = |arguments: &[&str]| {
        let mut command = program();
        command.arg("edit").arg(at("room.instgs")).args(arguments);
        String::from_utf8(command.assert().success().get_output().stdout.clone()).unwrap()
    };
    let list = text_of(&["--list"]);
    assert!(list.contains("instance") && list.contains("chair") && list.contains("2.000,-0.150,0.000"), "{list}");
    assert!(list.contains("3 instances, 13 Gaussians expanded"), "{list}");
    let out = at("x.instgs");
    let words =
        text_of(&["--rotate", "group:chair", "yaw=10", "--swap", "0", "template=0", "--out", out.to_str().unwrap()]);
    assert!(
        words.contains("rotate: changed 3 instances, 0 to 2") && words.contains("swap: changed no instance"),
        "{words}"
    );
}

#[test]
fn mistakes_are_named_and_nothing_is_written() {
    let (_folder, at) = folder();
    let error = |arguments: &[&str]| {
        let mut command = program();
        command.arg("edit").arg(at("room.instgs")).args(arguments).arg("--out").arg(at("no/such.instgs"));
        let text = error_of(&mut command);
        assert!(!at("no").exists(), "{arguments:?}");
        text
    };
    for (arguments, want) in [
        (vec!["--delete", "3"], "--delete: there is no instance 3: there are 0 to 2"),
        (vec!["--move", "id:4", "by=1,0,0"], "--move: there is no instance with id 4: ids are 3, 7, 11"),
        (vec!["--recolour", "group:sofa", "rgb=0,0,1"], "--recolour: there is no instance of a group \"sofa\""),
        (vec!["--swap", "0", "template=5"], "--swap: there is no template 5: the only one is 0"),
        (vec!["--delete", "0", "--scale", "0", "by=0"], "--scale: 0 is not a scale"),
        (vec!["--move", "0"], "--move: want either by"),
        (vec![], "no operation is given"),
    ] {
        let text = error(&arguments);
        assert!(text.contains(want), "{text}");
    }
    let text = error_of(program().arg("edit").arg(at("room.instgs")).args(["--delete", "0", "--list"]));
    assert!(text.contains("--out"), "{text}");
    let text = error_of(program().arg("edit").arg(at("none.instgs")).arg("--list"));
    assert!(text.contains("none.instgs"), "{text}");
    // Mirror images are of a group of their own, and the first has no instances any more.
    let mirror = ["--mirror", "group:chair", "axis=1,0,0"];
    let text = error(&[mirror, mirror].concat());
    assert!(text.contains("no instance of a group \"chair\": groups are chair mirrored"), "{text}");
    program().args(["edit", "room.instgs"]).assert().code(2);
    program().args(["edit", "room.instgs", "--delete", "--out", "x.instgs"]).assert().code(2);
}

#[test]
fn an_edited_scene_becomes_a_glb() {
    let (_folder, at) = folder();
    let edit = |arguments: &[&str]| {
        let mut command = program();
        command.arg("edit").arg(at("room.instgs")).args(arguments).arg("--out").arg(at("new.instgs"));
        command.assert().success();
    };
    edit(&["--duplicate", "id:3", "by=0,0,2"]);
    // The folder of a new scene is made.
    let mut moved = program();
    moved.arg("edit").arg(at("room.instgs")).args(["--delete", "id:3", "--out"]).arg(at("a/new/folder.instgs"));
    moved.assert().success();
    let export = |up: &[&str]| {
        let mut command = program();
        command.args(["export", "--scene"]).arg(at("new.instgs")).arg("--to").arg(at("x.glb")).arg("--json").args(up);
        json_of(&mut command)
    };
    let report = export(&[]);
    let bytes = fs::read(at("x.glb")).unwrap();
    assert_eq!((report["bytes"].as_u64(), report["flattened_instances"].as_u64()), (Some(bytes.len() as u64), Some(0)));
    let container = gltf::Glb::from_slice(&bytes).unwrap();
    let json: Value = serde_json::from_slice(&container.json).unwrap();
    // Two runs of offsets, the bare template, the background; the duplicate is the same mesh as its original.
    assert_eq!((json["meshes"].as_array().unwrap().len(), json["nodes"].as_array().unwrap().len()), (4, 6));
    assert_eq!(json["nodes"][1]["mesh"], json["nodes"][4]["mesh"]);
    assert_eq!(json["nodes"][4]["name"], "chair 12");
    assert_eq!(json["nodes"][0]["rotation"][0].as_f64().map(f64::abs), Some(1.0), "y is down: half a turn about x");
    export(&["--up", "0,1,0"]);
    let upright = gltf::Glb::from_slice(&fs::read(at("x.glb")).unwrap()).unwrap().json.into_owned();
    let json: Value = serde_json::from_slice(&upright).unwrap();
    assert_eq!(json["nodes"][0]["rotation"], serde_json::json!([0.0, 0.0, 0.0, 1.0]));
}

#[test]
fn an_edited_scene_renders() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    let arguments =
        ["--delete", "id:3", "--scatter", "template=0", "count=3", "path=0,0,1/2,0,1", "offsets=shared:id:7"];
    program().arg("edit").arg(at("room.instgs")).args(arguments).arg("--out").arg(at("new.instgs")).assert().success();
    let picture = |scene: &str| {
        let mut command = program();
        command
            .env("INSTGS_VALIDATION", "1")
            .args(["render", "--orbit", "1", "--size", "64x48", "--up", "0,-1,0", "--scene"]);
        command.arg(at(scene)).arg("--out").arg(at("pictures")).assert().success();
        fs::read(at("pictures").join("000.png")).unwrap()
    };
    assert_ne!(picture("new.instgs"), picture("room.instgs"));
}

/// What is written is in full: a packed scene, or one in pages, is said to be one no longer.
#[test]
fn edits_of_packed_scenes_say_what_is_lost() {
    let (_folder, at) = folder();
    let said = |scene: &str| {
        let mut command = program();
        command.arg("edit").arg(at(scene)).args(["--move", "0", "by=0,0,5", "--out"]).arg(at(scene));
        let output = command.assert().success().get_output().clone();
        [output.stdout, output.stderr].map(|bytes| String::from_utf8(bytes).unwrap())
    };
    for (name, pack) in [("small.instgs", &["small"][..]), ("pages.instgs", &["f16", "--pages"])] {
        let mut export = program();
        export.args(["export", "--scene"]).arg(at("room.instgs")).arg("--to").arg(at(name)).arg("--pack").args(pack);
        export.assert().success();
        let [_, warning] = said(name);
        let want = format!("was written with --pack {}, and this is not", pack.join(" "));
        assert!(warning.contains(&want), "{warning}");
    }
    let [text, warning] = said("room.instgs");
    assert!(warning.is_empty() && text.trim_end().ends_with(" bytes"), "{text} {warning}");
}
