//! Packed scenes: their pictures are those of the scenes that the host unpacks, close to those of the scenes in f32, and they
//! take the bytes that were planned.

use instgs_vk::render::device_scene::planned_bytes;
use instgs_vk::render::{PackedScene, Picture, RenderOptions, Renderer};
use instgs_vk::scene::{Camera, DevicePrecision, InstancedScene};

use crate::common::gpu::{assert_silent, device_options, gpu};
use crate::common::random_scene::{RandomCase, random_case, rare_case};

const PACKED: [DevicePrecision; 2] = [DevicePrecision::F16, DevicePrecision::Q8];

fn picture(renderer: &mut Renderer, scene: &InstancedScene, camera: &Camera, options: &RenderOptions) -> Picture {
    let on_device = renderer.upload_for(scene, options).unwrap();
    assert_eq!(on_device.precision, options.device_precision);
    renderer.render(&on_device, camera, options).unwrap();
    renderer.download().unwrap()
}

/// Numbers of two pictures' colours and alphas that differ by more than `tolerance`, and how many there are.
fn differing(a: &Picture, b: &Picture, tolerance: f32) -> (usize, usize) {
    let pairs = a.colors.as_flattened().iter().zip(b.colors.as_flattened());
    // A number that is not finite differs.
    let differ = pairs.filter(|(a, b)| (*a - *b).abs() > tolerance || !(*a - *b).is_finite()).count();
    (differ, 4 * a.colors.len())
}

/// A splat at the smallest alpha that is blended may be on either side of it, as the last bit of an exponential decides: up to
/// 1/255 in so many of a picture's numbers.
const MOST_AT_THE_EDGE: f64 = 0.0005;

fn cases() -> impl Iterator<Item = RandomCase> {
    (0..25).map(random_case).chain((0..25).map(rare_case))
}

/// `render(packed)` equals `render(unpacked on the host)` within 1e-5.
#[test]
fn pictures_are_those_of_what_the_host_unpacks() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let (mut all, mut at_the_edge) = (0, 0);
    for case in cases() {
        for precision in PACKED {
            let full = device_options(&case.options);
            let packed = RenderOptions { device_precision: precision, ..full };
            let words = PackedScene::new(&case.scene, &case.scene.offset_runs(), precision).unwrap();
            let want = picture(&mut renderer, &words.unpacked(&case.scene), &case.camera, &full);
            let got = picture(&mut renderer, &case.scene, &case.camera, &packed);
            let (seed, again) = (case.seed, picture(&mut renderer, &case.scene, &case.camera, &packed));
            assert!(got == again, "seed {seed}, {precision:?}: not the same bytes twice");
            let (differ, numbers) = differing(&got, &want, 1e-5);
            (all, at_the_edge) = (all + numbers, at_the_edge + differ);
            let (wrong, _) = differing(&got, &want, 1.05 / 255.0);
            assert_eq!(wrong, 0, "seed {seed}, {precision:?}: {differ} of {numbers} differ");
        }
    }
    println!("{at_the_edge} of {all} numbers differ by more than 1e-5");
    assert!(at_the_edge as f64 <= MOST_AT_THE_EDGE * all as f64, "{at_the_edge} of {all}");
    assert_silent(&gpu);
}

/// The root mean square difference to the picture in f32 over all cases: f16 below 1/255, q8 below 4/255 with the random
/// scenes' large offsets.
#[test]
fn pictures_are_close_to_those_in_f32() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    for (precision, most) in PACKED.into_iter().zip([1.0 / 255.0, 4.0 / 255.0]) {
        let (mut squares, mut numbers) = (0.0, 0.0);
        for case in cases() {
            let full = device_options(&case.options);
            let want = picture(&mut renderer, &case.scene, &case.camera, &full);
            let packed = RenderOptions { device_precision: precision, ..full };
            let got = picture(&mut renderer, &case.scene, &case.camera, &packed);
            let pairs = got.colors.as_flattened().iter().zip(want.colors.as_flattened());
            squares += pairs.map(|(a, b)| f64::from(a - b).powi(2)).sum::<f64>();
            numbers += 4.0 * got.colors.len() as f64;
        }
        let rms: f64 = (squares / numbers).sqrt();
        println!("{precision:?}: {rms:.2e}");
        assert!(rms < most && rms > 0.0, "{precision:?}: {rms:.2e}");
    }
}

