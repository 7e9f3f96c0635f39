//! Photos, and pictures of floats.

use std::io::Cursor;

use image::{DynamicImage, ImageFormat, ImageResult, RgbImage, RgbaImage};
use instgs_io::{IoError, ktx2};

use crate::path;

fn encoded(picture: &DynamicImage, format: ImageFormat) -> ImageResult<Vec<u8>> {
    let mut out = Cursor::new(Vec::new());
    picture.write_to(&mut out, format)?;
    Ok(out.into_inner())
}

fn rgb() -> DynamicImage {
    DynamicImage::ImageRgb8(RgbImage::from_fn(12, 9, |x, y| image::Rgb([x as u8 * 20, y as u8 * 25, (x * y) as u8])))
}

/// A photo of 12x9 pixels as JPEG.
pub fn jpeg() -> ImageResult<Vec<u8>> {
    encoded(&rgb(), ImageFormat::Jpeg)
}

/// A photo of 12x9 pixels as PNG.
pub fn png() -> ImageResult<Vec<u8>> {
    encoded(&rgb(), ImageFormat::Png)
}

/// A picture with coverage.
pub fn png_with_alpha() -> ImageResult<Vec<u8>> {
    let picture = RgbaImage::from_fn(5, 4, |x, y| image::Rgba([x as u8 * 50, y as u8 * 60, 9, (x * 60) as u8]));
    encoded(&DynamicImage::ImageRgba8(picture), ImageFormat::Png)
}

/// A picture of floats with four channels.
pub fn ktx2() -> Result<Vec<u8>, IoError> {
    let picture = ktx2::FloatImage { width: 2, height: 2, channels: 4, values: vec![0.5; 16] };
    ktx2::ktx2_bytes(&picture, path())
}
