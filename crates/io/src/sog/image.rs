//! Lossless images of 8-bit values: WebP, which is written, or PNG, which some programs write.

use std::io::Cursor;
use std::path::Path;

use image_webp::{ColorType, EncoderParams, WebPDecoder, WebPEncoder};
use png::{BitDepth, Transformations};

use crate::error::{IoError, Place};

/// How PNG files begin.
const PNG: &[u8] = b"\x89PNG\r\n\x1a\n";
/// What to do about an image that is of another kind.
const CONVERT: &str = "write the file anew with lossless WebP images, as splat-transform does";

/// Largest side of a WebP image, pixels.
pub(super) const MAX_SIDE: usize = 16_383;

/// An image of 3 or 4 values a pixel, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Image {
    pub(super) width: usize,
    pub(super) height: usize,
    /// 3 or 4.
    channels: usize,
    values: Vec<u8>,
}

impl Image {
    /// An image whose pixels are all zero.
    pub(super) fn zeros(width: usize, height: usize, has_alpha: bool) -> Self {
        let channels = if has_alpha { 4 } else { 3 };
        Self { width, height, channels, values: vec![0; width * height * channels] }
    }

    /// Number of pixels.
    pub(super) fn pixels(&self) -> usize {
        self.width * self.height
    }

    /// The values of pixel `i`, which must exist; alpha is 255 if the image has none.
    pub(super) fn pixel(&self, i: usize) -> [u8; 4] {
        match self.values.get(i * self.channels..(i + 1) * self.channels) {
            Some(&[r, g, b, a]) => [r, g, b, a],
            Some(&[r, g, b]) => [r, g, b, 255],
            _ => [0; 4],
        }
    }

    /// Changes pixel `i`, if it exists; an image without alpha ignores the fourth value.
    pub(super) fn set(&mut self, i: usize, value: [u8; 4]) {
        let pixel = self.values.iter_mut().skip(i * self.channels).take(self.channels);
        pixel.zip(value).for_each(|(to, from)| *to = from);
    }

    /// Decodes a lossless WebP image, or a PNG of 8 bits, of at most that many pixels; `name` and `path` are only used in
    /// messages.
    ///
    /// # Errors
    /// The image is damaged, larger, lossy, or of another format.
    pub(super) fn decode(bytes: &[u8], most_pixels: u64, name: &str, path: &Path) -> Result<Self, IoError> {
        let fail = |what: String| IoError::damaged(path, what).at(Place::Field(name.to_owned()));
        let check = |width: u32, height: u32| {
            let pixels = u64::from(width) * u64::from(height);
            let fits = pixels > 0 && width.max(height) as usize <= MAX_SIDE && pixels <= most_pixels;
            let what = || format!("claims {width}x{height} pixels, where at most {most_pixels} can be meant");
            fits.then_some(()).ok_or_else(|| fail(what()))
        };
        if bytes.starts_with(PNG) {
            return decode_png(bytes, &fail, &check);
        }
        let broken = |e: image_webp::DecodingError| fail(format!("is no WebP image, or damaged: {e}"));
        let mut decoder = WebPDecoder::new(Cursor::new(bytes)).map_err(broken)?;
        if decoder.is_lossy() || decoder.is_animated() {
            return Err(fail("is not a lossless WebP image: its values are lost".into()).advise(CONVERT));
        }
        let (width, height) = decoder.dimensions();
        check(width, height)?;
        let size = decoder.output_buffer_size().ok_or_else(|| fail(format!("claims {width}x{height} pixels")))?;
        let channels = if decoder.has_alpha() { 4 } else { 3 };
        let mut values = vec![0; size];
        decoder.read_image(&mut values).map_err(broken)?;
        Ok(Self { width: width as usize, height: height as usize, channels, values })
    }

    /// Encodes the image, with or without prediction, whichever is smaller; `path` is only used in messages.
    pub(super) fn encode(&self, path: &Path) -> Result<Vec<u8>, IoError> {
        let [predicted, plain] = [true, false].map(|predict| self.encoded(predict, path));
        let (predicted, plain) = (predicted?, plain?);
        Ok(if plain.len() < predicted.len() { plain } else { predicted })
    }

    fn encoded(&self, predict: bool, path: &Path) -> Result<Vec<u8>, IoError> {
        let color = if self.channels == 4 { ColorType::Rgba8 } else { ColorType::Rgb8 };
        let mut out = Vec::new();
        let mut encoder = WebPEncoder::new(&mut out);
        encoder.set_params(with_prediction(EncoderParams::default(), predict));
        let written = encoder.encode(&self.values, self.width as u32, self.height as u32, color);
        written.map_err(|e| IoError::new(path, format!("cannot write: {e}")))?;
        Ok(out)
    }
}

