//! Exposures of photos: each pass against the twin, and steps of Adam on several photos.

use std::sync::Arc;

use instgs_reference::adam::AdamOptions;
use instgs_reference::exposure::{ExposureState, apply, backward, recentre};
use instgs_vk::gpu::interface::constants::STATUS_COUNT;
use instgs_vk::gpu::staging::{download, upload};
use instgs_vk::gpu::{Gpu, PipelineCache, Recorder};
use instgs_vk::kernels::Variant;
use instgs_vk::math::rng::Rng;
use instgs_vk::optim::{Adam, ExposedView, Exposure, ExposureStep, Exposures, NO_EXPOSURE};

use crate::common::gpu::{assert_silent, gpu};
use crate::common::tensor::TensorComparison;

const VIEWS: usize = 3;
const LARGEST_PX: [u32; 2] = [135, 240];
const ADAM: Adam = Adam { beta1: 0.9, beta2: 0.999, epsilon: 1e-15, step: 1 };
const TOLERANCE: f64 = 1e-5;
const BACKGROUND: [f32; 3] = [0.25, 0.5, 1.0];

struct Device {
    gpu: Arc<Gpu>,
    recorder: Recorder,
    exposures: Exposures,
}

/// What the two passes make of a picture.
struct Passed {
    exposed: Vec<[f32; 4]>,
    by_color: Vec<[f32; 4]>,
}

impl Device {
    fn new(gpu: &Arc<Gpu>) -> Self {
        let cache = PipelineCache::new(gpu, None).unwrap();
        let exposures = Exposures::new(gpu, &cache, &Variant::for_training(gpu.caps()), VIEWS, LARGEST_PX).unwrap();
        Self { gpu: gpu.clone(), recorder: Recorder::new(gpu).unwrap(), exposures }
    }

    /// One step of a photo; `overflowed` is the device's flag.
    fn step(&mut self, view: ExposedView, case: &Case, step: ExposureStep, overflowed: bool) -> Passed {
        let colors = upload(&self.gpu, "colors", &case.colors).unwrap();
        let mut cotangents = upload(&self.gpu, "cotangents", &case.cotangents).unwrap();
        let status = upload(&self.gpu, "status", &[u32::from(overflowed); STATUS_COUNT as usize]).unwrap();
        let (exposures, recorder) = (&mut self.exposures, &mut self.recorder);
        exposures.record_apply(recorder, view, &colors).unwrap();
        exposures.record_backward(recorder, view, &colors, &mut cotangents).unwrap();
        exposures.record_adam(recorder, view, step, &status).unwrap();
        let ticket = recorder.submit().unwrap();
        recorder.wait(ticket).unwrap();
        let pixels = case.colors.len();
        Passed {
            exposed: download(&self.gpu, exposures.exposed(), pixels).unwrap(),
            by_color: download(&self.gpu, &cotangents, pixels).unwrap(),
        }
    }

    /// Makes the mean the identity; `overflowed` is the device's flag.
    fn recentre(&mut self, overflowed: bool) {
        let status = upload(&self.gpu, "status", &[u32::from(overflowed); STATUS_COUNT as usize]).unwrap();
        self.exposures.record_recentre(&mut self.recorder, &status).unwrap();
        let ticket = self.recorder.submit().unwrap();
        self.recorder.wait(ticket).unwrap();
    }

    fn check_values(&self, twins: &[ExposureState]) {
        let got: Vec<f64> = self.values().as_flattened().as_flattened().iter().map(|&v| f64::from(v)).collect();
        let want: Vec<f64> = twins.iter().flat_map(|twin| twin.adam.parameters.clone()).collect();
        TensorComparison::new("exposures", &got, &want).check(TOLERANCE).unwrap();
    }

    fn values(&self) -> Vec<Exposure> {
        self.exposures.download(&self.gpu).unwrap()
    }
}

struct Case {
    colors: Vec<[f32; 4]>,
    cotangents: Vec<[f32; 4]>,
}

fn case(size_px: [u32; 2], seed: u64) -> Case {
    let mut rng = Rng::new(seed);
    let mut random = |scale: f64| -> Vec<[f32; 4]> {
        (0..size_px[0] * size_px[1]).map(|_| [0; 4].map(|_| (scale * rng.normal()) as f32)).collect()
    };
    let (mut colors, mut cotangents) = (random(0.5), random(1e-5));
    colors.iter_mut().for_each(|color| color[3] = color[3].abs().min(1.0));
    cotangents.iter_mut().for_each(|g| g[3] = 0.0);
    Case { colors, cotangents }
}

fn random_exposures(seed: u64) -> Vec<Exposure> {
    let mut rng = Rng::new(seed);
    let mut one = || NO_EXPOSURE.map(|row| row.map(|v| v + (0.1 * rng.normal()) as f32));
    (0..VIEWS).map(|_| one()).collect()
}

fn rgb(values: &[[f32; 4]]) -> Vec<[f64; 3]> {
    values.iter().map(|v| [v[0], v[1], v[2]].map(f64::from)).collect()
}

fn rgba(values: &[[f32; 4]]) -> Vec<[f64; 4]> {
    values.iter().map(|v| v.map(f64::from)).collect()
}

fn wide(exposure: &Exposure) -> [[f64; 4]; 3] {
    exposure.map(|row| row.map(f64::from))
}

fn check<const N: usize>(name: &str, got: &[[f64; N]], want: &[[f64; N]]) {
    TensorComparison::new(name, got.as_flattened(), want.as_flattened()).check(TOLERANCE).unwrap();
}

