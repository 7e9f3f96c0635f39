//! Pictures for the page in `data:` addresses: photo, rendering, and their difference as PNG, since they are compared; the stages'
//! as PNG or JPEG.

use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder, RgbImage, imageops};

use crate::PictureError;
use instgs_train::facts::ViewMetrics;

/// Pictures on the page are scaled down to this width, pixels.
pub const MAX_WIDTH_PX: u32 = 480;
/// Factor that makes differences visible.
pub(super) const DIFFERENCE_GAIN: u16 = 4;

/// At 85, edges of painted masks show no ringing, and a picture of 320x180 takes 15 kB, not 60 as PNG.
const JPEG_QUALITY: u8 = 85;

/// A picture of 8 bits per channel, rows from the top.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Rgb8 {
    /// Width of the picture, pixels.
    pub width: u32,
    /// Height of the picture, pixels.
    pub height: u32,
    /// `width * height` pixels of red, green, blue.
    pub pixels: Vec<u8>,
}

impl Rgb8 {
    /// The picture as a PNG file.
    ///
    /// # Errors
    /// The number of bytes does not match the size, or the picture has no pixels.
    pub fn png(&self) -> Result<Vec<u8>, PictureError> {
        encoded(&image_of(self)?)
    }

    /// The picture as a JPEG in a `data:` address, for pages of many pictures.
    ///
    /// # Errors
    /// The same errors as [`Rgb8::png`].
    pub fn jpeg_address(&self) -> Result<String, PictureError> {
        jpeg_address(&image_of(self)?)
    }

    /// The picture scaled to another size, interpolated.
    ///
    /// # Errors
    /// The same errors as [`Rgb8::png`], or a size of 0.
    pub fn resized(self, width: u32, height: u32) -> Result<Self, PictureError> {
        if (self.width, self.height) == (width, height) {
            return Ok(self);
        }
        let image = imageops::resize(&image_of(&self)?, width, height, imageops::FilterType::CatmullRom);
        Ok(Self { width, height, pixels: image.into_raw() })
    }
}

/// The views to show, at most `most`, worst PSNR first: the worst, the best, and views at equal steps of rank between
/// them. Returns indices into `views`.
pub fn choose(views: &[ViewMetrics], most: usize) -> Vec<usize> {
    let mut ranked: Vec<usize> = (0..views.len()).collect();
    ranked.sort_by(|&a, &b| views[a].metrics.psnr.total_cmp(&views[b].metrics.psnr).then(a.cmp(&b)));
    if ranked.len() <= most {
        return ranked;
    }
    let last = most.saturating_sub(1).max(1);
    (0..most).map(|i| ranked[i * (ranked.len() - 1) / last]).collect()
}

/// Photo, rendering and their difference, at the page's width where they are wider.
pub(super) fn compared(ground_truth: &Rgb8, render: &Rgb8) -> Result<[Rgb8; 3], PictureError> {
    let (truth, render) = (image_of(ground_truth)?, image_of(render)?);
    if truth.dimensions() != render.dimensions() {
        return Err(PictureError::SizesDiffer(truth.dimensions().into(), render.dimensions().into()));
    }
    // The difference is taken at full size: averaging first would hide differences of single pixels.
    let mut difference = truth.clone();
    for (a, b) in difference.iter_mut().zip(render.iter()) {
        *a = u8::try_from(DIFFERENCE_GAIN * u16::from(a.abs_diff(*b))).unwrap_or(u8::MAX);
    }
    Ok([truth, render, difference].map(|image| {
        let image = scaled(image);
        Rgb8 { width: image.width(), height: image.height(), pixels: image.into_raw() }
    }))
}

/// The `data:` address of a picture that is compared, as PNG.
pub(super) fn exact_address(picture: &Rgb8) -> Result<String, PictureError> {
    png_address(&image_of(picture)?)
}

/// The `data:` address of a picture that illustrates: as PNG or JPEG, whichever is smaller.
pub(super) fn address(picture: &Rgb8) -> Result<String, PictureError> {
    let image = scaled(image_of(picture)?);
    let (png, jpeg) = (png_address(&image)?, jpeg_address(&image)?);
    Ok(if jpeg.len() < png.len() { jpeg } else { png })
}

fn image_of(picture: &Rgb8) -> Result<RgbImage, PictureError> {
    let &Rgb8 { width, height, ref pixels } = picture;
    let wanted = 3 * u64::from(width) * u64::from(height);
    if width == 0 || height == 0 || pixels.len() as u64 != wanted {
        return Err(PictureError::Size(pixels.len(), width, height));
    }
    RgbImage::from_raw(width, height, pixels.clone()).ok_or(PictureError::TooLarge)
}

