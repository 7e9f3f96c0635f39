//! Undistortion and downscaling of view images. Both average colours weighted by coverage (premultiplied) and leave out
//! ignored pixels; a result of whose weight more than half is ignored is ignored itself.

use crate::masks::Mask;
use crate::view_image::{IGNORED, OPAQUE, ViewImage};
use instgs_vk::math::distortion::Distortion;
use instgs_vk::scene::camera::Camera;

/// The image of a pinhole camera with the same intrinsics: every pixel is sampled bilinearly at the distorted position
/// of its centre. A position outside the image, or beyond the radius where the model folds over, gives an ignored
/// pixel; within half a pixel of the border the outermost pixels are repeated.
pub(crate) fn undistort(image: &ViewImage, camera: &Camera, distortion: &Distortion) -> ViewImage {
    let pixel = |place: Option<[f64; 2]>| place.map_or([0, 0, 0, IGNORED], |[u, v]| bilinear(image, u - 0.5, v - 0.5));
    ViewImage { rgba: places_in_image(camera, distortion).map(pixel).collect(), ..*image }
}

/// The same for ids, which have no mean: the id of the nearest pixel, 0 outside the image.
pub(crate) fn undistort_ids(mask: &Mask, camera: &Camera, distortion: &Distortion) -> Mask {
    let id = |[u, v]: [f64; 2]| {
        let (i, j) = ((u as usize).min(mask.width as usize - 1), (v as usize).min(mask.height as usize - 1));
        mask.ids[j * mask.width as usize + i]
    };
    let ids = places_in_image(camera, distortion).map(|place| place.map_or(0, id)).collect();
    Mask { ids, ..*mask }
}

/// The inverse: ids of a pinhole camera's picture, distorted as the lens images them; 0 outside that picture.
pub(crate) fn distort_ids(mask: &Mask, camera: &Camera, distortion: &Distortion) -> Mask {
    let id_at = |i: u32, j: u32| {
        let (x, y) = ((f64::from(i) + 0.5 - camera.cx) / camera.fx, (f64::from(j) + 0.5 - camera.cy) / camera.fy);
        let [x, y] = distortion.undistort(x, y)?;
        let (u, v) = (camera.fx * x + camera.cx, camera.fy * y + camera.cy);
        let is_in = (0.0..f64::from(mask.width)).contains(&u) && (0.0..f64::from(mask.height)).contains(&v);
        is_in.then(|| mask.ids[v as usize * mask.width as usize + u as usize])
    };
    let ids = (0..mask.height).flat_map(|j| (0..mask.width).map(move |i| (i, j)));
    Mask { ids: ids.map(|(i, j)| id_at(i, j).unwrap_or(0)).collect(), ..*mask }
}

/// The distorted position of every pixel centre of a pinhole camera, row by row, in pixels from the image's top left
/// corner; `None` outside the image, or beyond the radius where the model folds over.
fn places_in_image<'a>(
    camera: &'a Camera,
    distortion: &'a Distortion,
) -> impl Iterator<Item = Option<[f64; 2]>> + use<'a> {
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let fold = distortion.fold_radius_squared();
    (0..camera.height).flat_map(move |j| {
        let y = (f64::from(j) + 0.5 - camera.cy) / camera.fy;
        (0..camera.width).map(move |i| {
            let x = (f64::from(i) + 0.5 - camera.cx) / camera.fx;
            let [xd, yd] = distortion.distort(x, y);
            let (u, v) = (camera.fx * xd + camera.cx, camera.fy * yd + camera.cy);
            // NaN is not inside.
            let inside = (0.0..=width).contains(&u) && (0.0..=height).contains(&v) && x * x + y * y < fold;
            inside.then_some([u, v])
        })
    })
}

