//! The program as a user runs it: exit codes, messages, files.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use glam::{DMat3, DVec3};
use instgs_io::ktx2::{FloatImage, read_ktx2};
use instgs_io::{save_scene, write_cameras, write_ply};
use instgs_vk::math::sh::SH_C0;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::{Camera, Gaussians, Group, Instance, InstancedScene, Offsets, PixelFilter, SourceRange};
use serde_json::Value;

use crate::common::dataset::{shared_data, transforms};
use crate::common::program::{error_of, program, skips_gpu};

const COMMANDS: [&str; 15] = [
    "info", "demo", "synth", "train", "segment", "register", "merge", "compare", "tables", "render", "eval", "bench",
    "inspect", "export", "edit",
];

/// The program under the validation layers, whose first message fails it; `None` where the user skips GPU tests aloud.
fn gpu_program() -> Option<Command> {
    if skips_gpu() {
        return None;
    }
    let mut command = program();
    command.env("INSTGS_VALIDATION", "1");
    Some(command)
}

/// Runs, wants exit code 0, returns stdout.
pub(super) fn stdout_of(command: &mut Command) -> String {
    String::from_utf8(command.assert().success().get_output().stdout.clone()).unwrap()
}

/// Runs with `--json` among the arguments, wants exit code 0, returns the report.
pub(super) fn json_of(command: &mut Command) -> Value {
    serde_json::from_str(&stdout_of(command)).unwrap()
}

/// Three round Gaussians, red at the origin, green to its right and blue below it.
fn three_gaussians() -> Gaussians {
    let mut cloud = Gaussians::with_capacity(0, 3);
    for (mean, rgb) in
        [([0.0, 0.0, 0.0], [1.0, 0.0, 0.0]), ([0.8, 0.0, 0.0], [0.0, 1.0, 0.0]), ([0.0, 0.6, 0.0], [0.0, 0.0, 1.0])]
    {
        cloud.means.push(mean);
        cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
        cloud.log_scales.push([0.12f32.ln(); 3]);
        cloud.opacity_logits.push(4.0);
        cloud.sh.push(rgb.map(|c: f32| (c - 0.5) / SH_C0 as f32));
    }
    cloud
}

/// A template of three Gaussians, four instances (two with offsets), and a background of three.
pub(super) fn instanced_scene() -> InstancedScene {
    let pose = |k: f64| {
        let turned = DMat3::from_rotation_z(0.5 * k);
        Similarity::from_parts(turned, 1.0 + 0.1 * k, DVec3::new(0.3 * k - 0.5, 0.1 * k, 0.2 * k))
    };
    let instance = |k: u32| Instance {
        template: 0,
        world_from_template: pose(f64::from(k)),
        first_offset: (k < 2).then_some(3 * k),
    };
    let cloud = three_gaussians();
    InstancedScene {
        templates: cloud.clone(),
        template_ranges: vec![SourceRange { first: 0, count: 3 }],
        instances: (0..4).map(instance).collect(),
        offsets: Offsets {
            means: vec![[0.01, 0.0, 0.02]; 6],
            sh_dc: vec![[0.1, 0.2, 0.3]; 6],
            opacity_logits: vec![-0.5; 6],
            ..Offsets::default()
        },
        background: cloud,
        groups: vec![Group { template_id: 0, name: Some("chair".into()), instance_ids: vec![1, 2, 3, 4] }],
        ..InstancedScene::default()
    }
}

