//! Datasets: those of `../shared/data`, and what the program makes for itself: photos of a known scene, transforms.json, points.

use std::fs;
use std::path::{Path, PathBuf};

use assert_cmd::Command;
use glam::{DMat4, DVec4};
use instgs_io::{save_scene, write_cameras};
use instgs_vk::math::sh::SH_C0;
use instgs_vk::scene::{Camera, Gaussians, InstancedScene};
use serde_json::{Value, json};

/// A folder of `../shared/data`, which only ignored tests may ask for. Fails where this machine does not have it.
pub(crate) fn shared_data(name: &str) -> PathBuf {
    let path = crate::common::repository().join("../shared/data").join(name);
    assert!(path.exists(), "{} does not exist: run this test where it does", path.display());
    path
}

/// A transforms.json of cameras with the same intrinsics: poses are world from camera, in OpenGL axes.
pub(crate) fn transforms(cameras: &[Camera]) -> Value {
    let frame = |camera: &Camera| {
        let flip = DMat4::from_diagonal(DVec4::new(1.0, -1.0, -1.0, 1.0));
        let rows = (camera.world_from_view() * flip).transpose().to_cols_array_2d();
        json!({ "file_path": format!("images/{}.png", camera.name), "transform_matrix": rows })
    };
    let first = &cameras[0];
    let frames: Vec<Value> = cameras.iter().map(frame).collect();
    json!({ "w": first.width, "h": first.height, "fl_x": first.fx, "fl_y": first.fy, "cx": first.cx, "cy": first.cy,
            "frames": frames })
}

/// Makes `at/data`: images of the scene rendered by `render` (the program's command for it), and transforms.json. Leaves
/// `at/scene.instgs` and `at/cameras.json` too.
pub(crate) fn photograph(mut render: Command, scene: &InstancedScene, cameras: &[Camera], at: &Path) {
    save_scene(&at.join("scene.instgs"), scene).unwrap();
    write_cameras(&at.join("cameras.json"), cameras).unwrap();
    render.args(["render", "--scene"]).arg(at.join("scene.instgs")).arg("--camera").arg(at.join("cameras.json"));
    render.arg("--out").arg(at.join("data/images")).assert().success();
    fs::write(at.join("data/transforms.json"), transforms(cameras).to_string()).unwrap();
}

/// Writes every `stride`-th mean of a cloud with its base colour as `points3d.ply`; returns how many.
pub(crate) fn write_points(cloud: &Gaussians, stride: usize, path: &Path) -> usize {
    let kept: Vec<usize> = (0..cloud.len()).step_by(stride).collect();
    let mut text = format!(
        "ply\nformat ascii 1.0\nelement vertex {}\nproperty float x\nproperty float y\nproperty float z\n\
         property uchar red\nproperty uchar green\nproperty uchar blue\nend_header\n",
        kept.len()
    );
    for &i in &kept {
        let [x, y, z] = cloud.means[i];
        let rgb = cloud.sh_of(i)[0].map(|c| ((f64::from(c) * SH_C0 + 0.5).clamp(0.0, 1.0) * 255.0).round());
        text += &format!("{x} {y} {z} {} {} {}\n", rgb[0], rgb[1], rgb[2]);
    }
    fs::write(path, text).unwrap();
    kept.len()
}