/// Bilinear sample at (u, v), both at least -0.5; integers are pixel centres.
fn bilinear(image: &ViewImage, u: f64, v: f64) -> [u8; 4] {
    // Splits a coordinate into the pixel to its left or above and the fraction; `floor` is a function call on older
    // processors.
    let split = |at: f64| {
        let place = (at + 1.0) as i64 - 1;
        (place, at - place as f64)
    };
    let clamp = |at: i64, count: u32| at.clamp(0, i64::from(count) - 1) as usize;
    let ((left, a), (top, b)) = (split(u), split(v));
    let columns = [clamp(left, image.width), clamp(left + 1, image.width)];
    let rows = [clamp(top, image.height), clamp(top + 1, image.height)];
    let taps = [0, 1, 2, 3].map(|k: usize| image.rgba[rows[k / 2] * image.width as usize + columns[k % 2]]);
    let weights = [(1.0 - b) * (1.0 - a), (1.0 - b) * a, b * (1.0 - a), b * a];
    if taps.iter().all(|t| t[3] == OPAQUE) {
        let colour = |c: usize| ((0..4).map(|k| weights[k] * f64::from(taps[k][c])).sum::<f64>() + 0.5) as u8;
        return [colour(0), colour(1), colour(2), OPAQUE];
    }
    let mut sums = [0.0; 5];
    for ([r, g, b, covered], weight) in taps.into_iter().zip(weights).filter(|(t, _)| t[3] != IGNORED) {
        let opaque = weight * f64::from(covered - 1);
        let add = [opaque * f64::from(r), opaque * f64::from(g), opaque * f64::from(b), opaque, weight];
        (0..5).for_each(|k| sums[k] += add[k]);
    }
    let [r, g, b, opaque, seen] = sums;
    if seen < 0.5 {
        return [0, 0, 0, IGNORED];
    }
    // The cast saturates and maps the NaN of a fully transparent pixel to 0.
    let colour = |sum: f64| (sum / opaque + 0.5) as u8;
    [colour(r), colour(g), colour(b), 1 + (opaque / seen + 0.5) as u8]
}

/// The size for a given `width`: the height keeps the aspect ratio, rounded; both are at least 1.
pub(crate) fn downscaled_size(old_width: u32, old_height: u32, width: u32) -> [u32; 2] {
    let width = width.max(1);
    let (w, h, new) = (u64::from(old_width), u64::from(old_height), u64::from(width));
    let height = (2 * h * new + w) / (2 * w);
    [width, u32::try_from(height).unwrap_or(u32::MAX).max(1)]
}

/// Box filter: a new pixel covers `old / new` old ones per axis, and partly covered pixels count by their area. The
/// sums are integers, so only the result is rounded, to nearest. `width` and `height` are at least 1 and at most the
/// image's.
pub(crate) fn downscale(image: &ViewImage, width: u32, height: u32) -> ViewImage {
    let columns = boxes(image.width, width);
    let rows = boxes(image.height, height);
    let mut rgba = Vec::with_capacity(width as usize * height as usize);
    let mut sums = vec![[0u64; 5]; width as usize];
    for row in &rows {
        sums.fill([0; 5]);
        for &(j, in_row) in row {
            let start = j * image.width as usize;
            let line = &image.rgba[start..start + image.width as usize];
            for (sum, column) in sums.iter_mut().zip(&columns) {
                for &(i, in_column) in column {
                    add(sum, line[i], in_row * in_column);
                }
            }
        }
        let whole = u64::from(image.width) * u64::from(image.height);
        rgba.extend(sums.iter().map(|sum| averaged(sum, whole)));
    }
    ViewImage { width, height, rgba }
}

/// For each of `new` equal parts of `old` pixels: the pixels it overlaps, with their shares in units of 1/`new` pixel.
/// The shares of one part add up to `old`.
fn boxes(old: u32, new: u32) -> Vec<Vec<(usize, u64)>> {
    let (old, new) = (u64::from(old), u64::from(new));
    let part = |i: u64| {
        let (start, end) = (i * old, (i + 1) * old);
        let pixels = start / new..end.div_ceil(new);
        pixels.map(|k| (k as usize, ((k + 1) * new).min(end) - (k * new).max(start))).collect()
    };
    (0..new).map(part).collect()
}

/// Adds a pixel to the sums of red, green, blue (times coverage), coverage and weight. Sums stay below 2^44 for images
/// of 2^14 pixels per side.
fn add(sum: &mut [u64; 5], [r, g, b, covered]: [u8; 4], weight: u64) {
    if covered != IGNORED {
        let opaque = weight * u64::from(covered - 1);
        let terms = [opaque * u64::from(r), opaque * u64::from(g), opaque * u64::from(b), opaque, weight];
        (0..5).for_each(|k| sum[k] += terms[k]);
    }
}

fn averaged(&[r, g, b, opaque, seen]: &[u64; 5], whole: u64) -> [u8; 4] {
    if 2 * seen < whole {
        return [0, 0, 0, IGNORED];
    }
    let rounded = |sum: u64, by: u64| (2 * sum + by).checked_div(2 * by).unwrap_or(0) as u8;
    [rounded(r, opaque), rounded(g, opaque), rounded(b, opaque), 1 + rounded(opaque, seen)]
}
