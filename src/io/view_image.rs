//! Photos of a dataset's views. A stand-in: it neither scales nor undistorts.

use std::path::Path;

use image::ImageReader;

use crate::io::dataset::View;
use crate::io::error::IoError;
use crate::scene::camera::Camera;

/// A photo, row by row from the top.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ViewImage {
    /// Width in pixels.
    pub width: u32,
    /// Height in pixels.
    pub height: u32,
    /// sRGB bytes. The fourth: 0 = the pixel does not count; a in 1..=255 = coverage (a - 1) / 254, and the target's
    /// colour is rgb * coverage + background * (1 - coverage).
    pub rgba: Vec<[u8; 4]>,
}

/// A photo with the camera of exactly this picture.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedView {
    /// The photo.
    pub image: ViewImage,
    /// Its camera; width and height are the photo's.
    pub camera: Camera,
}

/// Reads a view's photo, `width` pixels wide if given.
///
/// # Errors
/// A file that cannot be read or decoded, or of another size than the camera says.
pub fn load_view(view: &View, width: Option<u32>) -> Result<LoadedView, IoError> {
    let path: &Path = &view.image_path;
    let fail = |what: String| IoError::new(path, what);
    let reader = ImageReader::open(path).map_err(|e| fail(format!("cannot read: {e}")))?;
    let picture = reader.decode().map_err(|e| fail(format!("cannot decode: {e}")))?.to_rgba8();
    let (own, camera) = (picture.dimensions(), &view.camera);
    if own != (camera.width, camera.height) {
        return Err(fail(format!("is {}x{}, but its camera is {}x{}", own.0, own.1, camera.width, camera.height)));
    }
    if view.distortion.is_some() || width.is_some_and(|w| w != own.0) {
        return Err(fail("scaling and undistortion are not there yet".into()));
    }
    // 0..=255 to 1..=255: opacity 0 is no coverage, not a pixel that does not count.
    let coverage = |a: u8| ((u32::from(a) * 254 + 127) / 255 + 1) as u8;
    let rgba = picture.pixels().map(|p| [p[0], p[1], p[2], coverage(p[3])]).collect();
    Ok(LoadedView { image: ViewImage { width: own.0, height: own.1, rgba }, camera: camera.clone() })
}
