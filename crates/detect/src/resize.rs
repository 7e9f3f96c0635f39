//! Resizes photos as torchvision, and so the models' own programs, do for 8-bit pixels: bilinear with antialiasing.
//!
//! Each new pixel is a mean of old ones weighted by a triangle as wide as two new pixels (two old ones when enlarging).
//! Rows come first, then columns, in integers: weights are rounded to 15 bits and the result of each pass to 8. Models
//! were trained on such pixels, and the tests require the same bytes.

use rayon::prelude::*;

use super::photo::Photo;

/// Upper bound of weights, so that sums of products with bytes fit into 32 bits.
const WEIGHT_LIMIT: f64 = (1 << 15) as f64;
/// Largest number of fractional bits, however small the weights.
const MOST_BITS: u32 = 22;

/// The photo at another size, at least 1 by 1.
pub fn resize(photo: &Photo, width: usize, height: usize) -> Photo {
    let rows = if width == photo.width { photo.rgb.clone() } else { resize_rows(photo, width) };
    let rgb = if height == photo.height { rows } else { resize_columns(&rows, width, photo.height, height) };
    Photo { width, height, rgb }
}

fn resize_rows(photo: &Photo, width: usize) -> Vec<[u8; 3]> {
    let filter = Filter::new(photo.width, width);
    let mut out = vec![[0; 3]; width * photo.height];
    out.par_chunks_mut(width).zip(photo.rgb.par_chunks(photo.width)).for_each(|(new, old)| {
        for (pixel, (first, weights)) in new.iter_mut().zip(filter.taps()) {
            *pixel = filter.mean(weights, |k| old[first + k]);
        }
    });
    out
}

fn resize_columns(old: &[[u8; 3]], width: usize, old_height: usize, height: usize) -> Vec<[u8; 3]> {
    let filter = Filter::new(old_height, height);
    let taps: Vec<_> = filter.taps().collect();
    let mut out = vec![[0; 3]; width * height];
    out.par_chunks_mut(width).zip(taps).for_each(|(new, (first, weights))| {
        for (column, pixel) in new.iter_mut().enumerate() {
            *pixel = filter.mean(weights, |k| old[(first + k) * width + column]);
        }
    });
    out
}

/// Which old pixels each new one averages, along one axis.
struct Filter {
    /// For each new pixel, the first old one, and the range of its weights.
    places: Vec<(usize, usize, usize)>,
    weights: Vec<i32>,
    /// Number of fractional bits of the weights.
    bits: u32,
}

impl Filter {
    fn new(old: usize, new: usize) -> Self {
        let scale = old as f64 / new as f64;
        // Half the width of the triangle, in old pixels.
        let reach = scale.max(1.0);
        let (mut places, mut exact) = (Vec::with_capacity(new), Vec::new());
        for i in 0..new {
            let center = scale * (i as f64 + 0.5);
            // The casts truncate towards 0, as in the original.
            let first = ((center - reach + 0.5) as i64).max(0) as usize;
            let end = ((center + reach + 0.5) as usize).min(old);
            let begin = exact.len();
            let weight = |k: usize| (1.0 - ((k as f64 - center + 0.5) / reach).abs()).max(0.0);
            exact.extend((first..end).map(weight));
            let sum: f64 = exact[begin..].iter().sum();
            exact[begin..].iter_mut().for_each(|w| *w /= sum);
            places.push((first, begin, exact.len()));
        }
        let bits = bits_for(exact.iter().copied().fold(0.0, f64::max));
        let weights = exact.iter().map(|w| (0.5 + w * f64::from(1u32 << bits)) as i32).collect();
        Self { places, weights, bits }
    }

    /// For each new pixel, the first old one and the weights from there on.
    fn taps(&self) -> impl Iterator<Item = (usize, &[i32])> {
        self.places.iter().map(|&(first, begin, end)| (first, &self.weights[begin..end]))
    }

    fn mean(&self, weights: &[i32], pixel: impl Fn(usize) -> [u8; 3]) -> [u8; 3] {
        let mut sums = [1 << (self.bits - 1); 3];
        for (k, weight) in weights.iter().enumerate() {
            let old = pixel(k);
            (0..3).for_each(|c| sums[c] += weight * i32::from(old[c]));
        }
        sums.map(|sum| (sum >> self.bits).clamp(0, 255) as u8)
    }
}

/// The largest number of fractional bits with which the largest weight stays below the limit.
fn bits_for(largest: f64) -> u32 {
    let fits = |bits: &u32| 0.5 + largest * f64::from(1u32 << bits) < WEIGHT_LIMIT;
    (1..=MOST_BITS).take_while(fits).last().unwrap_or(1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn photo(width: usize, height: usize, grey: impl Fn(usize, usize) -> u8) -> Photo {
        let pixel = |i: usize| [grey(i % width, i / width), 255 - grey(i % width, i / width), 7];
        Photo { width, height, rgb: (0..width * height).map(pixel).collect() }
    }

    #[test]
    fn the_same_size_and_flat_photos_do_not_change() {
        let noise = photo(7, 5, |x, y| (31 * x + 57 * y) as u8);
        assert_eq!(resize(&noise, 7, 5), noise);
        for (width, height) in [(1, 1), (3, 11), (50, 2)] {
            assert_eq!(resize(&photo(9, 6, |_, _| 201), width, height), photo(width, height, |_, _| 201));
        }
    }

    #[test]
    fn shrinking_takes_the_mean_and_growing_goes_between() {
        // Half the size: weights 1/8, 3/8, 3/8, 1/8, and at the border without the first, 3/7, 3/7, 1/7.
        let ramp = photo(8, 1, |x, _| 8 * x as u8);
        let reds = |p: &Photo| p.rgb.iter().map(|c| c[0]).collect::<Vec<_>>();
        assert_eq!(reds(&resize(&ramp, 4, 1)), [6, 20, 36, 50]);
        // Twice the size: 1/4 and 3/4, and the border pixel alone.
        let step = photo(2, 1, |x, _| 100 * x as u8);
        assert_eq!(reds(&resize(&step, 4, 1)), [0, 25, 75, 100]);
        // The same along columns.
        assert_eq!(reds(&resize(&photo(1, 2, |_, y| 100 * y as u8), 1, 4)), [0, 25, 75, 100]);
    }
}
