//! Compares pictures of a target with pictures of the reference moved to its place.

use super::check::Agreement;
use super::outline::Crop;
use instgs_io::masks::Mask;
use instgs_io::view_image::{IGNORED, ViewImage};
use instgs_vk::render::Picture;

/// Pixels with a lower coverage are not compared in colour: they show the background, too.
const OPAQUE: f32 = 0.5;
/// Least standard deviation of colours, of 0..1, for a gain to be fitted.
const FLAT: f64 = 0.02;

/// One pixel of the target's picture.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct SeenPixel {
    /// Colour of the target, rgb, 0..1.
    pub rgb: [f32; 3],
    /// Part of the pixel that the target covers, 0..1.
    pub cover: f32,
    /// Whether the pixel is unusable: another object may be in front.
    pub unknown: bool,
}

/// Picture of a target in the crop of a view, row by row.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Seen {
    pixels: Vec<SeenPixel>,
}

impl Seen {
    /// From a rendering of the target's own Gaussians.
    pub(super) fn in_render(picture: &Picture) -> Self {
        let pixel = |c: &[f32; 4]| SeenPixel { rgb: straight(*c), cover: c[3], unknown: false };
        Self { pixels: picture.colors.iter().map(pixel).collect() }
    }

    /// From a photo inside the target's mask; `None` if photo and mask do not have the same size.
    pub(super) fn in_photo(crop: &Crop, photo: &ViewImage, mask: &Mask, target: u32) -> Option<Self> {
        let size = (photo.width as usize, photo.height as usize);
        let fits = (mask.width, mask.height) == (photo.width, photo.height)
            && photo.rgba.len() == size.0 * size.1
            && mask.ids.len() == photo.rgba.len();
        if !fits {
            return None;
        }
        let pixel = |i: usize| {
            let (x, y) = (i % crop.camera.width as usize, i / crop.camera.width as usize);
            let place = |k: usize, axis: usize, most: usize| {
                let at = |k: usize| (crop.corner_px[axis] + k as f64 * crop.shrink).round() as usize;
                at(k).min(most)..at(k + 1).min(most)
            };
            let inside =
                place(y, 1, size.1).flat_map(|row| place(x, 0, size.0).map(move |column| row * size.0 + column));
            mean_pixel(inside.map(|p| (photo.rgba[p], u32::from(mask.ids[p]))), target)
        };
        let count = crop.camera.width as usize * crop.camera.height as usize;
        Some(Self { pixels: (0..count).map(pixel).collect() })
    }
}

/// Mean of some pixels of a photo: the target's colour and coverage. Unknown if another object or an ignored pixel is
/// among them.
fn mean_pixel(pixels: impl Iterator<Item = ([u8; 4], u32)>, target: u32) -> SeenPixel {
    let (mut sum, mut inside, mut all, mut unknown) = ([0.0; 3], 0.0, 0.0, false);
    for (rgba, id) in pixels {
        all += 1.0;
        unknown |= rgba[3] == IGNORED || (id != 0 && id != target);
        if id == target {
            inside += 1.0;
            (0..3).for_each(|c| sum[c] += f32::from(rgba[c]) / 255.0);
        }
    }
    let rgb = sum.map(|c| c / f32::max(inside, 1.0));
    SeenPixel { rgb, cover: inside / f32::max(all, 1.0), unknown: unknown || all == 0.0 }
}

/// The object's own colour: the blended one divided by its alpha.
fn straight(color: [f32; 4]) -> [f32; 3] {
    let [r, g, b, alpha] = color;
    [r, g, b].map(|c| c / alpha.max(1e-3))
}

/// Agreement over all crops; both slices are in the same order.
pub(super) fn agreement(seen: &[Seen], rendered: &[Picture]) -> Agreement {
    let (mut both, mut either) = (0.0, 0.0);
    let mut colors: Vec<([f32; 3], [f32; 3])> = Vec::new();
    for (seen, rendered) in seen.iter().zip(rendered) {
        for (pixel, color) in seen.pixels.iter().zip(&rendered.colors).filter(|(pixel, _)| !pixel.unknown) {
            both += f64::from(pixel.cover.min(color[3]));
            either += f64::from(pixel.cover.max(color[3]));
            if pixel.cover > OPAQUE && color[3] > OPAQUE {
                colors.push((straight(*color), pixel.rgb));
            }
        }
    }
    let silhouette = if either > 0.0 { 1.0 - both / either } else { 1.0 };
    Agreement { photometric: mean_difference(&colors), silhouette }
}

