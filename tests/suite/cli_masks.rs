//! `masks`, and `train` with masks that it makes for itself, as a user runs them.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use instgs_io::{load_scene, read_boxes, read_mask, write_boxes};
use instgs_vk::scene::{Boxes, ViewBox};

use super::cli_stages::{Folder, has_all, json_of, warnings_of};
use crate::common::program::{error_of, program, skips_gpu};
use crate::onnx::{has_onnxruntime, models_folder};

fn masks(folder: &Folder, source: &[&str], out: &str) -> assert_cmd::Command {
    let mut command = program();
    command.arg("masks").arg("--data").arg(folder.path("data")).args(source).arg("--out").arg(folder.path(out));
    command
}

/// Boxes around the true masks, a pixel wider on every side.
fn true_boxes(folder: &Folder) -> Boxes {
    let mut boxes = Boxes::default();
    for path in folder.masks() {
        let mask = read_mask(&path).unwrap();
        let mut sides: BTreeMap<u16, [u32; 4]> = BTreeMap::new();
        for (i, &id) in (0..).zip(&mask.ids).filter(|&(_, &id)| id != 0) {
            let (x, y) = (i % mask.width, i / mask.width);
            let [left, top, right, bottom] = sides.entry(id).or_insert([x, y, x, y]);
            (*left, *top) = (x.min(*left), y.min(*top));
            (*right, *bottom) = (x.max(*right), y.max(*bottom));
        }
        let view_box = |(id, [left, top, right, bottom]): (u16, [u32; 4])| {
            let box_px = [f64::from(left) - 1.0, f64::from(top) - 1.0, f64::from(right) + 2.0, f64::from(bottom) + 2.0];
            ViewBox { id: Some(id.into()), category: Some("car".into()), score: None, box_px }
        };
        let name = path.file_stem().unwrap().to_string_lossy().into_owned();
        boxes.views.insert(name, sides.into_iter().map(view_box).collect());
    }
    boxes
}

/// Intersection by union of what two folders of masks show as an object, whatever its number.
fn overlap(a: &Path, b: &Path) -> f64 {
    let (mut both, mut either) = (0, 0);
    for entry in fs::read_dir(a).unwrap() {
        let path = entry.unwrap().path();
        if path.extension().is_some_and(|e| e == "png") {
            let (one, other) = (read_mask(&path).unwrap(), read_mask(&b.join(path.file_name().unwrap())).unwrap());
            assert_eq!((one.width, one.height), (other.width, other.height));
            for (&a, &b) in one.ids.iter().zip(&other.ids) {
                both += u32::from(a != 0 && b != 0);
                either += u32::from(a != 0 || b != 0);
            }
        }
    }
    f64::from(both) / f64::from(either)
}

