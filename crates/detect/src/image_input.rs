//! Photos as the models' input: resized, normalised and padded.

use super::models::{DetectorModel, SegmenterModel};
use super::photo::Photo;
use super::resize::resize;

/// A picture as a model reads it: planes of red, green and blue in row-major order, with the photo at the top left and
/// 0 elsewhere.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelImage {
    /// Width of the planes, pixels.
    pub width: usize,
    /// Height of the planes, pixels.
    pub height: usize,
    /// Width and height of the photo within the planes, pixels.
    pub photo_size: (usize, usize),
    /// `[3, height, width]` normalised values.
    pub values: Vec<f32>,
}

impl ModelImage {
    /// 1 at pixels of the photo, 0 elsewhere; `[height, width]`.
    pub fn photo_mask(&self) -> Vec<i64> {
        let (width, height) = self.photo_size;
        let row = |y: usize| (0..self.width).map(move |x| i64::from(x < width && y < height));
        (0..self.height).flat_map(row).collect()
    }

    /// The photo at `photo_size` in planes of `width` by `height`, which are at least as large.
    fn new(photo: &Photo, (width, height): (usize, usize), photo_size: (usize, usize), scale: Normalisation) -> Self {
        let resized = resize(photo, photo_size.0, photo_size.1);
        let mut values = vec![0.0; 3 * width * height];
        for (c, plane) in values.chunks_exact_mut(width * height).enumerate() {
            for (row, pixels) in plane.chunks_exact_mut(width).zip(resized.rgb.chunks_exact(photo_size.0)) {
                row.iter_mut().zip(pixels).for_each(|(value, rgb)| *value = scale.apply(c, rgb[c]));
            }
        }
        Self { width, height, photo_size, values }
    }
}

/// Normalises bytes as in the model's training. In f32, with the factor of 255 in means and deviations, like the
/// models' own programs.
#[derive(Clone, Copy)]
struct Normalisation {
    mean: [f32; 3],
    std: [f32; 3],
}

impl Normalisation {
    fn new(mean: [f64; 3], std: [f64; 3]) -> Self {
        Self { mean: mean.map(|m| m as f32 * 255.0), std: std.map(|s| s as f32 * 255.0) }
    }

    fn apply(&self, channel: usize, byte: u8) -> f32 {
        (f32::from(byte) - self.mean[channel]) / self.std[channel]
    }
}

/// A photo as the detector's input, at the size of [`detector_size`].
pub fn detector_image(photo: &Photo, model: &DetectorModel) -> ModelImage {
    let photo_size = detector_size((photo.width, photo.height), model);
    let size = model.canvas_px.map_or(photo_size, |[height, width]| (width as usize, height as usize));
    ModelImage::new(photo, size, photo_size, Normalisation::new(model.mean, model.std))
}

/// A photo as the segmenter's input, at the size of [`segmenter_size`].
pub fn segmenter_image(photo: &Photo, model: &SegmenterModel) -> ModelImage {
    let side = model.side_px as usize;
    let photo_size = segmenter_size((photo.width, photo.height), side);
    ModelImage::new(photo, (side, side), photo_size, Normalisation::new(model.mean, model.std))
}

/// Width and height of a photo in the detector's input: the shorter side is `shortest_px`, or less if the longer one
/// would exceed `longest_px`; both fit the canvas, if there is one.
///
/// Rounding follows the models' own programs, since it decides which pixels the detector sees: the first side to
/// nearest, halves to even, and the other one down.
pub fn detector_size(photo: (usize, usize), model: &DetectorModel) -> (usize, usize) {
    let (width, height) = (photo.0 as f64, photo.1 as f64);
    let (shorter, longer) = (width.min(height), width.max(height));
    let (shortest, longest) = (f64::from(model.shortest_px), f64::from(model.longest_px));
    let fits = longer / shorter * shortest <= longest;
    let exact = if fits { shortest } else { longest * shorter / longer };
    let side = exact.round_ties_even();
    let other = (exact * longer / shorter) as usize;
    let size = match (width <= height, side == shorter) {
        (_, true) => photo,
        (true, false) => (side as usize, other),
        (false, false) => (other, side as usize),
    };
    let size = (size.0.max(1), size.1.max(1));
    model.canvas_px.map_or(size, |[height, width]| within(size, (width as usize, height as usize)))
}