/// The image at the page's width if it is wider.
fn scaled(image: RgbImage) -> RgbImage {
    let (width, height) = image.dimensions();
    if width <= MAX_WIDTH_PX {
        return image;
    }
    let height = (u64::from(height) * u64::from(MAX_WIDTH_PX)).div_ceil(u64::from(width)).max(1);
    imageops::thumbnail(&image, MAX_WIDTH_PX, height as u32)
}

fn png_address(image: &RgbImage) -> Result<String, PictureError> {
    Ok(format!("data:image/png;base64,{}", STANDARD.encode(encoded(image)?)))
}

fn jpeg_address(image: &RgbImage) -> Result<String, PictureError> {
    let mut jpeg = Vec::new();
    JpegEncoder::new_with_quality(&mut jpeg, JPEG_QUALITY).encode_image(image)?;
    Ok(format!("data:image/jpeg;base64,{}", STANDARD.encode(jpeg)))
}

fn encoded(image: &RgbImage) -> Result<Vec<u8>, PictureError> {
    let mut png = Vec::new();
    PngEncoder::new_with_quality(&mut png, CompressionType::Default, FilterType::Adaptive).write_image(
        image.as_raw(),
        image.width(),
        image.height(),
        ExtendedColorType::Rgb8,
    )?;
    Ok(png)
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_train::facts::Metrics;

    fn decoded(address: &str) -> RgbImage {
        let text = address.strip_prefix("data:image/png;base64,").unwrap();
        image::load_from_memory(&STANDARD.decode(text).unwrap()).unwrap().into_rgb8()
    }

    #[test]
    fn pictures_survive_and_differences_are_amplified() {
        let truth = Rgb8 { width: 2, height: 1, pixels: vec![10, 20, 30, 0, 255, 7] };
        let render = Rgb8 { width: 2, height: 1, pixels: vec![11, 18, 30, 200, 0, 7] };
        let [a, b, d] = compared(&truth, &render).unwrap();
        assert_eq!((&a, &b), (&truth, &render));
        assert_eq!(decoded(&exact_address(&a).unwrap()).into_raw(), truth.pixels);
        assert_eq!(decoded(&exact_address(&d).unwrap()).into_raw(), [4, 8, 0, 255, 255, 0]);
    }

    /// Flat areas of few colours are smaller as PNG, photos as JPEG.
    #[test]
    fn what_illustrates_takes_the_smaller_format() {
        let flat = Rgb8 { width: 64, height: 64, pixels: vec![200; 3 * 64 * 64] };
        assert!(address(&flat).unwrap().starts_with("data:image/png;"));
        let mut state = 1u32;
        let noise = (0..3 * 64 * 64).map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        });
        let photo = Rgb8 { width: 64, height: 64, pixels: noise.collect() };
        assert!(address(&photo).unwrap().starts_with("data:image/jpeg;"));
    }

    #[test]
    fn wide_pictures_are_averaged_down() {
        let pixels = (0..960 * 6).flat_map(|i| [if i % 2 == 0 { 100 } else { 102 }; 3]).collect();
        let wide = Rgb8 { width: 960, height: 6, pixels };
        let [a, ..] = compared(&wide, &wide).unwrap();
        let small = decoded(&exact_address(&a).unwrap());
        assert_eq!(small.dimensions(), (480, 3));
        assert!(small.pixels().all(|p| p.0 == [101; 3]), "{:?}", small.get_pixel(0, 0));
    }

    #[test]
    fn pictures_that_are_none_or_differ_in_size_are_refused() {
        let picture = |width, height, bytes| Rgb8 { width, height, pixels: vec![0; bytes] };
        let error = |a: &Rgb8, b: &Rgb8| compared(a, b).unwrap_err().to_string();
        assert!(error(&picture(2, 1, 6), &picture(1, 2, 6)).contains("2x1 pixels, the rendering 1x2"));
        assert!(error(&picture(2, 1, 5), &picture(2, 1, 6)).contains("5 bytes"));
        assert!(error(&picture(0, 1, 0), &picture(0, 1, 0)).contains("no picture"));
    }

    #[test]
    fn the_chosen_views_span_worst_to_best() {
        let views: Vec<ViewMetrics> = [20.0, 30.0, 10.0, 25.0, 15.0]
            .map(|psnr| ViewMetrics { name: String::new(), metrics: Metrics { psnr, ..Metrics::default() } })
            .into();
        assert_eq!(choose(&views, 9), [2, 4, 0, 3, 1]);
        assert_eq!(choose(&views, 3), [2, 0, 1]);
        assert_eq!(choose(&views, 1), [2]);
        assert!(choose(&views, 0).is_empty() && choose(&[], 3).is_empty());
    }
}
