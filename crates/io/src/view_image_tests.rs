use super::*;
use crate::Mask;
use crate::colmap::Distortion;
use crate::dataset::Split;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::camera::Camera;
use std::path::PathBuf;

type Outcome = Result<(), Box<dyn std::error::Error>>;

fn camera(width: u32, height: u32) -> Camera {
    let rigid = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
    let (cx, cy) = (0.5 * f64::from(width), 0.5 * f64::from(height));
    Camera { name: "v".into(), width, height, fx: 90.0, fy: 80.0, cx, cy, view_from_world: rigid }
}

fn view(image_path: PathBuf, width: u32, height: u32) -> View {
    View { camera: camera(width, height), image_path, split: Split::Train, distortion: None, mask_path: None }
}

fn error(view: &View) -> String {
    let text = load_view(view, None).err().map(|e| e.to_string()).unwrap_or_default();
    assert!(!text.is_empty() && !text.contains('\n'), "{text}");
    text
}

#[test]
fn coverage_is_rounded_and_ends_are_exact() {
    assert_eq!((coverage_byte(0), coverage_byte(255), coverage_byte(128)), (1, OPAQUE, 1 + 127));
    assert!((1..=255).all(|a| coverage_byte(a) >= coverage_byte(a - 1)));
}

#[test]
fn png_of_every_kind_and_jpeg() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = |name: &str| folder.path().join(name);
    let load = |name: &str| load_view(&view(path(name), 2, 1), None).map(|l| l.image.rgba);
    image::GrayImage::from_raw(2, 1, vec![7, 200]).ok_or("size")?.save(path("gray.png"))?;
    assert_eq!(load("gray.png")?, [[7, 7, 7, 255], [200, 200, 200, 255]]);
    image::GrayAlphaImage::from_raw(2, 1, vec![7, 0, 200, 255]).ok_or("size")?.save(path("ga.png"))?;
    assert_eq!(load("ga.png")?, [[7, 7, 7, 1], [200, 200, 200, 255]]);
    image::RgbImage::from_raw(2, 1, vec![1, 2, 3, 4, 5, 6]).ok_or("size")?.save(path("rgb.png"))?;
    assert_eq!(load("rgb.png")?, [[1, 2, 3, 255], [4, 5, 6, 255]]);
    image::RgbaImage::from_raw(2, 1, vec![1, 2, 3, 0, 4, 5, 6, 128]).ok_or("size")?.save(path("rgba.png"))?;
    assert_eq!(load("rgba.png")?, [[1, 2, 3, 1], [4, 5, 6, 128]]);
    // In 16 bits: 257 times an 8-bit value, plus 100, which rounds away.
    let deep = image::ImageBuffer::<image::Rgb<u16>, _>::from_raw(2, 1, vec![257, 514, 771 + 100, 0, 65535, 257 * 9]);
    deep.ok_or("size")?.save(path("deep.png"))?;
    assert_eq!(load("deep.png")?, [[1, 2, 3, 255], [0, 255, 9, 255]]);
    std::fs::write(path("palette.png"), PALETTE_PNG)?;
    assert_eq!(load("palette.png")?, [[10, 20, 30, 255], [40, 50, 60, 128]]);
    // JPEG keeps a flat colour to within 2 levels.
    image::RgbImage::from_pixel(2, 1, image::Rgb([90, 140, 200])).save(path("flat.jpg"))?;
    let jpeg = load("flat.jpg")?;
    assert!(jpeg.iter().all(|p| p.iter().zip([90, 140, 200, 255]).all(|(a, b)| a.abs_diff(b) <= 2)), "{jpeg:?}");
    Ok(())
}

/// 2x1, palette of (10, 20, 30) and (40, 50, 60), the second of alpha 128 by a tRNS chunk; written by hand.
const PALETTE_PNG: &[u8] = b"\x89PNG\x0d\x0a\x1a\x0a\x00\x00\x00\x0dIHDR\x00\x00\x00\x02\x00\x00\x00\x01\x08\x03\x00\x00\x00\xc3\xfc\x8f\xb8\x00\x00\x00\x06PLTE\x0a\x14\x1e(2<\xd5\x1b\xb4\xe9\x00\x00\x00\x02tRNS\xff\x80\x08\x0f\xb3j\x00\x00\x00\x0bIDATx\x9cc``\x04\x00\x00\x04\x00\x02\xbfz?J\x00\x00\x00\x00IEND\xaeB`\x82";

