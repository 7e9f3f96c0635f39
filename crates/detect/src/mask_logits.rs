//! The segmenter's masks: selecting one of several, and resampling it to the photo's pixels.

use rayon::prelude::*;

/// Placement of the segmenter's small square masks in the photo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MaskFrame {
    /// Width and height of a mask, pixels.
    pub mask: usize,
    /// Width and height of the segmenter's input, which a mask covers, pixels.
    pub side: usize,
    /// Width and height of the photo in that input, at its top left, pixels.
    pub resized: (usize, usize),
    /// Width and height of the photo, pixels.
    pub photo: (usize, usize),
}

impl MaskFrame {
    /// A box in pixels of the photo, converted to pixels of the segmenter's input.
    pub fn box_in_input(&self, [left, top, right, bottom]: &[f64; 4]) -> [f32; 4] {
        let x = self.resized.0 as f64 / self.photo.0 as f64;
        let y = self.resized.1 as f64 / self.photo.1 as f64;
        [x * left, y * top, x * right, y * bottom].map(|at| at as f32)
    }

    /// A mask's logits at the photo's pixels, row by row: bilinear to the input's size, cropped to the photo's part,
    /// and bilinear to the photo's size. A pixel belongs to the object if its logit is above 0.
    pub fn at_photo(&self, logits: &[f32]) -> Vec<f32> {
        let side = [Taps::new(self.mask, self.side), Taps::new(self.mask, self.side)];
        let input = interpolated(logits, self.mask, side, self.resized);
        let photo = [Taps::new(self.resized.0, self.photo.0), Taps::new(self.resized.1, self.photo.1)];
        interpolated(&input, self.resized.0, photo, self.photo)
    }
}

/// For each new pixel along one axis, the two old ones around it and the weight of the second.
struct Taps(Vec<(usize, usize, f32)>);

impl Taps {
    /// Pixel centres are aligned, without antialiasing: the arithmetic of PyTorch's `interpolate`.
    fn new(old: usize, new: usize) -> Self {
        let scale = old as f32 / new as f32;
        let tap = |i: usize| {
            let at = (scale * (i as f32 + 0.5) - 0.5).max(0.0);
            let first = (at as usize).min(old - 1);
            (first, (first + 1).min(old - 1), at - first as f32)
        };
        Self((0..new).map(tap).collect())
    }
}

/// Bilinear interpolation of an image with rows of `stride` values, at the first `width` by `height` taps (x, y).
fn interpolated(image: &[f32], stride: usize, [x, y]: [Taps; 2], (width, height): (usize, usize)) -> Vec<f32> {
    let mut out = vec![0.0; width * height];
    out.par_chunks_mut(width).zip(&y.0).for_each(|(row, &(top, bottom, down))| {
        let (top, bottom) = (&image[top * stride..][..stride], &image[bottom * stride..][..stride]);
        for (value, &(left, right, along)) in row.iter_mut().zip(&x.0) {
            let between = |row: &[f32]| (1.0 - along) * row[left] + along * row[right];
            *value = (1.0 - down) * between(top) + down * between(bottom);
        }
    });
    out
}

/// Index of the highest score; the first in a tie, 0 if there are none.
pub fn best_of(scores: &[f32]) -> usize {
    let better = |best: usize, i: usize| if scores[i] > scores[best] { i } else { best };
    (1..scores.len()).fold(0, better)
}

/// Intersection over union of two masks of the same size, whose pixels are those above 0; 0 if both are empty.
pub fn overlap_above_zero(a: &[f32], b: &[f32]) -> f64 {
    let count = |of: &dyn Fn(bool, bool) -> bool| a.iter().zip(b).filter(|(a, b)| of(**a > 0.0, **b > 0.0)).count();
    let any = count(&|a, b| a || b);
    if any == 0 { 0.0 } else { count(&|a, b| a && b) as f64 / any as f64 }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_grow_to_the_part_that_shows_the_photo() {
        // A mask of 2x2 for an input of 4x4, whose upper half shows a photo of 8x4.
        let frame = MaskFrame { mask: 2, side: 4, resized: (4, 2), photo: (8, 4) };
        let photo = frame.at_photo(&[0.0, 4.0, 100.0, 104.0]);
        assert_eq!(photo.len(), 32);
        // The first row of the input is the mask's at 0, 1, 3, 4; the photo's is 0, 0.25, 0.75, 1.5, 2.5, ...
        assert_eq!(photo[..8], [0.0, 0.25, 0.75, 1.5, 2.5, 3.25, 3.75, 4.0]);
        // The second row of the input is 25 more, and only the photo's last row takes it.
        assert_eq!((photo[24], photo[31]), (25.0, 29.0));
        assert_eq!((photo[8], photo[16]), (6.25, 18.75));
        assert_eq!(frame.box_in_input(&[0.0, 2.0, 8.0, 3.0]), [0.0, 1.0, 4.0, 1.5]);
    }

    #[test]
    fn the_best_mask_is_taken() {
        assert_eq!([best_of(&[0.1, 0.9, 0.9]), best_of(&[0.5, f32::NAN]), best_of(&[])], [1, 0, 0]);
        let masks = [[1.0, -1.0, 2.0], [1.0, 0.0, -1.0], [-1.0; 3]];
        assert_eq!(overlap_above_zero(&masks[0], &masks[1]), 0.5);
        assert_eq!((overlap_above_zero(&masks[0], &masks[0]), overlap_above_zero(&masks[2], &masks[2])), (1.0, 0.0));
    }
}
