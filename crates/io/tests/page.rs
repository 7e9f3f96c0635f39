//! The web page's modules in node, beside Rust: what they read of scene files, the order of splats, what a pixel shows, and what
//! needs no browser of cameras, keys and faults. Skipped where node is missing; `tools/check_page` runs the page in a browser.

#![allow(clippy::print_stdout, reason = "a skipped test must be heard")]

use std::collections::BTreeSet;
use std::error::Error;
use std::path::{Path, PathBuf};
use std::process::Command;

use glam::{DMat3, DQuat, DVec3};
use instgs_io::{Pack, read_scene_file, write_cameras, write_scene_file_packed};
use instgs_samples::{ring, sample_scene, with_ablations, with_low_sh_offsets, with_own};
use instgs_vk::scene::gaussians::sh_coefficients;
use instgs_vk::scene::{Camera, Gaussians, InstancedScene};
use serde_json::Value;

type Test = Result<(), Box<dyn Error>>;

/// Every STEPth pixel is picked, in both directions.
const STEP: usize = 2;

fn script(name: &str) -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/page").join(name)
}

fn has_node() -> bool {
    Command::new("node").arg("--version").output().is_ok_and(|output| output.status.success())
}

/// What a script of `tests/page` writes.
fn output_of(command: &mut Command) -> Result<Vec<u8>, Box<dyn Error>> {
    let output = command.output()?;
    if output.status.success() {
        return Ok(output.stdout);
    }
    Err(format!("{command:?}: {}", String::from_utf8_lossy(&output.stderr)).into())
}

#[test]
fn cameras_keys_and_faults() -> Test {
    if !has_node() {
        println!("skipped: node is not installed");
        return Ok(());
    }
    let said = output_of(Command::new("node").arg(script("behaviour.mjs")))?;
    assert_eq!(String::from_utf8(said)?, "all is well\n");
    Ok(())
}

#[test]
fn scenes_are_read_sorted_and_picked_as_rust_has_them() -> Test {
    if !has_node() {
        println!("skipped: node is not installed");
        return Ok(());
    }
    let coloured = {
        let mut scene = with_own();
        let matrix = |k: usize| [[1.0, 0.1, 0.0, 0.02 * k as f32], [0.0, 0.9, 0.0, 0.0], [0.0, 0.0, 1.1, -0.1]];
        scene.color_from_template = (0..scene.instances.len()).map(matrix).collect();
        scene
    };
    let plain = InstancedScene { pixel_filter: Default::default(), ..sample_scene() };
    let folder = tempfile::tempdir()?;
    let (file, cameras) = (folder.path().join("scene.instgs"), folder.path().join("cameras.json"));
    let views: Vec<Camera> = ring(DVec3::Z).into_iter().step_by(5).collect();
    write_cameras(&cameras, &views)?;
    let (mut shown, mut seen) = (0, BTreeSet::new());
    for scene in [with_own(), with_ablations(), with_low_sh_offsets(), coloured, plain] {
        // Large enough to hide each other.
        let scene = enlarged(scene);
        for pack in [Pack::F32, Pack::F16, Pack::Q8, Pack::Small] {
            write_scene_file_packed(&file, &scene, pack)?;
            let mut node = Command::new("node");
            node.arg(script("scenes.mjs")).args([&file, &cameras]).arg(STEP.to_string());
            let page: Value = serde_json::from_slice(&output_of(&mut node)?)?;
            let rust = read_scene_file(&file)?;
            same_values(&page, &rust);
            let picked = same_pictures(&page, &rust, &views);
            shown += picked.len();
            seen.extend(picked);
        }
    }
    assert!(shown > 1000 && seen.len() > 4, "{shown} pixels show something, of the rows {seen:?}: they prove little");
    Ok(())
}

fn enlarged(mut scene: InstancedScene) -> InstancedScene {
    for cloud in [&mut scene.templates, &mut scene.own, &mut scene.background] {
        // Long and flat, so that it matters how they lie.
        cloud.log_scales.iter_mut().for_each(|[x, y, z]| (*x, *y, *z) = (*x + 4.5, *y + 3.5, *z + 2.0));
        cloud.opacity_logits.iter_mut().for_each(|logit| *logit += 1.5);
    }
    scene
}

/// The numbers of a list.
fn numbers(of: &Value) -> Vec<f64> {
    of.as_array().expect("a list").iter().map(|v| v.as_f64().expect("a number")).collect()
}

/// Holds lists of numbers against one another: equal but for the rounding of sums, which differ in order.
fn near(what: &str, page: &[f64], rust: &[f32]) {
    assert_eq!(page.len(), rust.len(), "{what}");
    for (i, (page, rust)) in page.iter().zip(rust).enumerate() {
        let rust = f64::from(*rust);
        assert!((page - rust).abs() <= 2e-6 * (1.0 + rust.abs()), "{what} {i}: {page} in the page, {rust} here");
    }
}

