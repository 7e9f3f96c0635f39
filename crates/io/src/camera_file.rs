//! Camera files (`--camera`): one object or a list of pinhole cameras, OpenCV axes; also the `cameras.json` that INRIA's
//! 3DGS leaves beside a trained scene.

use std::path::Path;

use glam::{DMat3, DVec3};
use serde::Deserialize;
use serde_json::Value;

use crate::error::{IoError, Place};
use crate::json::write_json;
use crate::read_bytes;
use crate::text::{json_error, text_of};
use instgs_vk::scene::camera::{Camera, rigid_rows};

/// Reads a camera file: one camera object or a list.
///
/// # Errors
/// The file cannot be read or parsed, or a camera is invalid.
pub fn read_cameras(path: &Path) -> Result<Vec<Camera>, IoError> {
    parse_cameras(&read_bytes(path)?, path)
}

/// Parses the bytes of a camera file; `path` is only used in messages.
pub fn parse_cameras(bytes: &[u8], path: &Path) -> Result<Vec<Camera>, IoError> {
    let root = parse_json(bytes, path)?;
    if let Some((what, advice)) = of_another_program(&root) {
        return Err(IoError::new(path, format!("is no camera file: {what}")).advise(advice));
    }
    let values = match root {
        serde_json::Value::Array(values) if values.is_empty() => {
            return Err(IoError::new(path, "holds no camera").advise("put one into its list"));
        }
        serde_json::Value::Array(values) => values,
        one @ serde_json::Value::Object(_) => vec![one],
        _ => {
            return Err(IoError::new(path, "is neither a camera object nor a list of them")
                .advise("give the cameras of a data set with --data, or write such a list"));
        }
    };
    let mut cameras = Vec::with_capacity(values.len());
    for (i, value) in values.into_iter().enumerate() {
        let name = value.get("name").and_then(|n| n.as_str()).map(|n| format!(" ({n})")).unwrap_or_default();
        let fail = |what: String| IoError::new(path, what).at(Place::Field(format!("camera {i}{name}")));
        let camera = match InriaCamera::of(&value) {
            Some(camera) => camera.camera(),
            None => serde_json::from_value::<Camera>(value).map_err(|e| fail(e.to_string()))?,
        };
        camera.validate().map_err(|e| fail(e.to_string()))?;
        cameras.push(camera);
    }
    Ok(cameras)
}

/// A camera of the `cameras.json` that INRIA's 3DGS leaves beside a trained scene: the position in the world, and the rows of
/// the rotation from view to world.
#[derive(Deserialize)]
struct InriaCamera {
    img_name: String,
    width: u32,
    height: u32,
    position: [f64; 3],
    rotation: [[f64; 3]; 3],
    fx: f64,
    fy: f64,
}

impl InriaCamera {
    fn of(value: &Value) -> Option<Self> {
        Self::deserialize(value).ok()
    }

    fn camera(self) -> Camera {
        let [x, y, z] = self.rotation.map(DVec3::from_array);
        // Its rows are those of world_from_view, whose columns are the view's axes.
        let view_from_world = DMat3::from_cols(x, y, z);
        let name = crate::colmap::stem(&self.img_name);
        Camera {
            name: if name.is_empty() { self.img_name } else { name },
            width: self.width,
            height: self.height,
            fx: self.fx,
            fy: self.fy,
            cx: 0.5 * f64::from(self.width),
            cy: 0.5 * f64::from(self.height),
            view_from_world: rigid_rows(view_from_world, -(view_from_world * DVec3::from_array(self.position))),
        }
    }
}

/// What a JSON file of another program is, and what to do with it.
fn of_another_program(root: &Value) -> Option<(&'static str, &'static str)> {
    let has = |key: &str| root.get(key).is_some();
    if has("frames") {
        return Some(("it is a transforms.json", "give its folder with --data"));
    }
    if has("camera_path") || has("keyframes") {
        return Some((
            "it is a camera path of nerfstudio, whose axes and scale are those of its training",
            "give the cameras of the data set with --data, or write a list of cameras with view_from_world",
        ));
    }
    if has("images") && has("annotations") {
        return Some(("it is a COCO file", "give the cameras of the data set with --data"));
    }
    None
}

/// Writes a list of cameras as JSON.
pub fn write_cameras(path: &Path, cameras: &[Camera]) -> Result<(), IoError> {
    write_json(path, cameras)
}

/// Parses JSON, with or without a byte order mark; an error names the line.
pub(crate) fn parse_json(bytes: &[u8], path: &Path) -> Result<Value, IoError> {
    let text = text_of(bytes, path)?;
    serde_json::from_str(text).map_err(|e| json_error(text, path, &e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn lists_and_single_objects_and_named_errors() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("cameras.json");
        let cameras: Vec<_> = (0..3)
            .map(|i| {
                Camera::look_at(
                    &format!("c{i}"),
                    DVec3::new(f64::from(i), 1.0, -4.0),
                    DVec3::ZERO,
                    DVec3::Y,
                    0.9,
                    (64, 48),
                )
            })
            .collect();
        write_cameras(&path, &cameras)?;
        // To the last bit, by serde_json's feature `float_roundtrip` of the workspace: `instgs_blocks::split` compares plans so.
        assert_eq!(read_cameras(&path)?, cameras);
        let one = serde_json::to_vec(&cameras[1])?;
        assert_eq!(parse_cameras(&one, &path)?, cameras[1..2]);

        let mut bad = cameras.clone();
        bad[2].fx = -1.0;
        let text = parse_cameras(&serde_json::to_vec(&bad)?, &path).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text.contains("camera 2 (c2)") && text.contains("fx"), "{text}");
        let text = parse_cameras(b"[{\"name\":\"q\"}]", &path).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text.contains("camera 0 (q)") && text.contains("width"), "{text}");
        assert!(parse_cameras(b"{\n\n!", &path).is_err_and(|e| e.to_string().contains("line 3")));
        assert!(parse_cameras(b"[]", &path).is_err());
        Ok(())
    }
}