#[test]
fn bytes_are_as_planned_and_about_half() {
    let Some(gpu) = gpu() else { return };
    let renderer = Renderer::new(&gpu).unwrap();
    for case in cases() {
        for precision in DevicePrecision::ALL {
            let options = RenderOptions { device_precision: precision, ..RenderOptions::default() };
            let on_device = renderer.upload_for(&case.scene, &options).unwrap();
            let planned = planned_bytes(&case.scene, on_device.chunk_size, precision);
            assert_eq!(on_device.bytes(), planned.total(), "seed {}, {precision:?}", case.seed);
        }
        let of = |precision| planned_bytes(&case.scene, 256, precision);
        let [full, half_of_all, codes] = DevicePrecision::ALL.map(of);
        assert_eq!(half_of_all.offsets * 2, full.offsets, "seed {}", case.seed);
        // A few records do not pay for the limits of their codes.
        let few = case.scene.offsets.len() < 100;
        let shared = case.scene.offsets.sh_rest.len() as u64 * 6;
        let (codes, half) = (codes.offsets - shared, half_of_all.offsets - shared);
        assert!(few || codes * 4 <= half * 3, "seed {}: {codes} and {half}", case.seed);
        let (half, full) = (half_of_all.background, full.background);
        assert!(half * 100 <= full * 60, "seed {}: {half} and {full}", case.seed);
    }
}

/// Levels of detail are packed, too, and full detail is that of a scene without levels.
#[test]
fn levels_of_detail_are_packed() {
    let Some(gpu) = gpu() else { return };
    let mut renderer = Renderer::new(&gpu).unwrap();
    let mut changed = 0;
    for case in (0..10).map(random_case).chain((0..10).map(rare_case)) {
        for precision in PACKED {
            let plain = RenderOptions { device_precision: precision, ..device_options(&case.options) };
            let levels = RenderOptions { lod_error_px: 25.0, ..plain };
            let on_device = renderer.upload_for(&case.scene, &levels).unwrap();
            let full = picture(&mut renderer, &case.scene, &case.camera, &plain);
            let mut drawn = |options: &RenderOptions| {
                renderer.render(&on_device, &case.camera, options).unwrap();
                renderer.download().unwrap()
            };
            let (with_levels, without) = (drawn(&levels), drawn(&plain));
            // Levels' offsets may share the limits of codes with those at full detail.
            let (differ, numbers) = differing(&without, &full, 1.05 / 255.0);
            let allowed = if precision == DevicePrecision::Q8 { numbers / 100 } else { 0 };
            assert!(differ <= allowed, "seed {}, {precision:?}: {differ} of {numbers}", case.seed);
            assert!(precision == DevicePrecision::Q8 || without == full, "seed {}", case.seed);
            let in_f32 = RenderOptions { device_precision: DevicePrecision::F32, ..levels };
            let want = picture(&mut renderer, &case.scene, &case.camera, &in_f32);
            let squares: f32 = want
                .colors
                .as_flattened()
                .iter()
                .zip(with_levels.colors.as_flattened())
                .map(|(a, b)| (a - b).powi(2))
                .sum();
            let rms = (squares / (4 * want.colors.len()) as f32).sqrt();
            assert!(rms < 0.05, "seed {}, {precision:?}: {rms}", case.seed);
            changed += usize::from(with_levels != without);
        }
    }
    assert!(changed > 10, "{changed}");
    assert_silent(&gpu);
}
