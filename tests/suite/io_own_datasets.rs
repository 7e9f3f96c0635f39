//! Datasets and clouds that the tests write themselves; `io_datasets` and `io_real_files` do the same with real ones.

use std::fmt::Write as _;
use std::fs;
use std::path::Path;

use glam::DVec3;
use instgs_io::colmap::{PosedImage, read_colmap};
use instgs_io::nerf::read_transforms;
use instgs_io::view_image::OPAQUE;
use instgs_io::{load_scene, load_view, read_spz, read_views, write_ply, write_spz, write_transforms};
use instgs_vk::math::covariance::quat_from_rotation;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::Camera;
use instgs_vk::scene::PixelFilter;

use crate::common::random_scene::random_case;

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// Five cameras around the origin, with a focal length and a principal point that differ by axis.
fn cameras() -> Vec<Camera> {
    let camera = |k: u32| {
        let angle = 1.2 * f64::from(k);
        let eye = DVec3::new(3.0 * angle.cos(), 3.0 * angle.sin(), 0.4 * f64::from(k) - 0.5);
        let camera = Camera::look_at(&format!("{k:02}"), eye, DVec3::ZERO, DVec3::Z, 0.9, (54, 96));
        Camera { fy: 1.1 * camera.fx, cx: 26.0, cy: 47.5, ..camera }
    };
    (0..5).map(camera).collect()
}

fn write_transforms_of(cameras: &[Camera], folder: &Path) -> Outcome {
    let views: Vec<_> = cameras.iter().map(|c| (c, format!("images/{}.png", c.name))).collect();
    Ok(write_transforms(&folder.join("transforms.json"), &views, None)?)
}

/// Quaternion (w, x, y, z) and translation of view from world, as COLMAP has them.
fn colmap_pose(camera: &Camera) -> [f64; 7] {
    let ([w, x, y, z], t) = (quat_from_rotation(camera.rotation()), camera.translation());
    [w, x, y, z, t.x, t.y, t.z]
}

/// `cameras.txt` and `images.txt`: one PINHOLE camera per image, and no points.
fn write_colmap_text(cameras: &[Camera], folder: &Path) -> Outcome {
    let (mut intrinsics, mut images) = (String::new(), String::new());
    for (id, c) in (1..).zip(cameras) {
        writeln!(intrinsics, "{id} PINHOLE {} {} {} {} {} {}", c.width, c.height, c.fx, c.fy, c.cx, c.cy)?;
        let pose = colmap_pose(c).map(|v| v.to_string()).join(" ");
        writeln!(images, "{id} {pose} {id} {}.png\n", c.name)?;
    }
    fs::create_dir_all(folder)?;
    fs::write(folder.join("cameras.txt"), intrinsics)?;
    Ok(fs::write(folder.join("images.txt"), images)?)
}

/// The same as `cameras.bin` and `images.bin`.
fn write_colmap_binary(cameras: &[Camera], folder: &Path) -> Outcome {
    const PINHOLE: u32 = 1;
    let count = (cameras.len() as u64).to_le_bytes();
    let (mut intrinsics, mut images) = (count.to_vec(), count.to_vec());
    for (id, c) in (1u32..).zip(cameras) {
        intrinsics.extend([id, PINHOLE].map(u32::to_le_bytes).concat());
        intrinsics.extend([c.width, c.height].map(|v| u64::from(v).to_le_bytes()).concat());
        intrinsics.extend([c.fx, c.fy, c.cx, c.cy].map(f64::to_le_bytes).concat());
        images.extend(id.to_le_bytes());
        images.extend(colmap_pose(c).map(f64::to_le_bytes).concat());
        images.extend(id.to_le_bytes());
        images.extend(format!("{}.png\0", c.name).as_bytes());
        // No points.
        images.extend(0u64.to_le_bytes());
    }
    fs::create_dir_all(folder)?;
    fs::write(folder.join("cameras.bin"), intrinsics)?;
    Ok(fs::write(folder.join("images.bin"), images)?)
}

