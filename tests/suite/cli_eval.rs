//! `instgs-vk eval` as a user runs it, on photos that the program itself rendered.

use std::fs;
use std::path::{Path, PathBuf};

use crate::common::dataset::transforms;
use crate::common::program::{built, error_of, skips_gpu};
use assert_cmd::Command;
use glam::DVec3;
use instgs_io::{write_cameras, write_ply};
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::{Camera, Gaussians, PixelFilter};
use serde_json::Value;

const VIEWS: usize = 9;
const SIZE: (u32, u32) = (64, 48);
/// Test views of a dataset without a split of its own: every eighth.
const TEST_VIEWS: [&str; 2] = ["v0", "v8"];

/// The program under the validation layers, without weights in the user's data folder.
fn program(at: &Path) -> Command {
    let mut command = Command::new(built("instgs-vk"));
    command.env("INSTGS_VALIDATION", "1").env("XDG_DATA_HOME", at.join("user"));
    command
}

/// Coloured blobs around the origin, moved by `shift`.
fn blobs(shift: f32) -> Gaussians {
    let mut rng = Rng::new(3);
    let mut cloud = Gaussians::with_capacity(0, 60);
    for _ in 0..60 {
        cloud.means.push([0; 3].map(|_| rng.range(-0.8, 0.8) as f32 + shift));
        cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
        cloud.log_scales.push([rng.range(0.05, 0.2).ln() as f32; 3]);
        cloud.opacity_logits.push(2.0);
        cloud.sh.push([0; 3].map(|_| rng.range(-1.5, 1.5) as f32));
    }
    cloud
}

fn cameras() -> Vec<Camera> {
    let camera = |i: usize| {
        let turn = 0.7 * i as f64;
        let eye = DVec3::new(3.0 * turn.sin(), -0.5, -3.0 * turn.cos());
        Camera::look_at(&format!("v{i}"), eye, DVec3::ZERO, DVec3::NEG_Y, 0.8, SIZE)
    };
    (0..VIEWS).map(camera).collect()
}

/// A folder with `scene.ply`, `shifted.ply` and the dataset `data` of pictures of the former.
fn folder() -> (tempfile::TempDir, PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path().to_path_buf();
    write_ply(&at.join("scene.ply"), &blobs(0.0), PixelFilter::default()).unwrap();
    write_ply(&at.join("shifted.ply"), &blobs(0.05), PixelFilter::default()).unwrap();
    write_cameras(&at.join("cameras.json"), &cameras()).unwrap();
    let mut render = program(&at);
    render.args(["render", "--scene"]).arg(at.join("scene.ply")).arg("--camera").arg(at.join("cameras.json"));
    render.arg("--out").arg(at.join("data/images")).assert().success();
    fs::write(at.join("data/transforms.json"), transforms(&cameras()).to_string()).unwrap();
    (folder, at)
}

fn eval(at: &Path, scene: &str, more: &[&str]) -> Command {
    let mut command = program(at);
    command.args(["eval", "--scene"]).arg(at.join(scene)).arg("--data").arg(at.join("data")).args(more);
    command
}

/// Report and stderr of `eval --json`.
fn report_of(command: &mut Command) -> (Value, String) {
    let output = command.arg("--json").assert().success().get_output().clone();
    (serde_json::from_slice(&output.stdout).unwrap(), String::from_utf8(output.stderr).unwrap())
}

fn mean(report: &Value, metric: &str) -> f64 {
    report["mean"][metric].as_f64().unwrap()
}

fn names(report: &Value) -> Vec<&str> {
    report["views"].as_array().unwrap().iter().map(|v| v["name"].as_str().unwrap()).collect()
}