/// All that the page reads of a file.
fn same_values(page: &Value, rust: &InstancedScene) {
    let clouds = [&rust.templates, &rust.own, &rust.background];
    let degree = clouds.iter().filter(|cloud| !cloud.is_empty()).map(|cloud| cloud.sh_degree).max().unwrap_or(0);
    let of = |field: fn(&Gaussians) -> Vec<f32>| clouds.map(field).concat();
    let pool = &page["pool"];
    assert_eq!((&pool["count"], &pool["coefficients"]), (&rust.source_len().into(), &sh_coefficients(degree).into()));
    near("means", &numbers(&pool["means"]), &of(|cloud| cloud.means.concat()));
    near("quats", &numbers(&pool["quats"]), &of(|cloud| cloud.quats.concat()));
    near("logScales", &numbers(&pool["logScales"]), &of(|cloud| cloud.log_scales.concat()));
    near("logits", &numbers(&pool["logits"]), &of(|cloud| cloud.opacity_logits.clone()));
    let padded = clouds.map(|cloud| {
        let empty = vec![[0.0; 3]; sh_coefficients(degree) - cloud.sh_coefficients().min(sh_coefficients(degree))];
        (0..cloud.len()).flat_map(|i| [cloud.sh_of(i), &empty].concat().concat()).collect::<Vec<_>>()
    });
    near("sh", &numbers(&pool["sh"]), &padded.concat());
    let offsets = &page["offsets"];
    near("offset means", &numbers(&offsets["means"]), &rust.offsets.means.concat());
    near("offset shDc", &numbers(&offsets["shDc"]), &rust.offsets.sh_dc.concat());
    near("offset logits", &numbers(&offsets["logits"]), &rust.offsets.opacity_logits);
    near("offset logScales", &numbers(&offsets["logScales"]), &rust.offsets.log_scales.concat());
    near("offset quats", &numbers(&offsets["quats"]), &rust.offsets.quats.concat());
    near("offset shRest", &numbers(&offsets["shRest"]), &rust.offsets.sh_rest.concat());
    let (filter, near_plane) = (rust.pixel_filter, rust.near_plane.0);
    near(
        "pixel",
        &[page["dilation"].as_f64().expect("it"), page["near"].as_f64().expect("it")],
        &[filter.dilation_px2, near_plane],
    );
    assert_eq!(page["antialias"], filter.antialias);
    let names: Vec<_> =
        page["names"].as_array().expect("names").iter().map(|name| (&name["name"], &name["id"])).collect();
    let chair: Value = "chair \"a\"".into();
    assert_eq!((names.len(), names[0], names[2]), (rust.instances.len(), (&chair, &4.into()), (&chair, &9.into())));
    // Rows: each instance's template and own Gaussians, then the background.
    let rows = page["rows"].as_array().expect("rows");
    let mut at = rows.iter();
    for (k, instance) in rust.instances.iter().enumerate() {
        let (row, range) = (at.next().expect("a row"), rust.template_ranges[instance.template as usize]);
        let first_offset = instance.first_offset.map_or(-1, i64::from);
        let indices = ["owner", "first", "count", "firstOffset"].map(|name| row[name].as_i64());
        assert_eq!(indices, [k as i64, range.first.into(), range.count.into(), first_offset].map(Some));
        near("world", &numbers(&row["world"]), instance.world_from_template.rows().as_flattened());
        if let Some(matrix) = rust.color_from_template.get(k) {
            near("colour", &numbers(&row["colour"]), matrix.as_flattened());
        }
        let own = rust.own_range(k);
        if own.count > 0 {
            let row = at.next().expect("a row");
            let first = rust.templates.len() as i64 + i64::from(own.first);
            let indices = ["owner", "first", "count", "firstOffset"].map(|name| row[name].as_i64());
            assert_eq!(indices, [k as i64, first, own.count.into(), -1].map(Some));
        }
    }
    let background = at.next().expect("the background");
    assert_eq!((&background["owner"], &background["count"]), (&(-1).into(), &rust.background.len().into()));
    assert!(at.next().is_none());
    // Texels of a Gaussian: mean and logit, quaternion, sizes and nothing.
    let geometry = numbers(&page["texels"]["geometry"]);
    let texels = clouds.map(|cloud| {
        let of = |i: usize| {
            let ([x, y, z], [a, b, c]) = (cloud.means[i], cloud.log_scales[i]);
            [&[x, y, z, cloud.opacity_logits[i]][..], &cloud.quats[i], &[a, b, c, 0.0]].concat()
        };
        (0..cloud.len()).flat_map(of).collect::<Vec<_>>()
    });
    near("texels", &geometry, &texels.concat());
    assert_eq!(page["texels"]["shTexels"], sh_coefficients(degree).div_ceil(2));
}