fn assert_same_cameras(got: &[PosedImage], want: &[Camera], format: &str) {
    assert_eq!(got.len(), want.len(), "{format}");
    for (got, want) in got.iter().map(|image| &image.camera).zip(want) {
        assert_eq!((&got.name, got.width, got.height), (&want.name, want.width, want.height), "{format}");
        let values = |c: &Camera| [c.view_from_world.as_flattened(), &[c.fx, c.fy, c.cx, c.cy]].concat();
        for (a, b) in values(got).iter().zip(values(want)) {
            assert!((a - b).abs() < 1e-12, "{format}, {}: {a} {b}", got.name);
        }
    }
}

#[test]
fn colmap_text_and_binary_and_transforms_hold_the_same_cameras() -> Outcome {
    let folder = tempfile::tempdir()?;
    let at = |name: &str| folder.path().join(name);
    let cameras = cameras();
    write_transforms_of(&cameras, folder.path())?;
    write_colmap_text(&cameras, &at("text"))?;
    write_colmap_binary(&cameras, &at("binary"))?;
    assert_same_cameras(&read_transforms(&at("transforms.json"))?, &cameras, "transforms.json");
    assert_same_cameras(&read_colmap(&at("text"))?, &cameras, "COLMAP text");
    assert_same_cameras(&read_colmap(&at("binary"))?, &cameras, "COLMAP binary");
    Ok(())
}

#[test]
fn photos_at_half_their_size_are_means_of_four_pixels() -> Outcome {
    let folder = tempfile::tempdir()?;
    let cameras = cameras();
    write_transforms_of(&cameras, folder.path())?;
    fs::create_dir(folder.path().join("images"))?;
    let mut rng = Rng::new(3);
    for camera in &cameras {
        let noise = (0..3 * 54 * 96).map(|_| (255.0 * rng.uniform()) as u8).collect();
        let photo = image::RgbImage::from_raw(54, 96, noise).ok_or("size")?;
        photo.save(folder.path().join(format!("images/{}.png", camera.name)))?;
    }
    for view in &read_views(folder.path())?.views {
        let (big, small) = (load_view(view, None)?, load_view(view, Some(27))?);
        let camera = &small.camera;
        assert_eq!((small.image.width, small.image.height, camera.width, camera.height), (27, 48, 27, 48));
        assert_eq!((camera.fx, camera.cy), (big.camera.fx / 2.0, big.camera.cy / 2.0));
        for (place, pixel) in small.image.rgba.iter().enumerate() {
            let (x, y) = (2 * (place % 27), 2 * (place / 27));
            for (channel, &value) in pixel[..3].iter().enumerate() {
                let at = |x: usize, y: usize| u32::from(big.image.rgba[y * 54 + x][channel]);
                let mean = (at(x, y) + at(x + 1, y) + at(x, y + 1) + at(x + 1, y + 1) + 2) / 4;
                assert_eq!(u32::from(value), mean);
            }
            assert_eq!(pixel[3], OPAQUE);
        }
    }
    Ok(())
}

#[test]
fn random_clouds_survive_ply_and_spz() -> Outcome {
    let folder = tempfile::tempdir()?;
    for seed in 0..8 {
        let cloud = random_case(seed).scene.flatten();
        let ply = folder.path().join("a.ply");
        write_ply(&ply, &cloud, PixelFilter::default())?;
        assert_eq!(load_scene(&ply)?.scene.background, cloud, "seed {seed}");
        // What is written again from what was read is the same: quantisation is stable.
        let (spz, again) = (folder.path().join("a.spz"), folder.path().join("again.spz"));
        write_spz(&spz, &cloud, false)?;
        let read = read_spz(&spz)?.gaussians;
        write_spz(&again, &read, false)?;
        let twice = read_spz(&again)?.gaussians;
        assert_eq!(read.len(), cloud.len());
        assert_eq!((twice.means, twice.log_scales, twice.sh), (read.means, read.log_scales, read.sh), "seed {seed}");
    }
    Ok(())
}