/// Mean absolute difference of pairs (rendered, seen) over channels after the best gain >= 0 and bias per channel for
/// the rendered colours; 1 without pairs.
fn mean_difference(colors: &[([f32; 3], [f32; 3])]) -> f64 {
    if colors.is_empty() {
        return 1.0;
    }
    let count = colors.len() as f64;
    let channel = |c: usize| -> f64 {
        let pairs = || colors.iter().map(|(x, y)| (f64::from(x[c]), f64::from(y[c])));
        let (x_sum, y_sum) = pairs().fold((0.0, 0.0), |(a, b), (x, y)| (a + x, b + y));
        let (x_mean, y_mean) = (x_sum / count, y_sum / count);
        let (xx, xy) = pairs().fold((FLAT * FLAT * count, 0.0), |(xx, xy), (x, y)| {
            (xx + (x - x_mean).powi(2), xy + (x - x_mean) * (y - y_mean))
        });
        let gain = (xy / xx).max(0.0);
        pairs().map(|(x, y)| (y - y_mean - gain * (x - x_mean)).abs()).sum::<f64>() / count
    };
    (0..3).map(channel).sum::<f64>() / 3.0
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;
    use instgs_vk::scene::Camera;

    const SIZE: usize = 12;

    /// A disc with a colour gradient, right of column `left`.
    fn disc(left: usize, color: impl Fn(f32) -> [f32; 3]) -> Picture {
        let pixel = |i: usize| {
            let (x, y) = ((i % SIZE) as f32 - 5.5, (i / SIZE) as f32 - 5.5);
            let inside = x.hypot(y) < 5.0 && i % SIZE >= left;
            let [r, g, b] = color(0.5 + 0.08 * x);
            if inside { [r, g, b, 1.0] } else { [0.0; 4] }
        };
        let size = SIZE as u32;
        Picture { width: size, height: size, colors: (0..SIZE * SIZE).map(pixel).collect(), depths: vec![] }
    }

    fn grey(v: f32) -> [f32; 3] {
        [v; 3]
    }

    #[test]
    fn gains_are_forgiven_and_other_colours_and_outlines_are_not() {
        let seen = [Seen::in_render(&disc(0, grey))];
        let of = |picture| agreement(&seen, &[picture]);
        let same = of(disc(0, grey));
        assert!(same.silhouette < 1e-6 && same.photometric < 0.002, "{same:?}");
        let dimmed = of(disc(0, |v| [0.5 * v + 0.2, 0.7 * v, 0.9 * v - 0.1]));
        assert!(dimmed.silhouette < 1e-6 && dimmed.photometric < 0.004, "{dimmed:?}");
        // No gain above 0 explains a reversed gradient.
        let turned = of(disc(0, |v| grey(1.0 - v)));
        assert!(turned.photometric > 0.1, "{turned:?}");
        let half = of(disc(6, grey));
        assert!((0.4..0.6).contains(&half.silhouette), "{half:?}");
        let nothing = of(disc(SIZE, grey));
        assert_eq!(nothing, Agreement { photometric: 1.0, silhouette: 1.0 });
        assert_eq!(agreement(&[], &[]), Agreement { photometric: 1.0, silhouette: 1.0 });
    }

    /// A photo of twice the crop's resolution; another object covers its left part.
    #[test]
    fn photos_count_inside_the_mask_and_not_under_other_objects() {
        let side = 2 * SIZE;
        let model = disc(0, grey);
        let of = |x: usize, y: usize| model.colors[(y / 2) * SIZE + x / 2];
        let byte = |v: f32| (v * 255.0).round() as u8;
        let places: Vec<(usize, usize)> = (0..side * side).map(|i| (i % side, i / side)).collect();
        let rgba = places.iter().map(|&(x, y)| of(x, y)).map(|c| [byte(c[0]), byte(c[1]), byte(c[2]), 255]).collect();
        let id = |&(x, y): &(usize, usize)| if x < 8 { 9 } else { 4 * of(x, y)[3] as u16 };
        let photo = ViewImage { width: side as u32, height: side as u32, rgba };
        let mask = Mask { width: side as u32, height: side as u32, ids: places.iter().map(id).collect() };
        let view = Camera::look_at("", DVec3::X, DVec3::ZERO, DVec3::Z, 1.0, (SIZE as u32, SIZE as u32));
        let crop = Crop { view: 0, camera: view, corner_px: [0.0; 2], shrink: 2.0 };
        let seen = Seen::in_photo(&crop, &photo, &mask, 4).unwrap();
        let same = agreement(&[seen], &[disc(0, grey)]);
        assert!(same.silhouette < 1e-6 && same.photometric < 0.004, "{same:?}");
        let other = Seen::in_photo(&crop, &photo, &mask, 5).unwrap();
        assert_eq!(agreement(&[other], &[disc(0, grey)]).silhouette, 1.0);
        let small = Mask { width: 1, height: 1, ids: vec![4] };
        assert_eq!(Seen::in_photo(&crop, &photo, &small, 4), None);
    }
}