/// A folder with `three.ply`, `scene.instgs`, `flat.ply` (the latter flattened) and `cameras.json`: `front` (64x48, from
/// 3 units before the origin) and `side.jpg` (40x30).
pub(super) fn folder() -> (tempfile::TempDir, impl Fn(&str) -> PathBuf) {
    let folder = tempfile::tempdir().unwrap();
    let root = folder.path().to_path_buf();
    write_ply(&root.join("three.ply"), &three_gaussians(), PixelFilter::default()).unwrap();
    let scene = instanced_scene();
    save_scene(&root.join("scene.instgs"), &scene).unwrap();
    write_ply(&root.join("flat.ply"), &scene.flatten(), PixelFilter::default()).unwrap();
    let camera = |name, eye, size| Camera::look_at(name, eye, DVec3::ZERO, DVec3::NEG_Y, 1.0, size);
    let front = camera("front", DVec3::new(0.0, 0.0, -3.0), (64, 48));
    let side = camera("side.jpg", DVec3::new(2.0, -1.0, -3.0), (40, 30));
    write_cameras(&root.join("cameras.json"), &[front, side]).unwrap();
    (folder, move |name: &str| root.join(name))
}

/// The bytes of every file of a folder, by name.
fn contents(folder: &Path) -> Vec<(String, Vec<u8>)> {
    let read = |entry: fs::DirEntry| (entry.file_name().into_string().unwrap(), fs::read(entry.path()).unwrap());
    let mut files: Vec<_> = fs::read_dir(folder).unwrap().map(|entry| read(entry.unwrap())).collect();
    files.sort();
    files
}

fn pixel(image: &FloatImage, x: u32, y: u32) -> &[f32] {
    let c = image.channels as usize;
    let at = (y * image.width + x) as usize * c;
    &image.values[at..at + c]
}

#[test]
fn every_command_has_help_with_an_example_and_the_device_flag() {
    let top = stdout_of(program().arg("--help"));
    for command in COMMANDS {
        assert!(top.contains(command), "{command} is not in --help");
        let help = stdout_of(program().args([command, "--help"]));
        assert!(help.contains("Example") && help.contains(&format!("instgs-vk {command}")), "{help}");
        assert!(help.contains("--device <N|NAME>") && help.contains("--json"), "{help}");
    }
    assert!(stdout_of(program().arg("--version")).starts_with("instgs-vk "));
}