#[test]
fn errors_are_one_line_and_name_file_and_sizes() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("a.png");
    assert!(error(&view(path.clone(), 4, 2)).contains("a.png: cannot read"));
    std::fs::write(&path, b"no image at all")?;
    assert!(error(&view(path.clone(), 4, 2)).contains("a.png: cannot decode the image"));
    image::RgbImage::new(8, 4).save(&path)?;
    let text = error(&view(path.clone(), 4, 2));
    assert!(text.contains("the image has 8x4 pixels, and its camera 4x2; use"), "{text}");
    let mut masked = view(path.clone(), 8, 4);
    masked.mask_path = Some(folder.path().join("m.png"));
    image::GrayImage::new(4, 4).save(folder.path().join("m.png"))?;
    let text = error(&masked);
    assert!(text.contains("m.png: the mask has 4x4 pixels, and its camera 8x4"), "{text}");
    // Truncated anywhere, a PNG and a JPEG are errors, never pictures with grey parts.
    let mut rng = Rng::new(1);
    let noise = image::RgbImage::from_fn(8, 4, |_, _| image::Rgb([rng.next_u32() as u8, rng.next_u32() as u8, 3]));
    for name in ["b.png", "b.jpg"] {
        let path = folder.path().join(name);
        noise.save(&path)?;
        let whole = std::fs::read(&path)?;
        load_view(&view(path.clone(), 8, 4), None)?;
        // The last 12 bytes of a PNG are an empty chunk: all pixels precede it.
        let needed = if name == "b.png" { whole.len() - 12 - 4 } else { whole.len() };
        for length in 0..needed {
            std::fs::write(&path, &whole[..length])?;
            assert!(load_view(&view(path.clone(), 8, 4), None).is_err(), "{name} cut to {length} of {}", whole.len());
        }
    }
    Ok(())
}

#[test]
fn zero_in_the_mask_is_ignored() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("a.png");
    image::RgbImage::from_pixel(3, 1, image::Rgb([9, 8, 7])).save(&path)?;
    let mut view = view(path, 3, 1);
    view.mask_path = Some(folder.path().join("m.png"));
    image::ImageBuffer::<image::Luma<u16>, _>::from_raw(3, 1, vec![0u16, 1, 65535])
        .ok_or("size")?
        .save(folder.path().join("m.png"))?;
    let image = load_view(&view, None)?.image;
    assert_eq!(image.rgba, [[9, 8, 7, 0], [9, 8, 7, 255], [9, 8, 7, 255]]);
    assert!(!image.is_opaque());
    Ok(())
}

/// JPEG blurs black beside white, so that nothing of the black part need be 0.
#[test]
fn masks_may_be_transparent_or_jpeg() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("a.png");
    image::RgbImage::from_pixel(32, 8, image::Rgb([9, 8, 7])).save(&path)?;
    let mut view = view(path, 32, 8);
    let jpeg = folder.path().join("m.jpg");
    image::GrayImage::from_fn(32, 8, |x, _| image::Luma([if x < 13 { 20 } else { 235 }])).save(&jpeg)?;
    let png = folder.path().join("m.png");
    image::RgbaImage::from_fn(32, 8, |x, _| image::Rgba([255, 255, 255, if x < 13 { 0 } else { 1 }])).save(&png)?;
    for mask in [jpeg, png] {
        view.mask_path = Some(mask);
        let row: Vec<u8> = load_view(&view, None)?.image.rgba[..32].iter().map(|p| p[3]).collect();
        assert_eq!(row, [[IGNORED; 13].as_slice(), &[OPAQUE; 19]].concat(), "{view:?}");
    }
    Ok(())
}

