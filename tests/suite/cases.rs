//! Inputs of other people's kind that once went wrong: what a user is told, and that nothing goes wrong in silence. Each has
//! its own folder in tests/fixtures/cases, whose README.md says what the condition is and where it comes from.

use std::fs;
use std::path::{Path, PathBuf};

use serde_json::Value;

use crate::common::program::{program, repository, skips_gpu};

/// A writable copy of a case's folder.
struct Case {
    folder: tempfile::TempDir,
}

/// What a command said and left.
struct Said {
    code: Option<i32>,
    out: String,
    err: String,
}

impl Case {
    fn new(number: &str) -> Self {
        let cases = repository().join("tests/fixtures/cases");
        let entries = fs::read_dir(&cases).unwrap().map(|entry| entry.unwrap().path());
        let of_number = |path: &PathBuf| path.file_name().unwrap().to_string_lossy().starts_with(&format!("{number}-"));
        let from = entries.into_iter().find(of_number).unwrap();
        let folder = tempfile::tempdir().unwrap();
        copy(&from, folder.path());
        Self { folder }
    }

    fn at(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    fn run(&self, arguments: &str) -> Said {
        let output = program().current_dir(self.folder.path()).args(arguments.split_whitespace()).output().unwrap();
        let text = |bytes: Vec<u8>| String::from_utf8(bytes).unwrap();
        Said { code: output.status.code(), out: text(output.stdout), err: text(output.stderr) }
    }

    /// Mean PSNR of `eval`, with the number of views and what was said beside it.
    fn eval(&self, data: &str) -> (f64, usize, String) {
        let said = self.run(&format!("eval --scene scene.ply --data {data} --split all --json"));
        assert_eq!(said.code, Some(0), "{}", said.err);
        let report: Value = serde_json::from_str(&said.out).unwrap();
        let views = report["views"].as_array().unwrap().len();
        (report["mean"]["psnr"].as_f64().unwrap(), views, said.err)
    }

    /// The first Gaussians of a plain run of so many steps.
    fn train(&self, data: &str, more: &str) -> Said {
        let out = format!("run_{}", data.replace(['/', '.'], "_"));
        self.run(&format!("train --data {data} --out {out} --config quick --max-gaussians 400 {more}"))
    }
}

impl Said {
    /// Fails with one line that has all of these words.
    fn is_refused(&self, words: &[&str]) {
        assert_eq!(self.code, Some(1), "{}{}", self.out, self.err);
        let line = self.err.lines().last().unwrap_or_default();
        assert!(line.starts_with("error: "), "{}", self.err);
        words.iter().for_each(|word| assert!(line.contains(word), "{word}: {line}"));
    }

    /// Succeeds, with a warning that has all of these words.
    fn is_warned(&self, words: &[&str]) {
        assert_eq!(self.code, Some(0), "{}{}", self.out, self.err);
        let warned = self.err.lines().any(|line| words.iter().all(|word| line.contains(word)));
        assert!(warned, "{words:?}: {}", self.err);
    }
}

fn copy(from: &Path, to: &Path) {
    fs::create_dir_all(to).unwrap();
    for entry in fs::read_dir(from).unwrap().map(Result::unwrap) {
        let (path, at) = (entry.path(), to.join(entry.file_name()));
        match path.is_dir() {
            true => copy(&path, &at),
            false => fs::copy(&path, &at).map(|_| ()).unwrap(),
        }
    }
}

/// Mean PSNR of the scene that most cases have, on its own photos.
const PLAIN: f64 = 5.48;

fn is_plain((psnr, views, err): &(f64, usize, String)) {
    assert!((psnr - PLAIN).abs() < 0.01 && *views == 6, "{psnr} {views} {err}");
}

#[test]
fn byte_order_marks_are_skipped() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("01");
    is_plain(&case.eval("."));
    is_plain(&case.eval("colmap"));
    assert_eq!(case.run("render --scene scene.ply --camera cameras.json --out o").code, Some(0));
    assert_eq!(case.run("masks --data ids --masks ids/masks --out o2").code, Some(0));
    // Siblings: UTF-16, and a comma too many.
    let utf16: Vec<u8> = "\u{feff}{}".encode_utf16().flat_map(u16::to_le_bytes).collect();
    fs::write(case.at("cameras.json"), utf16).unwrap();
    case.run("render --scene scene.ply --camera cameras.json --out o3").is_refused(&[
        "cameras.json",
        "UTF-16",
        "UTF-8",
    ]);
    fs::write(case.at("cameras.json"), "[1,\n]").unwrap();
    case.run("render --scene scene.ply --camera cameras.json --out o3")
        .is_refused(&["line 2", "where the file has \"]\""]);
    let crlf = fs::read_to_string(case.at("transforms.json")).unwrap().replace('\n', "\r\n");
    fs::write(case.at("transforms.json"), crlf).unwrap();
    is_plain(&case.eval("."));
}

