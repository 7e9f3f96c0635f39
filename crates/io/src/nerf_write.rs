//! Writes `transforms.json` files that [`super::nerf`] reads.

use std::path::Path;

use glam::{DMat4, DVec4};
use serde_json::{Value, json};

use crate::atomic_write;
use crate::dataset::Split;
use crate::error::IoError;
use instgs_vk::math::distortion::Distortion;
use instgs_vk::scene::Camera;

/// A photo as a `transforms.json` lists it. Paths are relative to the file, or absolute.
#[derive(Clone, Debug)]
pub struct Frame<'a> {
    /// Camera of the undistorted photo.
    pub camera: &'a Camera,
    /// Path of the photo.
    pub file: String,
    /// Distortion of the photo's lens.
    pub distortion: Option<Distortion>,
    /// Path of the mask of pixels that count.
    pub mask: Option<String>,
    /// Split, if the file is to say which; then it must for all frames.
    pub split: Option<Split>,
}

/// Writes cameras with their images (paths relative to the file) and, optionally, the path of a point cloud. Poses are
/// world from camera in OpenGL axes; every frame has its own intrinsics.
///
/// # Errors
/// The file cannot be written.
pub fn write_transforms(path: &Path, views: &[(&Camera, String)], points: Option<&str>) -> Result<(), IoError> {
    let frame = |(camera, file): &(&'_ Camera, String)| frame_value(camera, file);
    write_root(path, views.iter().map(frame).collect(), points, |_| ())
}

/// The same with all that a frame may have: distortion, a mask of pixels, and the split.
///
/// # Errors
/// The file cannot be written.
pub fn write_frames(path: &Path, frames: &[Frame<'_>], points: Option<&str>) -> Result<(), IoError> {
    let value = |frame: &Frame<'_>| {
        let mut value = frame_value(frame.camera, &frame.file);
        if let Some(Distortion { k1, k2, p1, p2, k3, fisheye }) = frame.distortion {
            let terms = match fisheye {
                Some(k) => vec![("k1", k[0]), ("k2", k[1]), ("k3", k[2]), ("k4", k[3])],
                None => vec![("k1", k1), ("k2", k2), ("k3", k3), ("p1", p1), ("p2", p2)],
            };
            terms.into_iter().for_each(|(name, term)| value[name] = term.into());
            value["camera_model"] = if fisheye.is_some() { "OPENCV_FISHEYE" } else { "OPENCV" }.into();
        }
        if let Some(mask) = &frame.mask {
            value["mask_path"] = mask.as_str().into();
        }
        value
    };
    let of = |split: Split| -> Vec<&str> {
        frames.iter().filter(|frame| frame.split == Some(split)).map(|frame| frame.file.as_str()).collect()
    };
    write_root(path, frames.iter().map(value).collect(), points, |root| {
        for (name, files) in [("train_filenames", of(Split::Train)), ("test_filenames", of(Split::Test))] {
            if !files.is_empty() {
                root[name] = files.into();
            }
        }
    })
}

/// Pose, size, intrinsics and photo of a frame.
fn frame_value(camera: &Camera, file: &str) -> Value {
    let opencv_from_opengl = DMat4::from_diagonal(DVec4::new(1.0, -1.0, -1.0, 1.0));
    let rows = (camera.world_from_view() * opencv_from_opengl).transpose().to_cols_array_2d();
    json!({ "file_path": file, "w": camera.width, "h": camera.height, "fl_x": camera.fx, "fl_y": camera.fy,
            "cx": camera.cx, "cy": camera.cy, "transform_matrix": rows })
}

fn write_root(
    path: &Path,
    frames: Vec<Value>,
    points: Option<&str>,
    more: impl FnOnce(&mut Value),
) -> Result<(), IoError> {
    let mut root = json!({ "camera_model": "PINHOLE", "frames": frames });
    if let Some(points) = points {
        root["ply_file_path"] = points.into();
    }
    more(&mut root);
    let text = format!("{root:#}\n");
    atomic_write(path, |out| out.write_all(text.as_bytes()))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::nerf::read_transforms;
    use glam::DVec3;

    #[test]
    fn cameras_come_back() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("transforms.json");
        let eye = DVec3::new(1.0, 2.0, 3.0);
        let camera = Camera::look_at("a", eye, DVec3::ZERO, DVec3::Z, 0.8, (33, 17));
        write_transforms(&path, &[(&camera, "images/a.png".into())], Some("points3d.ply"))?;
        let read = read_transforms(&path)?;
        assert_eq!((read.len(), read[0].file.as_str()), (1, "images/a.png"));
        let back = &read[0].camera;
        assert_eq!((back.width, back.fx, back.cy, &back.name), (33, camera.fx, 8.5, &camera.name));
        let pairs = back.view_from_world.iter().flatten().zip(camera.view_from_world.iter().flatten());
        assert!(pairs.into_iter().all(|(a, b)| (a - b).abs() < 1e-12));
        Ok(())
    }

    #[test]
    fn distortion_masks_and_splits_come_back() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("transforms.json");
        let camera = Camera::look_at("a", DVec3::X, DVec3::ZERO, DVec3::Z, 0.8, (33, 17));
        let lens = Distortion { k1: 0.1, k2: -0.02, p1: 1e-3, p2: -2e-3, k3: 0.003, fisheye: None };
        let fisheye = Distortion { fisheye: Some([0.1, 0.2, -0.3, 0.04]), ..Distortion::default() };
        let frame = |file: &str, distortion, mask: Option<&str>, split| Frame {
            camera: &camera,
            file: file.into(),
            distortion,
            mask: mask.map(str::to_owned),
            split: Some(split),
        };
        let frames = [
            frame("../photos/a.png", Some(lens), Some("../m/a.png"), Split::Train),
            frame("/photos/b.png", Some(fisheye), None, Split::Test),
            frame("../photos/c.png", None, None, Split::Train),
        ];
        write_frames(&path, &frames, None)?;
        let read = read_transforms(&path)?;
        assert_eq!(read.len(), 3);
        for (read, want) in read.iter().zip(&frames) {
            assert_eq!((&read.file, read.distortion, &read.mask), (&want.file, want.distortion, &want.mask));
            assert_eq!(read.split, want.split);
        }
        Ok(())
    }
}