#[test]
fn boxes_average_by_area_coverage_and_what_is_not_ignored() {
    let image = |width, height, rgba: &[[u8; 4]]| ViewImage { width, height, rgba: rgba.to_vec() };
    let gray = |v: u8| [v, v, v, 255];
    // From 3 to 2 pixels: each takes one pixel and half of the middle one: (2 * 30 + 90) / 3 = 50, (90 + 2 * 0) / 3 =
    // 30.
    let out = view_resample::downscale(&image(3, 1, &[gray(30), gray(90), gray(0)]), 2, 1);
    assert_eq!(out, image(2, 1, &[gray(50), gray(30)]));
    // Half-covered white beside opaque black: colour 1/3 white, coverage 3/4 of 254 = 190.5, rounded up.
    let out = view_resample::downscale(&image(2, 1, &[[255, 255, 255, 128], gray(0)]), 1, 1);
    assert_eq!(out.rgba, [[85, 85, 85, 192]]);
    // Transparent pixels contribute no colour, ignored ones nothing at all.
    let out = view_resample::downscale(&image(2, 1, &[[255, 0, 0, 1], gray(9)]), 1, 1);
    assert_eq!(out.rgba, [[9, 9, 9, 128]]);
    let out = view_resample::downscale(&image(2, 1, &[[255, 0, 0, 0], gray(9)]), 1, 1);
    assert_eq!(out.rgba, [gray(9)]);
    let out = view_resample::downscale(&image(3, 1, &[[255, 0, 0, 0], gray(9), [3, 3, 3, 0]]), 1, 1);
    assert_eq!(out.rgba, [[0, 0, 0, 0]]);
    let out = view_resample::downscale(&image(2, 1, &[[255, 0, 0, 1], [7, 7, 7, 1]]), 1, 1);
    assert_eq!(out.rgba, [[0, 0, 0, 1]]);
}

/// Compared with the definition, in f64, at awkward ratios. The pictures are opaque, so coverage has no effect.
#[test]
fn fractional_boxes_agree_with_the_integral_of_the_picture() {
    let mut rng = Rng::new(5);
    for (w, h, nw, nh) in [(7u32, 5u32, 3u32, 4u32), (13, 11, 12, 2), (16, 9, 16, 9), (9, 9, 1, 1)] {
        let rgba: Vec<[u8; 4]> = (0..w * h).map(|_| [(rng.next_u32() & 255) as u8, 0, 0, 255]).collect();
        let out = view_resample::downscale(&ViewImage { width: w, height: h, rgba: rgba.clone() }, nw, nh);
        for (place, pixel) in (0..).zip(&out.rgba) {
            let share = |at: u32, new: u32, old: u32, k: u32| {
                let scale = f64::from(old) / f64::from(new);
                let (low, high) = (f64::from(at) * scale, f64::from(at + 1) * scale);
                (f64::from(k + 1).min(high) - f64::from(k).max(low)).max(0.0) / scale
            };
            let want: f64 = (0..w * h)
                .map(|k| {
                    let (x, y) = (share(place % nw, nw, w, k % w), share(place / nw, nh, h, k / w));
                    x * y * f64::from(rgba[k as usize][0])
                })
                .sum();
            assert!((f64::from(pixel[0]) - want).abs() <= 0.5 + 1e-9, "{pixel:?} {want}");
        }
    }
}

#[test]
fn width_scales_the_camera_with_the_image() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("a.png");
    image::RgbImage::new(30, 17).save(&path)?;
    let view = view(path, 30, 17);
    let loaded = load_view(&view, Some(20))?;
    // The height is 17 * 2/3 = 11.33, rounded.
    assert_eq!((loaded.image.width, loaded.image.height, loaded.image.rgba.len()), (20, 11, 220));
    assert_eq!((loaded.camera.width, loaded.camera.height), (20, 11));
    assert_eq!((loaded.camera.fx, loaded.camera.cy), (60.0, 5.5));
    assert!((loaded.camera.fy - 80.0 * 11.0 / 17.0).abs() < 1e-12);
    for width in [None, Some(30), Some(31), Some(u32::MAX)] {
        assert_eq!(load_view(&view, width)?.camera, view.camera);
    }
    assert_eq!(load_view(&view, Some(0))?.image.rgba.len(), 1);
    Ok(())
}

/// A smooth picture as a function of normalised coordinates, levels 0 to 255.
fn pattern(x: f64, y: f64) -> [f64; 3] {
    let wave = |phase: f64, a: f64, b: f64| 127.5 + 100.0 * (phase + a * x + b * y).sin();
    [wave(0.0, 9.0, 2.0), wave(1.0, -3.0, 8.0), wave(2.0, 5.0, -5.0)]
}