#[test]
fn own_pictures_are_good_and_a_shifted_scene_is_not() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    let (own, warning) = report_of(&mut eval(&at, "scene.ply", &[]));
    assert_eq!(names(&own), TEST_VIEWS);
    // Measured: 60.0 dB and 0.9998. Photos in 8 bits cost that much: noise of 1/255 / sqrt 12 is 58.9 dB, and black
    // is exact.
    assert!((55.0..65.0).contains(&mean(&own, "psnr")) && mean(&own, "ssim") > 0.999, "{own}");
    let fields: Vec<&String> = own["views"][0].as_object().unwrap().keys().collect();
    assert_eq!(fields, ["lpips", "name", "psnr", "ssim"]);
    assert_eq!(own["mean"].as_object().unwrap().keys().collect::<Vec<_>>(), ["lpips", "psnr", "ssim"]);
    assert_eq!(own.as_object().unwrap().keys().collect::<Vec<_>>(), ["mean", "views"]);
    // Without weights: null, and one line with the missing file and the command that makes it.
    assert!(own["mean"]["lpips"].is_null() && own["views"][0]["lpips"].is_null());
    let file = at.join("user/instgs-vk/lpips_alex.safetensors");
    let command = format!("python3 tools/models/convert_lpips.py --net alex --out {}", file.display());
    assert!(warning.lines().count() == 1 && warning.contains(&command), "{warning}");

    let (shifted, _) = report_of(&mut eval(&at, "shifted.ply", &[]));
    // Measured: 26.6 dB and 0.903.
    assert!(mean(&shifted, "psnr") < 30.0 && mean(&shifted, "ssim") < 0.98, "{shifted}");
    let (all, _) = report_of(&mut eval(&at, "scene.ply", &["--split", "all"]));
    assert_eq!(names(&all).len(), VIEWS);
    let (other, _) = report_of(&mut eval(&at, "scene.ply", &["--background", "1,1,1"]));
    assert!(mean(&other, "psnr") < 20.0, "the background flag was not felt");
}

/// Pictures have the names of their views: in the folder of the photos they would replace them.
#[test]
fn photos_and_masks_are_not_written_over() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    let photo = fs::read(at.join("data/images/v0.png")).unwrap();
    fs::create_dir(at.join("data/masks")).unwrap();
    fs::write(at.join("data/masks/v0.png"), &photo).unwrap();
    for out in ["data/images", "data/masks", "data/new/../images"] {
        fs::create_dir_all(at.join("data/new")).unwrap();
        let mut render = program(&at);
        render.args(["render", "--scene"]).arg(at.join("shifted.ply")).arg("--data").arg(at.join("data"));
        let text = error_of(render.arg("--out").arg(at.join(out)));
        assert!(text.contains("v0.png: is a photo or a mask of the data set"), "{text}");
        let text = error_of(eval(&at, "shifted.ply", &[]).arg("--out").arg(at.join(out)));
        assert!(text.contains("choose another folder by --out"), "{text}");
    }
    // Masks of pixels may be anywhere.
    fs::create_dir(at.join("counts")).unwrap();
    let all_count = image::GrayImage::from_pixel(SIZE.0, SIZE.1, image::Luma([255]));
    (0..VIEWS).for_each(|i| all_count.save(at.join(format!("counts/v{i}.png"))).unwrap());
    let mask = fs::read(at.join("counts/v0.png")).unwrap();
    let mut masked = eval(&at, "shifted.ply", &["--pixel-masks"]);
    let text = error_of(masked.arg(at.join("counts")).arg("--out").arg(at.join("counts")));
    assert!(text.contains("counts/v0.png: is a photo or a mask"), "{text}");
    assert!(fs::read(at.join("counts/v0.png")).unwrap() == mask);
    assert!(fs::read(at.join("data/images/v0.png")).unwrap() == photo);
    assert!(fs::read(at.join("data/masks/v0.png")).unwrap() == photo);
}

#[test]
fn table_json_file_and_pictures() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    // Folders that are not there are made.
    let (json, out) = (at.join("new/report.json"), at.join("out"));
    let mut command = eval(&at, "shifted.ply", &["--split", "train"]);
    command.arg("--json").arg(&json).arg("--out").arg(&out);
    let text = String::from_utf8(command.assert().success().get_output().stdout.clone()).unwrap();
    let report: Value = serde_json::from_slice(&fs::read(&json).unwrap()).unwrap();
    assert_eq!(names(&report).len(), VIEWS - TEST_VIEWS.len());
    assert!(text.contains("view") && text.contains(&format!("{:.2}", mean(&report, "psnr"))), "{text}");
    assert!(text.lines().any(|line| line.starts_with("mean ")) && text.contains("7 pictures in"), "{text}");

    let strip = image::open(out.join("v1.png")).unwrap().to_rgb8();
    let photo = image::open(at.join("data/images/v1.png")).unwrap().to_rgb8();
    assert_eq!(strip.dimensions(), (3 * SIZE.0, SIZE.1));
    for (x, y, want) in photo.enumerate_pixels() {
        let [render, target, difference] = [0, 1, 2].map(|part| strip.get_pixel(x + part * SIZE.0, y).0);
        assert_eq!(target, want.0);
        for c in 0..3 {
            let shown = 4.0 * (f64::from(render[c]) - f64::from(target[c])).abs();
            // The difference is of unrounded values.
            assert!((f64::from(difference[c]) - shown.min(255.0)).abs() <= 3.0, "({x}, {y})");
        }
    }
}