#[test]
fn backslashes_of_windows_are_separators_everywhere() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("02");
    is_plain(&case.eval("."));
    is_plain(&case.eval("colmap"));
    assert_eq!(case.train("ply", "--steps 1").code, Some(0));
    // A sibling: the lists of file names.
    let text = fs::read_to_string(case.at("transforms.json")).unwrap();
    let listed = text.replacen('{', r#"{"test_filenames": ["images\\000.png"],"#, 1);
    fs::write(case.at("transforms.json"), listed).unwrap();
    is_plain(&case.eval("."));
}

#[test]
fn a_list_of_distortion_is_read_like_fields() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("03");
    let (listed, fields) = (case.eval("."), case.eval("k1k2"));
    assert!((listed.0 - fields.0).abs() < 1e-9 && (listed.0 - PLAIN).abs() > 0.05, "{} {}", listed.0, fields.0);
    // Siblings: a term that is not supported, and a list of another length.
    let text = fs::read_to_string(case.at("transforms.json")).unwrap();
    let mut file: Value = serde_json::from_str(&text).unwrap();
    for (list, words) in [("[0.1, 0, 0, 0.2, 0, 0]", "k1 k2 k3 p1 p2"), ("[0.1, 0.2]", "has 2 numbers")] {
        for frame in file["frames"].as_array_mut().unwrap() {
            frame["distortion_params"] = serde_json::from_str(list).unwrap();
        }
        fs::write(case.at("transforms.json"), file.to_string()).unwrap();
        let said = case.run("eval --scene scene.ply --data . --split all");
        said.is_refused(&["frames[0].distortion_params", words]);
    }
}

#[test]
fn fisheye_photos_are_undistorted_and_told_of() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("10");
    let cameras = fs::read_to_string(case.at("sparse/0/cameras.txt")).unwrap();
    let line = cameras.lines().find(|line| line.contains("PINHOLE")).unwrap();
    let fisheye = format!("{} 0.01 0 0 0", line.replacen("PINHOLE", "OPENCV_FISHEYE", 1));
    fs::write(case.at("sparse/0/cameras.txt"), cameras.replacen(line, &fisheye, 1)).unwrap();
    let (psnr, views, err) = case.eval(".");
    assert!(views == 6 && (psnr - PLAIN).abs() > 1e-3, "{psnr} {views}");
    assert!(err.contains("6 photos of fisheye lenses") && err.contains("degrees from their axis"), "{err}");
}

#[test]
fn images_without_lines_of_points_are_all_read() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("04");
    is_plain(&case.eval("."));
}

#[test]
fn poses_with_rounding_or_a_scale_are_cameras() {
    if skips_gpu() {
        return;
    }
    is_plain(&Case::new("06").eval("."));
    let case = Case::new("07");
    let (psnr, views, err) = case.eval(".");
    is_plain(&(psnr, views, err.clone()));
    assert!(err.contains("frames[0].transform_matrix") && err.contains("length 2.000"), "{err}");
    // Siblings: rounded to three decimals, which is accepted in silence; skewed and mirrored axes, which are not.
    let text = fs::read_to_string(case.at("transforms.json")).unwrap();
    let mut file: Value = serde_json::from_str(&text).unwrap();
    let scaled = |row: usize, column: usize, factor: f64| {
        let mut file = file.clone();
        for frame in file["frames"].as_array_mut().unwrap() {
            let number = &mut frame["transform_matrix"][row][column];
            *number = Value::from(number.as_f64().unwrap() * factor);
        }
        fs::write(case.at("transforms.json"), file.to_string()).unwrap();
        case.run("eval --scene scene.ply --data . --split all")
    };
    scaled(1, 1, 3.0).is_refused(&["frames[0].transform_matrix", "rigid"]);
    for frame in file["frames"].as_array_mut().unwrap() {
        for row in frame["transform_matrix"].as_array_mut().unwrap().iter_mut().take(3) {
            for (column, number) in row.as_array_mut().unwrap().iter_mut().enumerate() {
                // The scale of 2 goes, and so do digits.
                let value = number.as_f64().unwrap() / if column < 3 { 2.0 } else { 1.0 };
                *number = Value::from((value * 1000.0).round() / 1000.0);
            }
        }
    }
    fs::write(case.at("transforms.json"), file.to_string()).unwrap();
    let (psnr, _, err) = case.eval(".");
    assert!((psnr - PLAIN).abs() < 0.05 && !err.contains("transform_matrix"), "{psnr} {err}");
}

