//! Rendered pictures as PNG files.

use std::io::Write;
use std::path::Path;

use image::{ExtendedColorType, ImageEncoder, codecs::png::PngEncoder};

use super::{IoError, atomic_write};

/// Writes a picture of 8-bit `rgb`, row by row from the top.
///
/// # Errors
/// The length of `rgb` is not `3 * width * height`, or the file cannot be written.
pub fn write_png(path: &Path, rgb: &[u8], (width, height): (u32, u32)) -> Result<(), IoError> {
    let want = 3 * u64::from(width) * u64::from(height);
    if rgb.len() as u64 != want {
        return Err(IoError::new(
            path,
            format!("cannot write: {} bytes where {want} make {width}x{height}", rgb.len()),
        ));
    }
    atomic_write(path, |out| encode_png(out, rgb, (width, height)))
}

/// Writes the bytes of a PNG file: a picture of 8-bit `rgb`, row by row from the top.
///
/// # Errors
/// The length of `rgb` is not `3 * width * height`, or `out` cannot be written.
pub fn encode_png(out: impl Write, rgb: &[u8], (width, height): (u32, u32)) -> std::io::Result<()> {
    PngEncoder::new(out).write_image(rgb, width, height, ExtendedColorType::Rgb8).map_err(std::io::Error::other)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pictures_come_back_and_wrong_lengths_are_named() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.png");
        let rgb = [1, 2, 3, 250, 251, 252];
        write_png(&path, &rgb, (2, 1))?;
        assert_eq!(image::open(&path)?.into_rgb8().into_raw(), rgb);
        let text = write_png(&path, &rgb, (2, 2)).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text.contains("6 bytes where 12"), "{text}");
        Ok(())
    }
}