#[test]
fn wrong_usage_exits_with_2() {
    let render = ["render", "--scene", "a.ply", "--out", "x"];
    let with = |more: &[&'static str]| [render.as_slice(), more].concat();
    let cases = [
        vec![],
        vec!["no-such-command"],
        vec!["inspect"],
        vec!["bench", "--scene", "a.ply"],
        render.to_vec(),
        with(&["--orbit", "3", "--data", "d"]),
        with(&["--orbit", "0"]),
        with(&["--orbit", "3", "--split", "test"]),
        with(&["--data", "d", "--split", "dev"]),
        with(&["--camera", "c.json", "--up", "0,1,0"]),
        with(&["--orbit", "3", "--size", "0x5"]),
        with(&["--orbit", "3", "--format", "gif"]),
        with(&["--orbit", "3", "--background", "1,2"]),
        with(&["--orbit", "3", "--near", "-1"]),
        with(&["--orbit", "3", "--max-intersections", "0"]),
    ];
    for arguments in cases {
        let output = program().args(&arguments).assert().code(2).get_output().clone();
        assert!(output.stdout.is_empty() && !output.stderr.is_empty(), "{arguments:?}");
    }
}

#[test]
fn missing_and_broken_files_exit_with_1_and_one_line_that_names_them() {
    let (_folder, at) = folder();
    let missing = at("missing.ply");
    let out = at("out");
    for arguments in [
        vec!["render", "--orbit", "1", "--out", out.to_str().unwrap(), "--scene"],
        vec!["bench", "--orbit", "1", "--scene"],
        vec!["inspect"],
        vec!["export", "--to", "x.ply", "--scene"],
    ] {
        let text = error_of(program().args(&arguments).arg(&missing));
        assert!(text.contains("missing.ply") && text.contains("cannot read"), "{text}");
    }
    fs::write(at("bad.json"), r#"[{"name":"q","width":4}]"#).unwrap();
    fs::write(at("garbage.json"), "[\n{").unwrap();
    fs::write(at("cut.ply"), &fs::read(at("three.ply")).unwrap()[..600]).unwrap();
    let render = |scene: &str, flag: &str, views: &str| {
        error_of(program().args(["render", "--scene"]).arg(at(scene)).arg(flag).arg(at(views)).arg("--out").arg(&out))
    };
    let text = render("three.ply", "--camera", "bad.json");
    assert!(text.contains("bad.json: camera 0 (q)"), "{text}");
    let text = render("three.ply", "--camera", "garbage.json");
    assert!(text.contains("garbage.json: line 2"), "{text}");
    let text = render("three.ply", "--data", "no-such-folder");
    assert!(text.contains("no-such-folder: there is no such folder"), "{text}");
    let text = render("three.ply", "--data", "cameras.json");
    assert!(text.contains("cameras.json: is a file, and a dataset is a folder"), "{text}");
    let text = render("cut.ply", "--camera", "cameras.json");
    assert!(text.contains("cut.ply"), "{text}");
    let text = render("cameras.json", "--camera", "cameras.json");
    assert!(text.contains("unknown scene format"), "{text}");
    // A folder, and that of a run.
    fs::create_dir_all(at("run")).unwrap();
    let text = render("run", "--camera", "cameras.json");
    assert!(text.contains("run: is a folder") && text.contains("name the scene's file"), "{text}");
    fs::copy(at("three.ply"), at("run/point_cloud.ply")).unwrap();
    let text = render("run", "--camera", "cameras.json");
    assert!(text.contains("its scene is ") && text.contains("point_cloud.ply"), "{text}");
    assert!(!out.exists(), "nothing is made before the input is known to be good");
}

#[test]
fn cameras_of_one_name_are_refused() {
    let (_folder, at) = folder();
    let camera = |name| Camera::look_at(name, DVec3::NEG_Z, DVec3::ZERO, DVec3::NEG_Y, 1.0, (8, 8));
    write_cameras(&at("same.json"), &[camera("a.png"), camera("a.png")]).unwrap();
    let mut command = program();
    command.args(["render", "--scene"]).arg(at("three.ply")).arg("--camera").arg(at("same.json"));
    assert!(error_of(command.arg("--out").arg(at("out"))).contains("cameras 0 and 1"));
}

#[test]
fn without_a_device_or_with_a_wrong_one_there_is_one_clear_line() {
    let mut command = program();
    command.env("VK_ICD_FILENAMES", "/no/such/driver.json").env("VK_DRIVER_FILES", "/no/such/driver.json");
    let text = error_of(command.arg("info"));
    assert!(text.contains("no Vulkan device") && text.contains("install"), "{text}");
    if skips_gpu() {
        return;
    }
    let text = error_of(program().args(["info", "--json"]).env("INSTGS_DEVICE", "no such card"));
    assert!(text.contains("named no such card") && text.contains("found: "), "{text}");
    let text = error_of(program().args(["--device", "99", "info", "--json"]).env("INSTGS_DEVICE", "no such card"));
    assert!(text.contains("number 99"), "{text}");
}

#[test]
fn info_reports_devices_and_the_variant() {
    let Some(mut command) = gpu_program() else { return };
    let report = json_of(command.args(["info", "--json"]));
    let first = &report["devices"][0];
    assert_eq!(first["index"], 0);
    for field in ["name", "driver", "api_version", "max_storage_bytes", "subgroup_sizes"] {
        assert!(!first[field].is_null(), "{field}");
    }
    let size = report["picked"]["variant"]["subgroup_size"].as_u64().unwrap();
    assert!([4, 8, 16, 32, 64].contains(&size));
    let text = stdout_of(program().arg("info"));
    assert!(text.contains("picked: ") && text.contains(report["picked"]["name"].as_str().unwrap()), "{text}");
}

#[test]
fn renders_png_ktx2_and_depth() {
    let (_folder, at) = folder();
    let render = |format: &str| {
        let mut command = gpu_program()?;
        command.args(["render", "--format", format, "--depth", "--background", "0.5,0,1", "--scene"]);
        command.arg(at("three.ply")).arg("--camera").arg(at("cameras.json")).arg("--out").arg(at(format));
        Some(stdout_of(&mut command))
    };
    let Some(text) = render("ktx2") else { return };
    assert!(text.contains("2 pictures"), "{text}");
    render("png").unwrap();
    let names = |folder: &str| contents(&at(folder)).into_iter().map(|(name, _)| name).collect::<Vec<_>>();
    assert_eq!(names("ktx2"), ["front.depth.ktx2", "front.ktx2", "side.depth.ktx2", "side.ktx2"]);
    assert_eq!(names("png"), ["front.depth.ktx2", "front.png", "side.depth.ktx2", "side.png"]);

    let color = read_ktx2(&at("ktx2/front.ktx2")).unwrap();
    let depth = read_ktx2(&at("ktx2/front.depth.ktx2")).unwrap();
    assert_eq!((color.width, color.height, color.channels), (64, 48, 4));
    assert_eq!((depth.width, depth.height, depth.channels), (64, 48, 1));
    // By hand: fy = 43.93 px, variance (0.12 fy / 3)^2 + 0.3 = 3.388 px^2; the pixel's centre is (0.5, 0.5) px off the
    // red one's, so alpha = sigmoid(4) exp(-0.25 / 3.388) = 0.9121, over the background.
    let center = pixel(&color, 32, 24);
    let alpha = center[3];
    assert!((alpha - 0.9121).abs() < 2e-4, "{center:?}");
    assert!((center[0] - (alpha + 0.5 * (1.0 - alpha))).abs() < 1e-3 && center[1] < 1e-3, "{center:?}");
    assert!((pixel(&depth, 32, 24)[0] - 3.0).abs() < 1e-3);
    assert_eq!(pixel(&color, 0, 0), [0.5, 0.0, 1.0, 0.0]);
    assert_eq!(pixel(&depth, 0, 0), [0.0]);
    // The green one is 11.7 px to the right, the blue one 8.8 px below.
    assert!(pixel(&color, 43, 24)[1] > 0.8, "{:?}", pixel(&color, 43, 24));
    assert!(pixel(&color, 32, 32)[2] > 0.8 && pixel(&color, 32, 32)[3] > 0.8);

    let png = image::open(at("png/front.png")).unwrap();
    assert_eq!(png.color(), image::ColorType::Rgb8);
    let png = png.to_rgb8();
    assert_eq!(png.dimensions(), (64, 48));
    for (x, y, got) in png.enumerate_pixels() {
        let want: Vec<u8> = pixel(&color, x, y)[..3].iter().map(|v| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8).collect();
        assert_eq!(got.0.as_slice(), want, "pixel {x}, {y}");
    }
    assert_eq!(fs::read(at("png/side.depth.ktx2")).unwrap(), fs::read(at("ktx2/side.depth.ktx2")).unwrap());
}

#[test]
fn size_scales_intrinsics_per_axis() {
    let (_folder, at) = folder();
    let Some(mut command) = gpu_program() else { return };
    command.args(["render", "--format", "ktx2", "--size", "128x24", "--scene"]).arg(at("three.ply"));
    command.arg("--camera").arg(at("cameras.json")).arg("--out").arg(at("out"));
    stdout_of(&mut command);
    let color = read_ktx2(&at("out/front.ktx2")).unwrap();
    assert_eq!((color.width, color.height), (128, 24));
    // Twice as far to the right, half as far below.
    assert!(pixel(&color, 64, 12)[0] > 0.8 && pixel(&color, 87, 12)[1] > 0.7 && pixel(&color, 64, 16)[2] > 0.7);
}

#[test]
fn the_same_command_gives_the_same_bytes_also_with_a_tiny_buffer() {
    let (_folder, at) = folder();
    let render = |out: &str, more: &[&str]| {
        let mut command = gpu_program()?;
        command.args(["render", "--json", "--orbit", "3", "--size", "72x56", "--depth", "--format", "ktx2", "--scene"]);
        command.arg(at("scene.instgs")).arg("--out").arg(at(out)).args(more);
        let report = json_of(&mut command);
        let slabs = report["frames"].as_array().unwrap().iter().map(|f| f["slabs"].as_u64().unwrap()).max();
        Some((slabs.unwrap(), contents(&at(out))))
    };
    let Some((slabs, first)) = render("a", &[]) else { return };
    assert_eq!((slabs, first.len()), (1, 6));
    assert_eq!(first[0].0, "000.depth.ktx2");
    assert!(render("b", &[]).is_some_and(|(_, again)| again == first), "two runs differ");
    let (slabs, limited) = render("c", &["--max-intersections", "1"]).unwrap();
    assert!(slabs > 1, "the limit was not felt");
    assert!(limited == first, "slabs changed the picture");
    assert!(render("d", &["--background", "1,1,1"]).is_some_and(|(_, other)| other != first));
}

#[test]
fn the_pixel_filter_follows_the_scene_unless_told() {
    let (_folder, at) = folder();
    let scene =
        InstancedScene { pixel_filter: PixelFilter { antialias: true, ..PixelFilter::default() }, ..instanced_scene() };
    save_scene(&at("antialiased.instgs"), &scene).unwrap();
    let render = |scene: &str, out: &str, more: &[&str]| {
        let mut command = gpu_program()?;
        command.args(["render", "--format", "ktx2", "--scene"]).arg(at(scene)).arg("--camera").arg(at("cameras.json"));
        stdout_of(command.arg("--out").arg(at(out)).args(more));
        Some(contents(&at(out)))
    };
    let Some(own) = render("antialiased.instgs", "a", &[]) else { return };
    let plain = render("scene.instgs", "b", &[]).unwrap();
    assert!(own != plain);
    assert!(render("scene.instgs", "c", &["--antialias"]).unwrap() == own);
    assert!(render("antialiased.instgs", "d", &["--antialias=false"]).unwrap() == plain);
    let narrow = PixelFilter { dilation_px2: 0.1, antialias: true };
    save_scene(&at("narrow.instgs"), &InstancedScene { pixel_filter: narrow, ..instanced_scene() }).unwrap();
    write_ply(&at("narrow.ply"), &instanced_scene().flatten(), narrow).unwrap();
    write_ply(&at("plain.ply"), &instanced_scene().flatten(), PixelFilter::default()).unwrap();
    let filter = ["--antialias", "--dilation", "0.1"];
    for (scene, same, out) in [("narrow.instgs", "scene.instgs", "e"), ("narrow.ply", "plain.ply", "f")] {
        let narrow = render(scene, out, &[]).unwrap();
        assert!(narrow != own && narrow == render(same, &format!("{out}2"), &filter).unwrap(), "{scene}");
        let usual = render(scene, &format!("{out}3"), &["--antialias=false", "--dilation", "0.3"]).unwrap();
        assert!(usual == render(same, &format!("{out}4"), &[]).unwrap(), "{scene}");
    }
}

#[test]
fn dropped_gaussians_are_counted_aloud() {
    let (_folder, at) = folder();
    let mut cloud = three_gaussians();
    cloud.means[1][0] = f32::NAN;
    write_ply(&at("nan.ply"), &cloud, PixelFilter::default()).unwrap();
    let output = program().arg("inspect").arg(at("nan.ply")).assert().success().get_output().clone();
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(text.starts_with("warning: ") && text.contains("nan.ply: dropped 1 Gaussians"), "{text}");
}

/// The fields that `bench --json` promises.
fn check_bench_fields(report: &Value) {
    for (group, fields) in [
        ("ms", vec!["median", "p10", "p90"]),
        ("gaussians", vec!["template", "offsets", "background", "expanded", "visible", "intersections"]),
        ("bytes", vec!["file", "host", "device_scene", "device_peak"]),
    ] {
        for field in fields {
            assert!(report[group][field].is_number(), "{group}.{field}");
        }
    }
    assert!(report["device"].is_string() && report["fps"].is_number() && report["frames"].is_number());
    assert_eq!(report["resolution"].as_array().map(Vec::len), Some(2));
    let passes = report["passes_ms"].as_object().unwrap();
    assert!(passes.contains_key("tile_blend") && passes.values().all(Value::is_number), "{passes:?}");
    let (ms, fps) = (report["ms"]["median"].as_f64().unwrap(), report["fps"].as_f64().unwrap());
    assert!((ms * fps - 1000.0).abs() < 1e-6);
    let (scene, peak) = (&report["bytes"]["device_scene"], &report["bytes"]["device_peak"]);
    assert!(scene.as_u64().unwrap() < peak.as_u64().unwrap());
}

#[test]
fn bench_has_all_fields_and_counts_right() {
    let (_folder, at) = folder();
    let Some(mut command) = gpu_program() else { return };
    command.args(["bench", "--json", "--frames", "3", "--scene"]).arg(at("scene.instgs"));
    let report = json_of(command.arg("--camera").arg(at("cameras.json")));
    check_bench_fields(&report);
    let gaussians = &report["gaussians"];
    let counts = ["template", "offsets", "background", "expanded"].map(|f| gaussians[f].as_u64().unwrap());
    assert_eq!(counts, [3, 6, 3, 15]);
    assert_eq!(report["bytes"]["file"].as_u64(), Some(fs::metadata(at("scene.instgs")).unwrap().len()));
    assert_eq!(report["bytes"]["host"].as_u64(), Some(instanced_scene().tensor_bytes()));
    assert_eq!((&report["frames"], &report["resolution"]), (&Value::from(3), &serde_json::json!([64, 48])));
    assert!(report["against"].is_null() && report["ratio"].is_null());
    let frames: Vec<_> = report["cameras"].as_array().unwrap().iter().map(|c| c["frames"].as_u64().unwrap()).collect();
    assert_eq!(frames, [2, 1]);
    // What `inspect` plans is what the device holds.
    let plan = json_of(program().args(["inspect", "--json"]).arg(at("scene.instgs")));
    assert_eq!(plan["bytes"]["device_scene"], report["bytes"]["device_scene"]);
}

#[test]
fn bench_against_compares_the_right_way_round() {
    let (_folder, at) = folder();
    let Some(mut command) = gpu_program() else { return };
    command.args(["bench", "--frames", "2", "--orbit", "2", "--size", "64x48", "--scene"]).arg(at("scene.instgs"));
    command.arg("--against").arg(at("flat.ply")).arg("--json").arg(at("report.json"));
    let text = stdout_of(&mut command);
    assert!(text.contains("frames per second") && text.contains("flat.ply"), "{text}");
    let report: Value = serde_json::from_slice(&fs::read(at("report.json")).unwrap()).unwrap();
    check_bench_fields(&report);
    check_bench_fields(&report["against"]);
    let number = |value: &Value| value.as_f64().unwrap();
    let against = &report["against"];
    assert!((number(&report["ratio"]["fps"]) - number(&report["fps"]) / number(&against["fps"])).abs() < 1e-9);
    for field in ["file", "host", "device_scene"] {
        let want = number(&against["bytes"][field]) / number(&report["bytes"][field]);
        assert!((number(&report["ratio"][field]) - want).abs() < 1e-9, "{field}");
    }
    assert_eq!(against["gaussians"]["background"], 15);
    assert_eq!(against["gaussians"]["visible"], report["gaussians"]["visible"]);
}

#[test]
fn inspect_explains_every_byte() {
    let (_folder, at) = folder();
    let sum = |parts: &Value| parts.as_object().unwrap().values().map(|v| v.as_u64().unwrap()).sum::<u64>();
    for name in ["scene.instgs", "three.ply"] {
        let report = json_of(program().args(["inspect", "--json"]).arg(at(name)));
        let bytes = &report["bytes"];
        let file: u64 =
            report["file_parts"].as_array().unwrap().iter().map(|part| part["bytes"].as_u64().unwrap()).sum();
        assert_eq!(Some(file), bytes["file"].as_u64(), "{name}");
        assert_eq!(bytes["file"].as_u64(), Some(fs::metadata(at(name)).unwrap().len()));
        assert_eq!(Some(sum(&report["file_sums"])), bytes["file"].as_u64(), "{name}");
        assert_eq!(Some(sum(&report["host_parts"])), bytes["host"].as_u64(), "{name}");
        assert_eq!(Some(sum(&report["device_parts"])), bytes["device_scene"].as_u64(), "{name}");
    }
    let report = json_of(program().args(["inspect", "--json"]).arg(at("scene.instgs")));
    let group = &report["groups"][0];
    assert_eq!((&group["name"], &group["instances"]), (&Value::from("chair"), &Value::from(4)));
    assert_eq!((&group["instances_with_offsets"], &group["expanded"]), (&Value::from(2), &Value::from(12)));
    // SH 0 in f32: rows of 56 bytes, 6 offset records of 28, 4 instances of 56, a range of 8.
    assert_eq!(group["stored_bytes"], 3 * 56 + 6 * 28 + 4 * 56 + 8);
    // Three Gaussians of 14 numbers, in halves but for the mean, and the six records that there are, of 7 halves.
    assert_eq!(group["bound_bytes"]["f16"], 3 * 34 + 6 * 14);
    let text = stdout_of(program().arg("inspect").arg(at("scene.instgs")));
    assert!(text.contains("offset.means") && text.contains("chair"), "{text}");
}

/// Of a dataset, every eighth view is one for tests.
#[test]
fn render_takes_the_test_views_of_a_dataset() {
    let (_folder, at) = folder();
    let camera = |k: u32| {
        let eye = DVec3::new(0.1 * f64::from(k), 0.0, -3.0);
        Camera::look_at(&format!("{k:02}"), eye, DVec3::ZERO, DVec3::NEG_Y, 1.0, (32, 24))
    };
    let cameras: Vec<Camera> = (0..10).map(camera).collect();
    fs::create_dir(at("data")).unwrap();
    fs::write(at("data/transforms.json"), transforms(&cameras).to_string()).unwrap();
    let Some(mut command) = gpu_program() else { return };
    command.args(["render", "--json", "--size", "16x12", "--scene"]).arg(at("three.ply"));
    let report = json_of(command.arg("--data").arg(at("data")).arg("--out").arg(at("out")));
    let frames = report["frames"].as_array().unwrap();
    let names: Vec<_> = frames.iter().map(|f| f["name"].as_str().unwrap()).collect();
    assert_eq!(names, ["00", "08"]);
    assert!(frames.iter().all(|f| f["visible"] == 3), "{frames:?}");
}

/// A real scene, and datasets in the forms of two makers.
#[test]
#[ignore = "needs ../shared/data, which is not ours to publish; tools/test runs it where it is"]
fn real_scene_and_datasets() {
    let garden = shared_data("garden");
    let folder = tempfile::tempdir().unwrap();
    let render = |flag: &str, views: &Path, size: &str| {
        let mut command = gpu_program()?;
        command.args(["render", "--json", "--size", size, "--scene"]).arg(garden.join("garden.ply"));
        let report = json_of(command.arg(flag).arg(views).arg("--out").arg(folder.path()));
        Some(report["frames"].as_array().unwrap().clone())
    };
    let Some(frames) = render("--camera", &garden.join("cameras.json"), "160x90") else { return };
    assert_eq!(frames.len(), 3);
    assert!(frames.iter().all(|f| f["visible"].as_u64().unwrap() > 20_000), "{frames:?}");
    let names = |frames: &[Value]| frames.iter().map(|f| f["name"].as_str().unwrap().to_owned()).collect::<Vec<_>>();
    let fox = render("--data", &shared_data("fox_270"), "27x48").unwrap();
    assert_eq!(fox.len(), 7, "{:?}", names(&fox));
    let room = render("--data", &shared_data("room18"), "64x36").unwrap();
    assert!(!room.is_empty() && room.len() < 18, "{:?}", names(&room));
}