#[test]
fn panoramas_are_named_with_an_advice_that_works() {
    let case = Case::new("09");
    let said = case.run("eval --scene scene.ply --data . --split all");
    said.is_refused(&["EQUIRECTANGULAR", "perspective views", "panorama_sfm"]);
    assert!(!said.err.contains("image_undistorter"), "{}", said.err);
    // A sibling: a camera that is not supported and that no image uses.
    if skips_gpu() {
        return;
    }
    let case = Case::new("10");
    let cameras = fs::read_to_string(case.at("sparse/0/cameras.txt")).unwrap();
    fs::write(case.at("sparse/0/cameras.txt"), format!("{cameras}\n99 EQUIRECTANGULAR 100 50 100 50\n")).unwrap();
    is_plain(&case.eval("."));
}

#[test]
fn the_whole_model_is_taken_and_a_larger_one_told_of() {
    if skips_gpu() {
        return;
    }
    is_plain(&Case::new("10").eval("."));
    let case = Case::new("11");
    let (_, views, err) = case.eval(".");
    assert!(views == 2 && err.contains("sparse/1 has 6 images") && err.contains("is used, 2"), "{err}");
    fs::remove_dir_all(case.at("sparse/1")).unwrap();
    let (_, _, err) = case.eval(".");
    assert!(err.contains("2 of its 6 photos have a camera"), "{err}");
}

#[test]
fn models_that_cannot_be_used_are_named() {
    let case = Case::new("10");
    fs::remove_file(case.at("sparse/0/images.txt")).unwrap();
    let eval = "eval --scene scene.ply --data .";
    case.run(eval).is_refused(&["sparse/0", "no images.bin and no images.txt"]);
    fs::write(case.at("sparse/0/images.bin"), []).unwrap();
    fs::remove_file(case.at("sparse/0/cameras.bin")).unwrap();
    case.run(eval).is_refused(&["sparse/0", "both .bin or both .txt"]);
    let case = Case::new("11");
    fs::remove_dir_all(case.at("sparse/0")).unwrap();
    case.run(eval).is_refused(&["sparse/1", "models are read from", "rename it to", "sparse/0"]);
    fs::create_dir(case.at("sparse/0")).unwrap();
    case.run(eval).is_refused(&["sparse/1", "exchange the names"]);
}

#[test]
fn masks_may_have_the_whole_name_of_their_photo() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("12");
    assert_eq!(case.run("segment --scene scene.ply --data . --out o").code, Some(0));
    fs::rename(case.at("masks"), case.at("other")).unwrap();
    fs::create_dir(case.at("masks")).unwrap();
    for entry in fs::read_dir(case.at("other")).unwrap().map(Result::unwrap) {
        let name = format!("masks/x_{}", entry.file_name().to_string_lossy());
        fs::rename(entry.path(), case.at(&name)).unwrap();
    }
    let said = case.run("segment --scene scene.ply --data . --out o2");
    assert!(said.code == Some(1) && said.err.contains("masks"), "{}", said.err);
}

/// Base colours that a run starts with.
fn first_colors(case: &Case, data: &str) -> Vec<f32> {
    let said = case.train(data, "--steps 1 --set rates.sh_dc=0 --set rates.sh_dc_final=0");
    let said = if said.code == Some(0) { said } else { case.train(data, "--steps 1") };
    assert_eq!(said.code, Some(0), "{}", said.err);
    let cloud = instgs_io::read_ply(&case.at(&format!("run_{data}/point_cloud.ply"))).unwrap();
    let coefficients = cloud.sh_coefficients();
    cloud.sh.iter().step_by(coefficients).flatten().copied().collect()
}

