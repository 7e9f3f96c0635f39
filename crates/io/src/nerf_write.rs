//! Writes `transforms.json` files that [`super::nerf`] reads.

use std::path::Path;

use glam::{DMat4, DVec4};
use serde_json::json;

use crate::atomic_write;
use crate::error::IoError;
use instgs_vk::scene::Camera;

/// Writes cameras with their images (paths relative to the file) and, optionally, the path of a point cloud. Poses are
/// world from camera in OpenGL axes; every frame has its own intrinsics.
///
/// # Errors
/// The file cannot be written.
pub fn write_transforms(path: &Path, views: &[(&Camera, String)], points: Option<&str>) -> Result<(), IoError> {
    let frame = |(camera, file): &(&Camera, String)| {
        let opencv_from_opengl = DMat4::from_diagonal(DVec4::new(1.0, -1.0, -1.0, 1.0));
        let rows = (camera.world_from_view() * opencv_from_opengl).transpose().to_cols_array_2d();
        json!({ "file_path": file, "w": camera.width, "h": camera.height, "fl_x": camera.fx, "fl_y": camera.fy,
                "cx": camera.cx, "cy": camera.cy, "transform_matrix": rows })
    };
    let mut root = json!({ "camera_model": "PINHOLE", "frames": views.iter().map(frame).collect::<Vec<_>>() });
    if let Some(points) = points {
        root["ply_file_path"] = points.into();
    }
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
}