/// Pictures of odd sizes, views in any order, four rounds: every pass, what Adam makes of the exposures, and
/// their mean, which an overflow leaves as it is.
#[test]
fn passes_and_steps_agree_with_the_twin() {
    let Some(gpu) = gpu() else { return };
    let mut device = Device::new(&gpu);
    let start = random_exposures(3);
    device.exposures.set(&gpu, &start).unwrap();
    let mut twins = vec![ExposureState::default(); VIEWS];
    for (twin, exposure) in twins.iter_mut().zip(&start) {
        twin.adam.parameters = wide(exposure).as_flattened().to_vec();
    }
    let (options, rate) = (AdamOptions::default(), 3e-3);
    for round in 0..4u64 {
        for (n, view) in [1, 0, 2].into_iter().enumerate() {
            let size_px = [[1, 1], [33, 57], [64, 48], LARGEST_PX][(n + round as usize) % 4];
            let case = case(size_px, 10 * round + n as u64);
            let before = device.values();
            let step = ExposureStep { adam: Adam { step: round + 1, ..ADAM }, rate };
            let passed = device.step(ExposedView { view, size_px, background: BACKGROUND }, &case, step, false);
            let exposure = wide(&before[view]);
            let (colors, cotangents) = (rgba(&case.colors), rgb(&case.cotangents));
            let want: Vec<_> = colors.iter().map(|&c| apply(&exposure, c, BACKGROUND.map(f64::from))).collect();
            check("exposed", &rgb(&passed.exposed), &want);
            assert!(passed.exposed.iter().zip(&case.colors).all(|(a, b)| a[3] == b[3]), "alpha");
            let (by_color, by_exposure) = backward(&exposure, &colors, BACKGROUND.map(f64::from), &cotangents);
            check("by_color", &rgba(&passed.by_color), &by_color);
            twins[view].step(&options, &by_exposure, round + 1, rate);
            device.check_values(&twins);
        }
        device.recentre(round == 3);
        if round < 3 {
            recentre(&mut twins);
        }
        device.check_values(&twins);
    }
    assert_silent(&gpu);
}

/// The comparison sees a wrong rate, and values that are a little too small.
#[test]
fn the_comparison_fails_on_planted_errors() {
    let Some(gpu) = gpu() else { return };
    let mut device = Device::new(&gpu);
    let (size_px, view) = ([33, 57], 1);
    let case = case(size_px, 1);
    let rate = 3e-3;
    device.step(ExposedView { view, size_px, background: BACKGROUND }, &case, ExposureStep { adam: ADAM, rate }, false);
    let got: Vec<f64> = device.values()[view].as_flattened().iter().map(|&v| f64::from(v)).collect();
    let (_, gradient) =
        backward(&wide(&NO_EXPOSURE), &rgba(&case.colors), BACKGROUND.map(f64::from), &rgb(&case.cotangents));
    let twin = |rate: f64, scale: f64| {
        let mut twin = ExposureState::default();
        twin.step(&AdamOptions::default(), &gradient, 1, rate);
        let values: Vec<f64> = twin.adam.parameters.iter().map(|v| v * scale).collect();
        TensorComparison::new("exposure", &got, &values).check(TOLERANCE)
    };
    assert_eq!(twin(rate, 1.0), Ok(()));
    assert!(twin(1.01 * rate, 1.0).is_err() && twin(rate, 0.9999).is_err());
    assert_silent(&gpu);
}

/// A step that overflowed changes nothing, nor does one that sees nothing but absurd pixels make an exposure absurd.
#[test]
fn overflows_and_absurd_pixels_leave_exposures_sound() {
    let Some(gpu) = gpu() else { return };
    let mut device = Device::new(&gpu);
    let (size_px, view) = ([40, 31], 2);
    let step = ExposureStep { adam: ADAM, rate: 1e-2 };
    let good = case(size_px, 7);
    device.step(ExposedView { view, size_px, background: BACKGROUND }, &good, step, true);
    assert_eq!(device.values(), [NO_EXPOSURE; VIEWS]);
    for bad in [f32::NAN, f32::INFINITY, f32::MAX, -1e20] {
        let mut case = case(size_px, 8);
        case.colors[100] = [bad; 4];
        let passed = device.step(ExposedView { view, size_px, background: BACKGROUND }, &case, step, false);
        assert!(passed.exposed.iter().all(|v| v[..3].iter().all(|v| v.is_finite())), "{bad}");
        let values = device.values();
        assert_eq!(values[..view], [NO_EXPOSURE; VIEWS - 1], "other photos");
        assert!(values[view].as_flattened().iter().all(|v| v.is_finite() && v.abs() < 2.0), "{bad}: {values:?}");
    }
    assert_silent(&gpu);
}

/// Two runs give the same bytes.
#[test]
fn repeats_give_the_same_bytes() {
    let Some(gpu) = gpu() else { return };
    let run = || {
        let mut device = Device::new(&gpu);
        let step = ExposureStep { adam: ADAM, rate: 1e-2 };
        for view in 0..VIEWS {
            device.step(
                ExposedView { view, size_px: LARGEST_PX, background: BACKGROUND },
                &case(LARGEST_PX, view as u64),
                step,
                false,
            );
        }
        device.recentre(false);
        device.values()
    };
    assert_eq!(run(), run());
    assert_silent(&gpu);
}