#[test]
fn point_colours_of_every_kind_are_the_same() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("14");
    let want = first_colors(&case, "uchar");
    for other in ["ushort", "float255", "rgb"] {
        let got = first_colors(&case, other);
        let worst = got.iter().zip(&want).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
        assert!(got.len() == want.len() && worst < 0.02, "{other}: {worst}");
    }
    // A sibling: colours of names that are not known.
    let file = case.at("uchar/points3d.ply");
    let mut bytes = fs::read(&file).unwrap();
    let at = bytes.windows(9).position(|word| word == b"uchar red").unwrap();
    bytes[at + 6..at + 9].copy_from_slice(b"abc");
    fs::write(&file, bytes).unwrap();
    let said = case.run("train --data uchar --out unnamed --config quick --max-gaussians 400 --steps 1");
    said.is_warned(&["points3d.ply", "no colours"]);
}

#[test]
fn points_that_coincide_count_once() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("15");
    case.train("x4", "--steps 20").is_warned(&["dropped 600 points"]);
    assert_eq!(case.train("x1", "--steps 20").code, Some(0));
    let result = |data: &str| fs::read(case.at(&format!("run_{data}/point_cloud.ply"))).unwrap();
    assert!(result("x1") == result("x4"));
}

#[test]
fn what_spz_clamps_is_told() {
    let case = Case::new("17");
    for (scene, words) in [("bright", "colours"), ("sh", "SH"), ("large", "sizes")] {
        let said = case.run(&format!("export --scene {scene}.ply --to {scene}.spz"));
        said.is_warned(&[&format!("{scene}.spz"), "of 60 Gaussians", words]);
    }
    // Positions of a scene in small units keep their digits.
    case.run("export --scene small.ply --to small.spz");
    let [before, after] = ["small.ply", "small.spz"].map(|name| instgs_io::load_scene(&case.at(name)).unwrap().scene);
    let pairs = before.background.means.as_flattened().iter().zip(after.background.means.as_flattened());
    let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-6, "{worst}");
}

#[test]
fn files_are_read_by_their_content() {
    let case = Case::new("17");
    assert_eq!(case.run("export --scene sh.ply --to sh.sog").code, Some(0));
    for (from, to) in [("sh.ply", "a.splat"), ("sh.ply", "a.spz"), ("sh.sog", "a.ply"), ("sh.ply", "a.instgs")] {
        fs::copy(case.at(from), case.at(to)).unwrap();
        let loaded = instgs_io::load_scene(&case.at(to)).unwrap();
        assert!(loaded.scene.background.len() == 60 && loaded.notes.iter().any(|note| note.contains("the content of")));
    }
}

#[test]
fn axes_of_spz_are_obeyed() {
    let case = Case::new("18");
    let [want, got] = ["a.ply", "rdf.spz"].map(|name| instgs_io::load_scene(&case.at(name)).unwrap());
    assert!(!got.notes.iter().any(|note| note.contains("extension")), "{:?}", got.notes);
    let pairs = want.scene.background.means.as_flattened().iter().zip(got.scene.background.means.as_flattened());
    let worst = pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max);
    assert!(worst < 1e-3, "{worst}");
}

#[test]
fn json_of_other_programs_is_read_or_named() {
    let case = Case::new("19");
    for (file, words) in [("coco.json", "COCO"), ("labelme.json", "labelme")] {
        let said = case.run(&format!("masks --data . --scene scene.ply --out o --boxes {file}"));
        said.is_refused(&[file, words]);
    }
    for (file, words) in [("camera_path_nerfstudio.json", "nerfstudio"), ("transforms.json", "--data")] {
        case.run(&format!("render --scene scene.ply --out o --camera {file}")).is_refused(&[file, words]);
    }
    if skips_gpu() {
        return;
    }
    // The photo's ending in a view's name, and the cameras that 3DGS leaves beside a scene.
    let said = case.run("masks --data . --scene scene.ply --out o2 --boxes with_ending.json");
    assert!(!said.err.contains("not among"), "{}", said.err);
    assert_eq!(case.run("render --scene scene.ply --out o3 --camera cameras_inria.json").code, Some(0));
    assert!(case.at("o3").read_dir().unwrap().count() > 0);
}