/// The pattern as a lens with `d` images it: the pinhole coordinates of every pixel are found by Newton's method with
/// differences, which shares only `distort` with the code under test.
fn distorted_picture(camera: &Camera, d: Distortion) -> Vec<[u8; 4]> {
    let mut out = Vec::new();
    for j in 0..camera.height {
        for i in 0..camera.width {
            let want = [(f64::from(i) + 0.5 - camera.cx) / camera.fx, (f64::from(j) + 0.5 - camera.cy) / camera.fy];
            let [mut x, mut y] = want;
            for _ in 0..50 {
                let h = 1e-6;
                let [at, dx, dy] = [d.distort(x, y), d.distort(x + h, y), d.distort(x, y + h)];
                let (a, b, c, e) = ((dx[0] - at[0]) / h, (dy[0] - at[0]) / h, (dx[1] - at[1]) / h, (dy[1] - at[1]) / h);
                let (ex, ey) = (want[0] - at[0], want[1] - at[1]);
                let det = a * e - b * c;
                x += (e * ex - b * ey) / det;
                y += (a * ey - c * ex) / det;
            }
            let [r, g, b] = pattern(x, y).map(|v| v.round().clamp(0.0, 255.0) as u8);
            out.push([r, g, b, 255]);
        }
    }
    out
}

/// Largest and mean difference from the pinhole picture, in levels, and the number of ignored pixels, if a picture
/// taken with `lens` is undistorted with `d`.
fn undistortion_error(lens: Distortion, d: Distortion) -> (f64, f64, usize) {
    let camera = Camera { cx: 63.0, cy: 46.5, ..camera(128, 96) };
    let image = ViewImage { width: 128, height: 96, rgba: distorted_picture(&camera, lens) };
    let out = view_resample::undistort(&image, &camera, &d);
    let (mut worst, mut sum, mut ignored) = (0.0f64, 0.0, 0);
    for (place, pixel) in (0..).zip(&out.rgba) {
        if pixel[3] == IGNORED {
            ignored += 1;
            continue;
        }
        assert_eq!(pixel[3], OPAQUE);
        let (i, j) = (f64::from(place % 128) + 0.5, f64::from(place / 128) + 0.5);
        let want = pattern((i - camera.cx) / camera.fx, (j - camera.cy) / camera.fy);
        for (got, want) in pixel.iter().zip(want) {
            let error = (f64::from(*got) - want).abs();
            worst = worst.max(error);
            sum += error / 3.0;
        }
    }
    (worst, sum / (out.rgba.len() - ignored) as f64, ignored)
}

/// Measured: at most 1.2 levels (two roundings to 8 bits, and the curvature of the waves), 4.4 where the outermost half
/// pixel is filled with its neighbour; mean 0.31. With a wrong coefficient at least 7.6, mean at least 1.03.
#[test]
fn undistortion_gives_the_pinhole_picture() {
    for (d, ignores) in [
        (Distortion { k1: -0.2, k2: 0.03, p1: 0.002, p2: -0.003, k3: 0.0, fisheye: None }, false),
        (Distortion { k1: 0.15, k2: -0.02, p1: -0.004, p2: 0.001, k3: 0.0, fisheye: None }, true),
    ] {
        let (worst, mean, ignored) = undistortion_error(d, d);
        assert!(worst < 5.0 && mean < 0.35, "{d:?}: worst {worst}, mean {mean}, {ignored} ignored");
        assert_eq!(ignored > 200, ignores, "{ignored}");
        for wrong in
            [Distortion { k1: -d.k1, ..d }, Distortion { p1: -d.p1, ..d }, Distortion { p1: d.p2, p2: d.p1, ..d }]
        {
            let (worst, mean, _) = undistortion_error(d, wrong);
            assert!(worst > 6.0 && mean > 0.7, "{wrong:?}: worst {worst}, mean {mean}");
        }
    }
}

/// The same for fisheye lenses: measured at most 1.04 levels, mean 0.30. Taken for a lens without its terms, or for a pinhole,
/// the picture is another one.
#[test]
fn undistortion_of_a_fisheye_gives_the_pinhole_picture() {
    let lens = |k: [f64; 4]| Distortion { fisheye: Some(k), ..Distortion::default() };
    let d = lens([0.08, -0.05, 0.01, 0.002]);
    let (worst, mean, ignored) = undistortion_error(d, d);
    assert!(worst < 5.0 && mean < 0.4, "worst {worst}, mean {mean}, {ignored} ignored");
    for wrong in [lens([0.0; 4]), lens([0.08, 0.05, 0.01, 0.002]), Distortion::default()] {
        let (worst, mean, _) = undistortion_error(d, wrong);
        assert!(worst > 6.0 && mean > 0.4, "{wrong:?}: worst {worst}, mean {mean}");
    }
}