/// Boxes in place of masks: the cloud says what in a box is the car, and the whole pipeline goes on from that.
#[test]
fn boxes_take_the_place_of_masks() {
    if skips_gpu() {
        return;
    }
    let folder = Folder::new(&["cars", "--instances", "3"]);
    let boxes = folder.path("boxes.json");
    write_boxes(&boxes, &true_boxes(&folder)).unwrap();
    let (file, cloud) = (boxes.display().to_string(), folder.cloud().display().to_string());
    let source = ["--boxes", file.as_str(), "--scene", cloud.as_str()];
    let report = json_of(masks(&folder, &source, "made").env("INSTGS_VALIDATION", "1"));
    let objects = report["objects"].as_array().unwrap();
    assert_eq!(objects.len(), 3);
    assert!(objects.iter().all(|o| o["gaussians"].as_u64() > Some(10) && o["category"] == "car"), "{report}");
    // A cloud trained for a moment has blurred cars; boxes as masks would reach 0.4.
    let reached = overlap(&folder.path("data/masks"), &folder.path("made"));
    println!("masks from boxes: intersection by union {reached:.3}");
    assert!(reached > 0.6, "{reached}");
    has_all(&fs::read_to_string(folder.path("made/review.html")).unwrap(), &["car", "Views", "data:image/jpeg"]);
    let text = error_of(&mut masks(&folder, &source, "made"));
    has_all(&text, &["made", "holds masks already"]);

    fs::remove_dir_all(folder.path("data/masks")).unwrap();
    let mut other = read_boxes(&boxes).unwrap();
    other.views.insert("nowhere".into(), other.views.values().next().unwrap().clone());
    write_boxes(&boxes, &other).unwrap();
    let warnings = warnings_of(folder.train("run").args(["--boxes", &file]));
    // Not of the test views.
    has_all(&warnings, &["belong to 1 views that are not used", "nowhere"]);
    assert!(folder.path("run/masks/categories.json").is_file());
    assert!(!load_scene(&folder.path("run/scene.instgs")).unwrap().scene.instances.is_empty());
    let page = fs::read_to_string(folder.path("run/review.html")).unwrap();
    has_all(&page, &["objects", "car 1"]);
    // Goes on without making them again.
    let made = fs::metadata(folder.path("run/masks/categories.json")).unwrap().modified().unwrap();
    folder.train("run").args(["--resume", "--boxes", &file]).assert().success();
    assert_eq!(fs::metadata(folder.path("run/masks/categories.json")).unwrap().modified().unwrap(), made);
    // Objects stay those of the boxes that they were found by.
    let text = fs::read_to_string(&boxes).unwrap();
    fs::write(&boxes, format!("{text}\n")).unwrap();
    let text = error_of(folder.train("run").args(["--resume", "--boxes", &file]));
    has_all(&text, &["boxes.json", "has changed since the objects of"]);
    // Boxes in the wrong place are found out before the cloud is trained, or when they have caught nothing.
    let nowhere = r#"{"objects": [{"id": 1, "center": [900, 0, 0], "size": [1, 1, 1]}]}"#;
    fs::write(folder.path("nowhere.json"), nowhere).unwrap();
    let lost = folder.path("nowhere.json").display().to_string();
    let text = error_of(folder.train("lost").args(["--boxes", &lost]));
    has_all(&text, &["no Gaussian is in a box of an object", "object 1", "same place and frame"]);
    fs::write(folder.path("nowhere.json"), r#"{"views": {"view_001": []}}"#).unwrap();
    let text = error_of(folder.train("unused").args(["--boxes", &lost]));
    has_all(&text, &["nowhere.json", "no box is of an object"]);
    assert!(!folder.path("unused").exists(), "nothing was trained");
    let text = error_of(folder.train("other").args(["--boxes", "none.json"]));
    has_all(&text, &["none.json"]);
    other.views.retain(|name, _| name == "nowhere");
    write_boxes(&boxes, &other).unwrap();
    let text = error_of(folder.train("other").args(["--boxes", &file]));
    has_all(&text, &["boxes.json", "none in a photo of a training view"]);
    let text = error_of(folder.train("other").args(["--boxes", &file, "--set", "prompt=car."]));
    has_all(&text, &["boxes and prompt"]);
}

/// Models of random weights find nonsense; but all that is asked of files is there, and the pipeline goes on from it.
#[test]
fn words_take_the_place_of_masks() {
    if skips_gpu() || !has_onnxruntime() {
        return;
    }
    let folder = Folder::new(&["cars", "--instances", "2"]);
    let models = models_folder().display().to_string();
    let source = ["--prompt", "Car. potted plant.", "--models", models.as_str()];
    let report = json_of(&mut masks(&folder, &source, "made"));
    let boxes = read_boxes(&folder.path("made/boxes.json")).unwrap();
    assert_eq!(boxes.views.len(), 10);
    let ids: Vec<u32> = boxes.views.values().flatten().map(|b| b.id.unwrap()).collect();
    assert_eq!(ids.len() as u64, report["masks"].as_u64().unwrap());
    assert!(!ids.is_empty(), "nothing found: the test says nothing");
    for (name, of_view) in &boxes.views {
        let mask = read_mask(&folder.path(&format!("made/{name}.png"))).unwrap();
        assert_eq!((mask.width, mask.height), (128, 72));
        let mut of_view: Vec<u16> = of_view.iter().map(|b| b.id.unwrap() as u16).collect();
        of_view.sort_unstable();
        assert_eq!(mask.ids_present().into_keys().collect::<Vec<_>>(), of_view, "{name}");
    }
    assert!(folder.path("made/review.html").is_file());

    fs::remove_dir_all(folder.path("data/masks")).unwrap();
    folder.train("run").args(source).assert().success();
    assert!(folder.path("run/masks/boxes.json").is_file() && folder.path("run/scene.instgs").is_file());
    let report: serde_json::Value = serde_json::from_slice(&fs::read(folder.path("run/report.json")).unwrap()).unwrap();
    assert!(report["stages"].as_array().unwrap().iter().any(|stage| stage["name"] == "masks"), "{}", report["stages"]);
}

#[test]
fn what_is_missing_is_said() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let models = models_folder().display().to_string();
    let masks = |data: &Path, source: &[&str]| {
        let mut command = program();
        command.arg("masks").arg("--data").arg(data).args(source).arg("--out").arg(at.join("out"));
        error_of(&mut command)
    };
    has_all(&masks(&at.join("none"), &["--prompt", "car.", "--models", &models]), &["none"]);
    let mut synth = program();
    synth.args(["synth", "cars", "--instances", "2", "--views", "2", "--size", "32x18", "--out"]).arg(at.join("data"));
    synth.assert().success();
    let data = at.join("data");
    has_all(&masks(&data, &["--prompt", "car."]), &["--models", "tools/models"]);
    has_all(&masks(&data, &["--prompt", "...", "--models", &models]), &["names nothing"]);
    has_all(&masks(&data, &["--prompt", "car.", "--models", "none"]), &["models.json", "export_grounding_dino.py"]);
    let runtime = ["--prompt", "car.", "--models", &models, "--runtime", "none.so"];
    has_all(&masks(&data, &runtime), &["none.so", "tools/setup_onnxruntime"]);
    has_all(&masks(&data, &["--boxes", "none.json"]), &["--scene"]);
    has_all(&masks(&data, &["--boxes", "none.json", "--scene", "none.ply"]), &["none.json"]);
    assert!(!at.join("out").exists(), "a failed call leaves a folder");
    let mut page = program();
    page.arg("masks").arg("--data").arg(&data).arg("--masks").arg(data.join("masks")).arg("--out").arg(at.join("page"));
    let said = page.arg("--json").output().unwrap();
    let report: serde_json::Value = serde_json::from_slice(&said.stdout).unwrap();
    assert_eq!(report, serde_json::json!({ "views": 2, "page": at.join("page/review.html") }));
    assert_eq!(fs::read_to_string(at.join("page/review.html")).unwrap().matches("<img").count(), 2);
}
