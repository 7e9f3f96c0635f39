//! Camera files (`--camera`): one object or a list of pinhole cameras, OpenCV axes.

use std::path::Path;

use crate::error::{IoError, Place};
use crate::json::write_json;
use crate::read_bytes;
use instgs_vk::scene::camera::Camera;

/// Reads a camera file: one camera object or a list.
///
/// # Errors
/// The file cannot be read or parsed, or a camera is invalid.
pub fn read_cameras(path: &Path) -> Result<Vec<Camera>, IoError> {
    parse_cameras(&read_bytes(path)?, path)
}

/// Parses the bytes of a camera file; `path` is only used in messages.
pub fn parse_cameras(bytes: &[u8], path: &Path) -> Result<Vec<Camera>, IoError> {
    let values = match parse_json(bytes, path)? {
        serde_json::Value::Array(values) if values.is_empty() => return Err(IoError::new(path, "holds no camera")),
        serde_json::Value::Array(values) => values,
        one @ serde_json::Value::Object(_) => vec![one],
        _ => return Err(IoError::new(path, "is neither a camera object nor a list of them")),
    };
    let mut cameras = Vec::with_capacity(values.len());
    for (i, value) in values.into_iter().enumerate() {
        let name = value.get("name").and_then(|n| n.as_str()).map(|n| format!(" ({n})")).unwrap_or_default();
        let fail = |what: String| IoError::new(path, what).at(Place::Field(format!("camera {i}{name}")));
        let camera: Camera = serde_json::from_value(value).map_err(|e| fail(e.to_string()))?;
        camera.validate().map_err(|e| fail(e.to_string()))?;
        cameras.push(camera);
    }
    Ok(cameras)
}

/// Writes a list of cameras as JSON.
pub fn write_cameras(path: &Path, cameras: &[Camera]) -> Result<(), IoError> {
    write_json(path, cameras)
}

/// Parses JSON; an error names the line.
pub(crate) fn parse_json(bytes: &[u8], path: &Path) -> Result<serde_json::Value, IoError> {
    serde_json::from_slice(bytes)
        .map_err(|e| IoError::new(path, format!("is not valid JSON: {e}")).at(Place::Line(e.line() as u64)))
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
        // serde_json without its feature `float_roundtrip` may miss the last bit.
        let near = |a: &Camera, b: &Camera| {
            let pose = |c: &Camera| c.view_from_world.as_flattened().to_vec();
            pose(a).iter().zip(pose(b)).all(|(x, y)| (x - y).abs() < 1e-14)
                && (&a.name, a.width, a.height) == (&b.name, b.width, b.height)
        };
        let back = read_cameras(&path)?;
        assert!(back.len() == 3 && back.iter().zip(&cameras).all(|(a, b)| near(a, b)));
        let one = serde_json::to_vec(&cameras[1])?;
        assert!(near(&parse_cameras(&one, &path)?[0], &cameras[1]));

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