/// Opaque pixels take a faster path; a nearly opaque one must give the same colours.
#[test]
fn undistortion_of_partly_transparent_pictures() {
    let camera = camera(64, 48);
    let d = Distortion { k1: -0.2, k2: 0.03, p1: 0.002, p2: -0.003, k3: 0.0, fisheye: None };
    let opaque = ViewImage { width: 64, height: 48, rgba: distorted_picture(&camera, d) };
    let with = |byte: u8| {
        let rgba = opaque.rgba.iter().map(|p| [p[0], p[1], p[2], byte]).collect();
        view_resample::undistort(&ViewImage { rgba, ..opaque }, &camera, &d).rgba
    };
    for (a, b) in with(OPAQUE).iter().zip(with(100)) {
        assert!((0..3).all(|k| a[k].abs_diff(b[k]) <= 1) && (a[3], b[3]) == (OPAQUE, 100), "{a:?} {b:?}");
    }
    assert!(with(1).iter().all(|p| *p == [0, 0, 0, 1]));
    // A transparent side adds no colour to its neighbours, and their coverage falls smoothly to it.
    let rgba = (0..64 * 48).map(|i| if i % 64 < 10 { [200, 9, 9, 1] } else { [5, 6, 7, 255] }).collect();
    let out = view_resample::undistort(&ViewImage { rgba, ..opaque }, &camera, &d).rgba;
    assert!(out.iter().all(|p| p[3] == 1 || *p == [5, 6, 7, p[3]]));
    assert!(out.iter().any(|p| p[3] > 60 && p[3] < 190));
}

/// A mask and a picture of the same lens stay aligned: both encode the column and row of each pixel.
#[test]
fn masks_are_undistorted_as_photos_are() {
    let camera = camera(100, 80);
    let d = Distortion { k1: 0.15, k2: -0.02, p1: -0.004, p2: 0.001, k3: 0.0, fisheye: None };
    let place = |k: u32| (k % 100, k / 100);
    let rgba = (0..8000).map(|k| [2 * place(k).0 as u8, 2 * place(k).1 as u8, 0, 255]).collect();
    let photo = view_resample::undistort(&ViewImage { width: 100, height: 80, rgba }, &camera, &d);
    let mask = Mask { width: 100, height: 80, ids: (1..=8000).collect() };
    let ids = view_resample::undistort_ids(&mask, &camera, &d).ids;
    let (mut moved, mut outside) = (0, 0);
    for (k, (&id, pixel)) in (0..).zip(ids.iter().zip(&photo.rgba)) {
        assert_eq!(id == 0, pixel[3] == IGNORED, "{k}");
        if id == 0 {
            outside += 1;
            continue;
        }
        let (column, row) = place(u32::from(id) - 1);
        // Half a pixel, plus the rounding of the colour.
        assert!((column as f64 - f64::from(pixel[0]) / 2.0).abs() <= 0.76, "{k}: {column} {pixel:?}");
        assert!((row as f64 - f64::from(pixel[1]) / 2.0).abs() <= 0.76, "{k}: {row} {pixel:?}");
        moved += u32::from(u32::from(id) - 1 != k);
    }
    assert!(moved > 2000 && outside > 100, "{moved} {outside}");
}

#[test]
fn what_is_beyond_the_fold_is_ignored() {
    // The radius r (1 - r^2) folds at r^2 = 1/3; the corners of this camera are at r^2 = 0.86, and map inside the
    // image.
    let camera = camera(128, 96);
    let d = Distortion { k1: -1.0, ..Distortion::default() };
    let image = ViewImage { width: 128, height: 96, rgba: vec![[5, 6, 7, 255]; 128 * 96] };
    let out = view_resample::undistort(&image, &camera, &d);
    assert_eq!((out.rgba[0], out.rgba[48 * 128 + 64]), ([0, 0, 0, IGNORED], [5, 6, 7, 255]));
    let seen = out.rgba.iter().filter(|p| p[3] == OPAQUE).count() as f64;
    // An ellipse of radii fx / sqrt 3 and fy / sqrt 3 pixels, not clipped: 7540 pixels.
    assert!((seen - std::f64::consts::PI * 90.0 * 80.0 / 3.0).abs() < 60.0, "{seen}");
    // Ignored pixels add no colour to their neighbours.
    let mut holed = image;
    holed.rgba[48 * 128 + 64] = [255, 0, 0, IGNORED];
    let out = view_resample::undistort(&holed, &camera, &Distortion { k1: -0.01, ..d });
    assert!(out.rgba.iter().all(|p| p[3] == IGNORED || *p == [5, 6, 7, 255]));
    assert_eq!(out.rgba.iter().filter(|p| p[3] == IGNORED).count(), 1);
}