/// Masks of pixels count as in training: those of the flag, or of the run that the scene lies in.
#[test]
fn masks_of_pixels_are_those_of_the_run() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    // One test photo is masked wholly; of the other the left half, which shows something else.
    let masks = at.join("masks of people");
    fs::create_dir(&masks).unwrap();
    let (width, height) = SIZE;
    image::GrayImage::new(width, height).save(masks.join("v0.png")).unwrap();
    let half = |x: u32, _| image::Luma([if x < width / 2 { 0 } else { 255 }]);
    image::GrayImage::from_fn(width, height, half).save(masks.join("v8.png")).unwrap();
    let path = at.join("data/images/v8.png");
    let mut photo = image::open(&path).unwrap().to_rgb8();
    photo.enumerate_pixels_mut().filter(|(x, ..)| *x < width / 2).for_each(|(.., pixel)| pixel.0 = [255; 3]);
    photo.save(&path).unwrap();
    let run = at.join("run");
    fs::create_dir(&run).unwrap();
    fs::copy(at.join("scene.ply"), run.join("scene.ply")).unwrap();

    let flag = ["--pixel-masks", masks.to_str().unwrap()];
    let (masked, told) = report_of(&mut eval(&at, "scene.ply", &flag));
    assert_eq!(names(&masked), ["v8"]);
    assert!(mean(&masked, "psnr") > 50.0, "{masked}");
    assert!(told.contains("v0.png: its mask leaves nothing to compare") && told.contains("7 of 9 photos"), "{told}");
    let (whole, _) = report_of(&mut eval(&at, "run/scene.ply", &[]));
    assert_eq!(names(&whole), TEST_VIEWS);
    assert!(whole["views"][1]["psnr"].as_f64().unwrap() < 15.0, "{whole}");

    fs::write(run.join("config.toml"), format!("pixel_masks = {:?}\n", masks.to_str().unwrap())).unwrap();
    let (as_trained, told) = report_of(&mut eval(&at, "run/scene.ply", &[]));
    assert_eq!(as_trained, masked);
    assert!(told.contains("masks of people") && told.contains("--no-pixel-masks"), "{told}");
    assert_eq!(report_of(&mut eval(&at, "run/scene.ply", &["--no-pixel-masks"])).0, whole);
    // The masks of another data set, or of none.
    fs::rename(&masks, at.join("elsewhere")).unwrap();
    let (without, told) = report_of(&mut eval(&at, "run/scene.ply", &[]));
    assert_eq!(without, whole);
    assert!(told.contains("masks of people") && told.contains("are not used"), "{told}");
    let error = error_of(&mut eval(&at, "scene.ply", &flag));
    assert!(error.contains("masks of people"), "{error}");
}

#[test]
fn pixels_a_photo_does_not_cover_show_the_background() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    for name in TEST_VIEWS {
        let path = at.join(format!("data/images/{name}.png"));
        let mut photo = image::open(&path).unwrap().to_rgba8();
        photo.enumerate_pixels_mut().filter(|(x, ..)| *x < 8).for_each(|(.., p)| p.0 = [255, 0, 255, 0]);
        photo.save(&path).unwrap();
    }
    let (black, _) = report_of(&mut eval(&at, "scene.ply", &[]));
    assert!(mean(&black, "psnr") > 45.0, "{black}");
    let (grey, _) = report_of(&mut eval(&at, "scene.ply", &["--background", "0.5,0.5,0.5"]));
    assert!(mean(&grey, "psnr") < 20.0, "{grey}");
}