/// The size, or the largest one of the same shape that fits the canvas; rounded down, at least 1.
fn within(size: (usize, usize), canvas: (usize, usize)) -> (usize, usize) {
    if size.0 <= canvas.0 && size.1 <= canvas.1 {
        return size;
    }
    let side = |a: usize, of: usize, to: usize| (a * to / of).max(1);
    // The side that takes the larger part of the canvas fills it.
    match size.0 * canvas.1 >= size.1 * canvas.0 {
        true => (canvas.0, side(size.1, size.0, canvas.0)),
        false => (side(size.0, size.1, canvas.1), canvas.1),
    }
}

/// Width and height of a photo in the segmenter's square input: the longer side fills it, the other is rounded to
/// nearest.
pub fn segmenter_size(photo: (usize, usize), side: usize) -> (usize, usize) {
    let scale = side as f64 / photo.0.max(photo.1) as f64;
    let scaled = |length: usize| ((length as f64 * scale + 0.5) as usize).clamp(1, side);
    (scaled(photo.0), scaled(photo.1))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::models::ModelFile;

    fn detector(shortest_px: u32, longest_px: u32, canvas_px: Option<[u32; 2]>) -> DetectorModel {
        let file = ModelFile { file: String::new(), bytes: 0, sha256: String::new(), data: vec![] };
        DetectorModel {
            kind: String::new(),
            source: String::new(),
            graph: file.clone(),
            tokenizer: file,
            shortest_px,
            longest_px,
            canvas_px,
            mean: [0.0, 0.5, 0.0],
            std: [1.0, 0.5, 1.0],
            max_tokens: 256,
            fixed_tokens: None,
        }
    }

    #[test]
    fn sizes_are_those_of_the_original() {
        // Expected values from transformers 5.23, get_size_with_aspect_ratio(size, 800, 1333).
        let size = |w, h| detector_size((w, h), &detector(800, 1333, None));
        assert_eq!(size(640, 480), (1066, 800));
        assert_eq!(size(480, 640), (800, 1066));
        assert_eq!(size(1920, 1080), (1333, 750));
        assert_eq!(size(1000, 1000), (800, 800));
        assert_eq!(size(1200, 800), (1200, 800));
        assert_eq!(size(4000, 100), (1333, 33));
        assert_eq!(size(20000, 1), (1333, 1));
        let on_canvas = |w, h| detector_size((w, h), &detector(800, 1333, Some([800, 1000])));
        assert_eq!(
            (on_canvas(640, 480), on_canvas(480, 640), on_canvas(10, 10)),
            ((1000, 750), (600, 800), (800, 800))
        );
        assert_eq!([segmenter_size((640, 480), 1024), segmenter_size((3, 1000), 1024)], [(1024, 768), (3, 1024)]);
        assert_eq!([segmenter_size((5000, 1), 64), segmenter_size((48, 64), 64)], [(64, 1), (48, 64)]);
    }

    #[test]
    fn planes_are_normalised_and_padded() {
        let photo = Photo { width: 2, height: 1, rgb: vec![[255, 0, 51], [0, 255, 102]] };
        let image = detector_image(&photo, &detector(1, 2, Some([2, 3])));
        assert_eq!((image.width, image.height, image.photo_size), (3, 2, (2, 1)));
        let mut planes = image.values.chunks_exact(6);
        for want in [[1.0, 0.0], [-1.0, 1.0], [0.2, 0.4]] {
            let plane = planes.next().unwrap_or_default();
            let error =
                plane.iter().zip([want[0], want[1], 0.0, 0.0, 0.0, 0.0]).map(|(a, b): (&f32, f32)| (a - b).abs());
            assert!(error.fold(0.0, f32::max) < 1e-6, "{plane:?}");
        }
        assert_eq!(image.photo_mask(), [1, 1, 0, 0, 0, 0]);
    }
}