#[test]
fn advice_for_missing_points_works() {
    let case = Case::new("21");
    case.train(".", "--steps 2").is_refused(&["has no points", "--set init=random"]);
    case.train("removed", "--steps 2").is_refused(&["no point cloud", "--set init=random"]);
    if skips_gpu() {
        return;
    }
    // Who has followed it is not given it again.
    let empty = case.train(".", "--steps 2 --set init=random --set init_count=100");
    empty.is_warned(&["has no points", "continuing without points"]);
    assert!(!empty.err.contains("--set init=random"), "{}", empty.err);
    let random = case.train("removed", "--steps 2 --set init=random --set init_count=100");
    assert_eq!(random.code, Some(0), "{}", random.err);
}

#[test]
fn masks_that_leave_nothing_are_refused() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("22");
    case.train(".", "--steps 5").is_refused(&["its mask leaves nothing to train on", "4 photos"]);
    // A sibling: all but one photo.
    let masks: Vec<PathBuf> = fs::read_dir(case.at("m")).unwrap().map(|entry| entry.unwrap().path()).collect();
    for mask in masks.iter().filter(|path| path.file_name().unwrap().to_string_lossy().starts_with("003")) {
        let size = image::image_dimensions(mask).unwrap();
        image::GrayImage::from_pixel(size.0, size.1, image::Luma([255])).save(mask).unwrap();
    }
    let said = case.run("train --data . --out some --config quick --max-gaussians 400 --steps 5");
    said.is_warned(&["leaves nothing to train on", "4 such photos"]);
}

#[test]
fn transforms_for_training_alone_are_a_data_set() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("23");
    is_plain(&case.eval("."));
    // A sibling: the held-out views are in transforms_val.json.
    let text = fs::read_to_string(case.at("transforms_train.json")).unwrap();
    let mut train: Value = serde_json::from_str(&text).unwrap();
    let mut val = train.clone();
    let frames = train["frames"].as_array_mut().unwrap();
    let held_out = frames.split_off(4);
    val["frames"] = Value::from(held_out);
    fs::write(case.at("transforms_train.json"), train.to_string()).unwrap();
    fs::write(case.at("transforms_val.json"), val.to_string()).unwrap();
    let said = case.run("eval --scene scene.ply --data . --split test --json");
    let report: Value = serde_json::from_str(&said.out).unwrap();
    assert_eq!(report["views"].as_array().unwrap().len(), 2, "{}", said.err);
}

#[test]
fn views_without_a_photo_are_left_out_and_told_of() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("24");
    let (_, views, err) = case.eval(".");
    assert!(views == 5 && err.contains("003.png is missing") && err.contains("1 view of 6"), "{err}");
    case.train(".", "--steps 2").is_warned(&["003.png is missing"]);
    // Siblings: a photo of another ending is named, and most photos are missing.
    fs::rename(case.at("images/001.png"), case.at("images/001.PNG")).unwrap();
    let (_, _, err) = case.eval(".");
    assert!(err.contains("001.PNG is there") && err.contains("2 views of 6"), "{err}");
    fs::remove_file(case.at("images/000.png")).unwrap();
    fs::remove_file(case.at("images/002.png")).unwrap();
    let said = case.run("eval --scene scene.ply --data . --split all");
    said.is_refused(&["is missing", "3 of the other 5", "--skip-missing"]);
    let said = case.run("eval --scene scene.ply --data . --split all --skip-missing");
    said.is_warned(&["4 views of 6"]);
    let said = case.run("train --data . --out some --config quick --max-gaussians 400 --steps 2 --skip-missing");
    said.is_warned(&["4 views of 6"]);
    // Without any photo there is nothing to go on with.
    let photo = |name: &str| case.at(&format!("images/{name}"));
    for name in ["001.PNG", "004.png", "005.png"] {
        if photo(name).exists() {
            fs::remove_file(photo(name)).unwrap();
        }
    }
    let said = case.run("eval --scene scene.ply --data . --split all");
    assert!(said.code == Some(1) && said.err.contains("put the photos there"), "{}", said.err);
    assert!(!said.err.contains("--skip-missing"), "{}", said.err);
}

