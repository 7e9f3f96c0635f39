//! The images of a dataset's views, ready for training: decoded, masked, undistorted and downscaled.

use std::io::Cursor;
use std::path::Path;

use image::metadata::Orientation;
use image::{DynamicImage, ImageDecoder, ImageFormat, ImageReader, Limits};

use crate::dataset::View;
use crate::error::IoError;
use crate::host_memory::{available_bytes, check_reading};
use crate::{jpeg_end, read_bytes, view_resample};
use instgs_vk::scene::camera::Camera;

/// An image to train on or to compare with: `width * height` pixels, row by row from the top.
///
/// The first three bytes are red, green and blue in the file's own encoding (sRGB), straight, not premultiplied. The
/// fourth is 0 for an ignored pixel, which has no information about the scene; otherwise it is the pixel's coverage:
/// byte a stands for `(a - 1) / 254`, so 255 is opaque and 1 fully transparent.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct ViewImage {
    /// Width of the image, pixels.
    pub width: u32,
    /// Height of the image, pixels.
    pub height: u32,
    /// Red, green, blue, and coverage (or 0) of each pixel.
    pub rgba: Vec<[u8; 4]>,
}

/// Pictures that take fewer bytes are decoded without a look at the memory that is available.
const LARGE_PICTURE: u64 = 256 << 20;

/// Fourth byte of an ignored pixel.
pub const IGNORED: u8 = 0;
/// Fourth byte of an opaque pixel.
pub const OPAQUE: u8 = 255;

impl ViewImage {
    /// Size of the pixels in bytes.
    pub fn bytes(&self) -> u64 {
        self.rgba.len() as u64 * 4
    }

    /// True if every pixel is opaque: neither ignored nor partly transparent.
    pub fn is_opaque(&self) -> bool {
        self.rgba.iter().all(|p| p[3] == OPAQUE)
    }
}

/// An image and its camera, both of the same size.
#[derive(Clone, Debug, PartialEq)]
pub struct LoadedView {
    /// The undistorted image.
    pub image: ViewImage,
    /// The pinhole camera, scaled like the image.
    pub camera: Camera,
}

/// Reads the image of a view (JPEG or PNG of any depth and channels; alpha becomes coverage). The EXIF orientation is obeyed
/// if the camera has the size of the turned picture and not of the stored one, else ignored. Pixels that are black or fully
/// transparent in the view's mask are ignored; in a JPEG, which blurs edges, black is the lower half of the range. Lens
/// distortion is removed with the same intrinsics, so pixels at the border may become ignored. If `width` is smaller than
/// the image's, it is downscaled to that width: the height is `round(height * width / old width)`, at least 1, and the
/// intrinsics are scaled per axis. A larger `width`, or `None`, changes nothing.
///
/// # Errors
/// A file is missing, cannot be decoded or is truncated, takes more memory than is available, or the size of the image or
/// mask is not the camera's.
pub fn load_view(view: &View, width: Option<u32>) -> Result<LoadedView, IoError> {
    let mut camera = view.camera.clone();
    let mut image = decode(&view.image_path, &camera)?;
    if let Some(mask) = &view.mask_path {
        apply_mask(&mut image, mask, &camera)?;
    }
    if let Some(distortion) = &view.distortion {
        image = view_resample::undistort(&image, &camera, distortion);
    }
    let small = camera_at_width(&camera, width);
    if (small.width, small.height) != (camera.width, camera.height) {
        image = view_resample::downscale(&image, small.width, small.height);
        camera = small;
    }
    Ok(LoadedView { image, camera })
}

/// The camera of a view as [`load_view`] returns it.
pub fn camera_at_width(camera: &Camera, width: Option<u32>) -> Camera {
    let Some(width) = width.filter(|w| *w < camera.width) else { return camera.clone() };
    let [width, height] = view_resample::downscaled_size(camera.width, camera.height, width);
    camera.resized(width, height)
}