/// A weights file of squeeze with small positive constants.
fn squeeze_file(path: &Path, skip: &str) {
    let mut shapes = vec![("features.0.weight".to_owned(), vec![64, 3, 3, 3]), ("features.0.bias".into(), vec![64])];
    let fires = [
        (3, 64, 16),
        (4, 128, 16),
        (6, 128, 32),
        (7, 256, 32),
        (9, 256, 48),
        (10, 384, 48),
        (11, 384, 64),
        (12, 512, 64),
    ];
    for (index, inputs, squeeze) in fires {
        let parts = [
            ("squeeze", squeeze, inputs, 1),
            ("expand1x1", 4 * squeeze, squeeze, 1),
            ("expand3x3", 4 * squeeze, squeeze, 3),
        ];
        for (part, outputs, inputs, side) in parts {
            shapes.push((format!("features.{index}.{part}.weight"), vec![outputs, inputs, side, side]));
            shapes.push((format!("features.{index}.{part}.bias"), vec![outputs]));
        }
    }
    let heads = [64, 128, 256, 384, 384, 512, 512].into_iter().enumerate();
    shapes.extend(heads.map(|(k, channels)| (format!("lin{k}.model.1.weight"), vec![1, channels, 1, 1])));
    shapes.retain(|(name, _)| name != skip);
    let mut rng = Rng::new(1);
    let data: Vec<Vec<u8>> = shapes
        .iter()
        .map(|(_, shape)| {
            (0..shape.iter().product()).flat_map(|_| (rng.range(0.0, 0.1) as f32).to_le_bytes()).collect()
        })
        .collect();
    let views = shapes.iter().zip(&data).map(|((name, shape), data)| {
        (name, safetensors::tensor::TensorView::new(safetensors::Dtype::F32, shape.clone(), data).unwrap())
    });
    fs::write(path, safetensors::serialize(views, None).unwrap()).unwrap();
}

#[test]
fn lpips_with_weights() {
    if skips_gpu() {
        return;
    }
    let (_folder, at) = folder();
    let file = at.join("squeeze.safetensors");
    squeeze_file(&file, "");
    let weights = ["--lpips-net", "squeeze", "--lpips-weights", file.to_str().unwrap()];
    let (own, warning) = report_of(&mut eval(&at, "scene.ply", &weights));
    assert_eq!(warning, "");
    let (shifted, _) = report_of(&mut eval(&at, "shifted.ply", &weights));
    assert!(mean(&own, "lpips") >= 0.0 && mean(&shifted, "lpips") > 10.0 * mean(&own, "lpips"), "{own} {shifted}");
    let (range, _) = report_of(eval(&at, "shifted.ply", &weights).args(["--lpips-range", "01"]));
    assert_ne!(mean(&range, "lpips"), mean(&shifted, "lpips"));
    // The user's data folder does as well.
    fs::create_dir_all(at.join("user/instgs-vk")).unwrap();
    fs::copy(&file, at.join("user/instgs-vk/lpips_squeeze.safetensors")).unwrap();
    assert_eq!(report_of(&mut eval(&at, "shifted.ply", &weights[..2])).0, shifted);
}

#[test]
fn failures_are_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    write_ply(&at.join("scene.ply"), &blobs(0.0), PixelFilter::default()).unwrap();
    fs::create_dir_all(at.join("data")).unwrap();
    fs::write(at.join("data/transforms.json"), transforms(&cameras()).to_string()).unwrap();
    let weights = at.join("squeeze.safetensors");
    let with_weights = ["--lpips-net", "squeeze", "--lpips-weights", weights.to_str().unwrap()];
    let text = error_of(&mut eval(at, "scene.ply", &with_weights));
    assert!(text.contains("squeeze.safetensors") && text.contains("--net squeeze"), "{text}");
    squeeze_file(&weights, "lin3.model.1.weight");
    let text = error_of(&mut eval(at, "scene.ply", &with_weights));
    assert!(text.contains("tensor lin3.model.1.weight: is missing"), "{text}");
    let text = error_of(program(at).args(["eval", "--scene"]).arg(at.join("scene.ply")).arg("--data").arg(at));
    assert!(text.contains("has no cameras"), "{text}");
    for wrong in [["--split", "dev"], ["--lpips-net", "resnet"], ["--lpips-range", "10"], ["--width", "0"]] {
        eval(at, "scene.ply", &wrong).assert().code(2);
    }
    if !skips_gpu() {
        let text = error_of(&mut eval(at, "scene.ply", &[]));
        assert!(text.contains("v0.png"), "{text}");
    }
}