#[test]
fn masks_of_pixels_are_used_on_demand_and_told_of() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("27");
    case.train(".", "--steps 2").is_warned(&["masks is not used", "--pixel-masks"]);
    let said = case.run("train --data . --out with --config quick --max-gaussians 400 --steps 2 --pixel-masks masks");
    assert!(said.code == Some(0) && !said.err.contains("not used"), "{}", said.err);
    let cloud = |run: &str| fs::read(case.at(&format!("{run}/point_cloud.ply"))).unwrap();
    assert!(cloud("with") != cloud("run__"), "the masks change what is learned");
    fs::create_dir(case.at("empty")).unwrap();
    let said = case.run("train --data . --out no --config quick --steps 2 --pixel-masks empty");
    said.is_refused(&["empty", "no masks"]);
}

#[test]
fn photos_are_turned_by_their_tag_where_cameras_are() {
    if skips_gpu() {
        return;
    }
    let (_, views, err) = Case::new("28").eval(".");
    assert!(views == 6, "{err}");
}

#[test]
fn masks_of_ids_are_not_masks_of_pixels() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("22");
    let masks: Vec<PathBuf> = fs::read_dir(case.at("m")).unwrap().map(|entry| entry.unwrap().path()).collect();
    for mask in &masks {
        let (width, height) = image::image_dimensions(mask).unwrap();
        let id = |x: u32, _| {
            image::Luma([if x < width / 3 {
                1
            } else if x < width / 2 {
                2
            } else {
                0
            }])
        };
        image::GrayImage::from_fn(width, height, id).save(mask).unwrap();
    }
    case.train(".", "--steps 2").is_warned(&["mask_path names ids of objects", "all pixels are used"]);
    // Of one object, they may be both.
    for mask in &masks {
        let (width, height) = image::image_dimensions(mask).unwrap();
        image::GrayImage::from_fn(width, height, |x, _| image::Luma([if x < width / 3 { 255 } else { 0 }]))
            .save(mask)
            .unwrap();
    }
    let said =
        case.run("train --data . --out both --config instgs_quick --max-gaussians 400 --steps 2 --masks m --dry-run");
    said.is_warned(&["used twice", "ids of objects", "mask of pixels"]);
}

#[test]
fn files_do_not_claim_more_memory_than_they_can_code() {
    let case = Case::new("31");
    for file in ["bomb_small_constant.instgs", "bomb_small_table.instgs"] {
        case.run(&format!("inspect {file}")).is_refused(&[file, "background.means", "30000000 rows"]);
    }
}

/// A run that is still going on is not resumed beside it.
#[test]
fn one_process_trains_in_a_folder() {
    if skips_gpu() {
        return;
    }
    let case = Case::new("23");
    fs::create_dir(case.at("run")).unwrap();
    let lock = instgs_io::RunLock::take(&case.at("run")).unwrap();
    let train = "train --data . --out run --config quick --steps 2 --max-gaussians 400";
    case.run(train).is_refused(&["run", "process", "is training in this folder"]);
    drop(lock);
    assert_eq!(case.run(train).code, Some(0));
    let resumed = case.run(&format!("{train} --resume"));
    assert!(resumed.code == Some(0) && !case.at("run/.lock").exists(), "{}", resumed.err);
}

/// Pipes never end, and names may hold what a terminal obeys.
#[cfg(unix)]
#[test]
fn pipes_are_refused_and_names_are_printed_plainly() {
    let case = Case::new("23");
    let made = std::process::Command::new("mkfifo").arg(case.at("pipe.ply")).status().unwrap();
    assert!(made.success());
    case.run("inspect pipe.ply").is_refused(&["pipe.ply", "no regular file"]);
    // Its pages are looked for first.
    fs::rename(case.at("pipe.ply"), case.at("pipe.instgs")).unwrap();
    case.run("render --scene pipe.instgs --orbit 1 --out out").is_refused(&["pipe.instgs", "no regular file"]);
    case.run("inspect /dev/zero").is_refused(&["/dev/zero"]);
    let name = "a\u{1b}[31mred.ply";
    fs::write(case.at(name), "ply\nno").unwrap();
    let said = case.run(&format!("inspect {name}"));
    assert!(said.code == Some(1) && !said.err.contains('\u{1b}') && said.err.contains("[31mred"), "{:?}", said.err);
}