/// Decodes a PNG of 8 bits whose size passes `check`; `fail` makes the errors.
fn decode_png(
    bytes: &[u8],
    fail: &dyn Fn(String) -> IoError,
    check: &dyn Fn(u32, u32) -> Result<(), IoError>,
) -> Result<Image, IoError> {
    let broken = |e: png::DecodingError| fail(format!("is a damaged PNG: {e}"));
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    // Colours of a palette become red, green and blue.
    decoder.set_transformations(Transformations::EXPAND);
    let mut reader = decoder.read_info().map_err(broken)?;
    let (width, height) = reader.info().size();
    check(width, height)?;
    let (color, depth) = reader.output_color_type();
    let channels = color.samples();
    if depth != BitDepth::Eight || channels < 3 {
        let what = format!("is a PNG of {color:?} in {} bits, where colours in 8 bits are meant", depth as u8);
        return Err(fail(what).advise(CONVERT));
    }
    let size = reader.output_buffer_size().ok_or_else(|| fail(format!("claims {width}x{height} pixels")))?;
    let mut values = vec![0; size];
    reader.next_frame(&mut values).map_err(broken)?;
    // The image may be complete and the file truncated: the end marker is required too.
    reader.finish().map_err(broken)?;
    Ok(Image { width: width as usize, height: height as usize, channels, values })
}

fn with_prediction(mut params: EncoderParams, predict: bool) -> EncoderParams {
    params.use_predictor_transform = predict;
    params
}

#[cfg(test)]
mod tests {
    use super::*;

    fn decoded(bytes: &[u8], most_pixels: u64) -> Result<Image, IoError> {
        Image::decode(bytes, most_pixels, "a.webp", Path::new("x.sog"))
    }

    /// A smooth image, which prediction suits, and noise, which it does not.
    #[test]
    fn what_is_encoded_is_decoded() -> Result<(), IoError> {
        for has_alpha in [false, true] {
            for noise in [1u32, 2_654_435_761] {
                let mut image = Image::zeros(40, 28, has_alpha);
                for i in 0..image.pixels() {
                    let value = (i as u32 / 9).wrapping_mul(noise).to_le_bytes();
                    image.set(i, value);
                    assert_eq!(image.pixel(i)[..3], value[..3]);
                }
                let bytes = image.encode(Path::new("x.sog"))?;
                assert_eq!(decoded(&bytes, 40 * 28)?, image);
                assert!(decoded(&bytes, 40 * 28 - 1).is_err_and(|e| e.to_string().contains("a.webp: claims 40x28")));
            }
        }
        Ok(())
    }

    #[test]
    fn damaged_images_are_refused() -> Result<(), IoError> {
        let mut image = Image::zeros(16, 16, true);
        (0..256).for_each(|i| image.set(i, [i as u8, 3, (i * 7) as u8, 255]));
        let bytes = image.encode(Path::new("x.sog"))?;
        // The last bytes may be padding.
        for end in 0..bytes.len() - 16 {
            assert!(decoded(&bytes[..end], 256).is_err(), "cut to {end}");
        }
        assert!(decoded(b"GIF89a", 256).is_err_and(|e| e.to_string().contains("is no WebP image")));
        assert!(decoded(PNG, 256).is_err_and(|e| e.to_string().contains("a.webp: is a damaged PNG")));
        Ok(())
    }

    #[test]
    fn png_of_8_bits_is_read() -> Result<(), Box<dyn std::error::Error>> {
        let png = |color: png::ColorType, depth: BitDepth, values: &[u8]| -> Result<_, png::EncodingError> {
            let mut out = Vec::new();
            let mut encoder = png::Encoder::new(&mut out, 2, 1);
            encoder.set_color(color);
            encoder.set_depth(depth);
            let mut writer = encoder.write_header()?;
            writer.write_image_data(values)?;
            writer.finish()?;
            Ok(out)
        };
        let plain = png(png::ColorType::Rgb, BitDepth::Eight, &[1, 2, 3, 4, 5, 6])?;
        let image = decoded(&plain, 2)?;
        assert_eq!((image.width, image.height, image.pixel(0), image.pixel(1)), (2, 1, [1, 2, 3, 255], [4, 5, 6, 255]));
        let image = decoded(&png(png::ColorType::Rgba, BitDepth::Eight, &[1, 2, 3, 0, 4, 5, 6, 252])?, 2)?;
        assert_eq!((image.pixel(0), image.pixel(1)), ([1, 2, 3, 0], [4, 5, 6, 252]));
        assert!(decoded(&plain, 1).is_err_and(|e| e.to_string().contains("a.webp: claims 2x1")));
        assert!((0..plain.len()).all(|end| decoded(&plain[..end], 2).is_err()));
        for (color, depth, values) in
            [(png::ColorType::Rgb, BitDepth::Sixteen, 12), (png::ColorType::Grayscale, BitDepth::Eight, 2)]
        {
            let text = decoded(&png(color, depth, &vec![0; values])?, 2).err().map(|e| e.to_string());
            assert!(text.is_some_and(|text| text.contains("in 8 bits are meant; write the file anew")), "{color:?}");
        }
        Ok(())
    }
}