fn decode(path: &Path, camera: &Camera) -> Result<ViewImage, IoError> {
    let decoded = decode_sized(path, camera, "image")?.0.into_rgba8().into_raw();
    let rgba = decoded.as_chunks().0.iter().map(|&[r, g, b, alpha]| [r, g, b, coverage_byte(alpha)]).collect();
    Ok(ViewImage { width: camera.width, height: camera.height, rgba })
}

/// The fourth byte of [`ViewImage`] for an 8-bit alpha: `1 + alpha * 254 / 255`, rounded.
fn coverage_byte(alpha: u8) -> u8 {
    let scaled = (u32::from(alpha) * 254 * 2 + 255) / (2 * 255);
    scaled as u8 + 1
}

fn apply_mask(image: &mut ViewImage, path: &Path, camera: &Camera) -> Result<(), IoError> {
    let (mask, format) = decode_sized(path, camera, "mask")?;
    let most_black = if format == Some(ImageFormat::Jpeg) { u16::MAX / 2 } else { 0 };
    // 16 bits, because the smallest values of a deeper mask would become 0 in 8 bits.
    let mask = mask.into_luma_alpha16().into_raw();
    for (pixel, &[grey, alpha]) in image.rgba.iter_mut().zip(mask.as_chunks().0) {
        if grey <= most_black || alpha == 0 {
            pixel[3] = IGNORED;
        }
    }
    Ok(())
}

/// Decodes an image that must have the camera's size, which is checked before any allocation for the pixels; and the
/// format of its file.
fn decode_sized(path: &Path, camera: &Camera, kind: &str) -> Result<(DynamicImage, Option<ImageFormat>), IoError> {
    let fail = |e: &dyn std::fmt::Display| IoError::new(path, format!("cannot decode the {kind}: {e}"));
    let bytes = read_bytes(path)?;
    if jpeg_end::is_cut_jpeg(&bytes) {
        return Err(fail(&"the JPEG ends early").advise("copy it again"));
    }
    let reader = ImageReader::new(Cursor::new(&bytes)).with_guessed_format().map_err(|e| fail(&e))?;
    let format = reader.format();
    let mut decoder = reader.into_decoder().map_err(|e| fail(&e))?;
    let (size, want) = (decoder.dimensions(), (camera.width, camera.height));
    // Only where it makes the difference: a camera made for the stored pixels does not obey the tag.
    let turn = decoder.orientation().unwrap_or(Orientation::NoTransforms);
    let is_turned = size != want && (size.1, size.0) == want && swaps_sides(turn);
    if size != want && !is_turned {
        let what = format!("the {kind} has {}x{} pixels, and its camera {}x{}", size.0, size.1, want.0, want.1);
        return Err(IoError::new(path, what)
            .advise("use the images that the cameras were made for; --width trains at a smaller size"));
    }
    let pixels = u64::from(size.0) * u64::from(size.1);
    // As decoded, and with four bytes a pixel after that.
    let need = decoder.total_bytes().saturating_add(4 * pixels);
    if need > LARGE_PICTURE {
        check_reading(path, &format!("the {kind} takes"), need, available_bytes())?;
    }
    let mut limits = Limits::no_limits();
    // 16 bytes per pixel is the widest format; the rest is for the decoder's own tables.
    limits.max_alloc = Some(16 * pixels + (64 << 20));
    decoder.set_limits(limits).map_err(|e| fail(&e))?;
    let mut image = DynamicImage::from_decoder(decoder).map_err(|e| fail(&e))?;
    if is_turned {
        image.apply_orientation(turn);
    }
    Ok((image, format))
}

/// True for the EXIF orientations that exchange width and height.
fn swaps_sides(orientation: Orientation) -> bool {
    use Orientation::{Rotate90, Rotate90FlipH, Rotate270, Rotate270FlipH};
    matches!(orientation, Rotate90 | Rotate270 | Rotate90FlipH | Rotate270FlipH)
}

#[cfg(test)]
#[path = "view_image_tests.rs"]
mod tests;