/// The order of splats, and what pixels show; returns the rows of those that show something.
fn same_pictures(page: &Value, rust: &InstancedScene, views: &[Camera]) -> Vec<usize> {
    let world = rust.flatten();
    // The row that each of the flat list belongs to.
    let counts: Vec<usize> =
        page["rows"].as_array().expect("rows").iter().map(|row| row["count"].as_u64().expect("it") as usize).collect();
    let rows: Vec<usize> = counts.iter().enumerate().flat_map(|(row, &count)| vec![row; count]).collect();
    assert_eq!(rows.len(), world.len());
    let mut shown = Vec::new();
    for (camera, view) in views.iter().zip(page["views"].as_array().expect("views")) {
        let point = |i: usize| DVec3::from_array(world.means[i].map(f64::from));
        let depth = |i: usize| camera.view_from_point(point(i)).z;
        let sorted: Vec<usize> = numbers(&view["sorted"]).into_iter().map(|i| i as usize).collect();
        let beyond = (0..world.len()).filter(|&i| depth(i) > f64::from(rust.near_plane.0));
        let mut all = sorted.clone();
        all.sort_unstable();
        assert_eq!(all, beyond.collect::<Vec<_>>());
        assert!(sorted.windows(2).all(|pair| depth(pair[0]) <= depth(pair[1]) + 1e-5), "the nearest comes first");
        let picked = view["picked"].as_array().expect("picks");
        let pixels =
            (0..camera.height).step_by(STEP).flat_map(|y| (0..camera.width).step_by(STEP).map(move |x| (x, y)));
        for ((x, y), page) in pixels.zip(picked) {
            let mut left = 1.0;
            let here = sorted.iter().find(|&&i| {
                let alpha = alpha_at(&world, i, rust, camera, [f64::from(x) + 0.5, f64::from(y) + 0.5]);
                left *= 1.0 - if alpha < 1.0 / 255.0 { 0.0 } else { alpha };
                left < 0.5
            });
            assert_eq!(page["row"].as_u64(), here.map(|&i| rows[i] as u64), "({x}, {y}) of {}", camera.name);
            if let Some(&i) = here {
                let apart = DVec3::from_slice(&numbers(&page["point"])) - point(i);
                assert!(apart.length() < 1e-5, "({x}, {y}): {apart}");
                shown.push(rows[i]);
            }
        }
    }
    shown
}

/// The alpha of a Gaussian of the world at a pixel, by its covariance: the page has it by its axes.
fn alpha_at(world: &Gaussians, i: usize, scene: &InstancedScene, camera: &Camera, at: [f64; 2]) -> f64 {
    let view = camera.view_from_point(DVec3::from_array(world.means[i].map(f64::from)));
    let [w, x, y, z] = world.quats[i].map(f64::from);
    let sizes = DVec3::from_array(world.log_scales[i].map(|size| f64::from(size).exp()));
    let axes =
        camera.rotation() * DMat3::from_quat(DQuat::from_xyzw(x, y, z, w).normalize()) * DMat3::from_diagonal(sizes);
    let covariance = axes * axes.transpose();
    // Slopes are held at the borders of the picture, with 15 % around it.
    let slope = |slope: f64, centre: f64, focal: f64, side: u32| {
        let side = f64::from(side);
        slope.clamp(-(centre + 0.15 * side) / focal, (1.15 * side - centre) / focal)
    };
    let slopes = [
        slope(view.x / view.z, camera.cx, camera.fx, camera.width),
        slope(view.y / view.z, camera.cy, camera.fy, camera.height),
    ];
    let rows =
        [camera.fx / view.z * DVec3::new(1.0, 0.0, -slopes[0]), camera.fy / view.z * DVec3::new(0.0, 1.0, -slopes[1])];
    let of = |a: usize, b: usize| rows[a].dot(covariance * rows[b]);
    let filter = scene.pixel_filter;
    let dilation = f64::from(filter.dilation_px2);
    let (xx, xy, yy) = (of(0, 0) + dilation, of(0, 1), of(1, 1) + dilation);
    let det = xx * yy - xy * xy;
    let sharp = (of(0, 0) * of(1, 1) - xy * xy).max(0.0);
    let opacity = 1.0 / (1.0 + (-f64::from(world.opacity_logits[i])).exp());
    let opacity = if filter.antialias { opacity * (sharp / det).max(2.5e-5).sqrt() } else { opacity };
    let dx = at[0] - camera.fx * view.x / view.z - camera.cx;
    let dy = at[1] - camera.fy * view.y / view.z - camera.cy;
    let power = (yy * dx * dx - 2.0 * xy * dx * dy + xx * dy * dy) / det;
    (opacity * (-0.5 * power).exp()).min(0.99)
}
