//! Adam against its twin.

use std::sync::Arc;

use instgs_reference::adam::{AdamOptions, AdamState, adam_step};
use instgs_vk::gpu::staging::{download, upload, write};
use instgs_vk::gpu::{Buffer, Gpu, Home, PipelineCache, Recorder};
use instgs_vk::kernels::{BackwardPipelines, SceneTraits, Variant};
use instgs_vk::math::rng::Rng;
use instgs_vk::optim::{Adam, AdamBuffers, MomentBuffer, ValueGroups, zero_moments};

use crate::common::gpu::{assert_silent, gpu, with_bindings_of};

/// Values that follow those which are stepped, and must stay.
const TAIL: usize = 3;

/// A buffer that dispatches may bind in parts.
fn in_parts(gpu: &Arc<Gpu>, name: &str, values: &[f32]) -> Buffer<f32> {
    let mut buffer = Buffer::in_parts(gpu, name, values.len(), Home::Device).unwrap();
    write(gpu, &mut buffer, values).unwrap();
    buffer
}

/// Parameters with moments on the device.
struct DeviceAdam {
    gpu: Arc<Gpu>,
    pipelines: BackwardPipelines,
    workgroup_size: u32,
    recorder: Recorder,
    status: Buffer<u32>,
    parameters: Buffer<f32>,
    moments: MomentBuffer,
    count: usize,
}

impl DeviceAdam {
    fn new(gpu: &Arc<Gpu>, parameters: &[f32]) -> Self {
        let variant = Variant::for_training(gpu.caps());
        let cache = PipelineCache::new(gpu, None).unwrap();
        let padded = [parameters, &[7.5; TAIL]].concat();
        Self {
            gpu: gpu.clone(),
            pipelines: BackwardPipelines::new(gpu, &cache, variant, SceneTraits::plain(0), false).unwrap(),
            workgroup_size: variant.workgroup_size,
            recorder: Recorder::new(gpu).unwrap(),
            status: upload(gpu, "status", &[0; 4]).unwrap(),
            parameters: in_parts(gpu, "parameters", &padded),
            moments: zero_moments(gpu, "moments", padded.len()).unwrap(),
            count: parameters.len(),
        }
    }

    fn step(&mut self, gradients: &[f32], step: u64, rate: f64) {
        self.step_groups(gradients, step, ValueGroups::single(gradients.len(), rate));
    }

    fn step_groups(&mut self, gradients: &[f32], step: u64, groups: ValueGroups) {
        assert_eq!(groups.counts[0] + groups.counts[1], self.count);
        let padded = [gradients, &[1.0; TAIL]].concat();
        let gradients = in_parts(&self.gpu, "gradients", &padded);
        let AdamOptions { beta1, beta2, epsilon } = AdamOptions::default();
        let adam = Adam { beta1, beta2, epsilon, step };
        let (pipeline, size) = (&self.pipelines.adam, self.workgroup_size);
        let (parameters, moments) = (&mut self.parameters, &mut self.moments);
        let buffers = AdamBuffers { gradients: &gradients, parameters, moments };
        adam.record(&mut self.recorder, pipeline, size, &self.status, buffers, groups).unwrap();
        let ticket = self.recorder.submit().unwrap();
        self.recorder.wait(ticket).unwrap();
    }

    /// Parameters and moments, tail included.
    fn download(&self) -> (Vec<f32>, Vec<[f32; 2]>) {
        let all = self.count + TAIL;
        (download(&self.gpu, &self.parameters, all).unwrap(), download(&self.gpu, &self.moments, all).unwrap())
    }
}

/// The last thread steps four values whatever their number: all of them have memory.
#[test]
fn the_last_four_values_have_memory() {
    let Some(gpu) = gpu() else { return };
    for count in 1..10 {
        let quads = (count as u64).div_ceil(4);
        assert!(zero_moments(&gpu, "moments", count).unwrap().padded_bytes() >= 32 * quads, "{count}");
        assert!(upload(&gpu, "parameters", &vec![0.0f32; count]).unwrap().padded_bytes() >= 16 * quads, "{count}");
    }
}

/// Arrays that are larger than a binding take several dispatches, and get the same bytes; the groups meet within one of them.
#[test]
fn arrays_in_parts_get_the_same_bytes() {
    let Some(gpu) = gpu() else { return };
    let small = with_bindings_of(&gpu, 160 << 10);
    let mut rng = Rng::new(3);
    for count in [20_000, 50_001, 61_440] {
        let start: Vec<f32> = (0..count).map(|_| rng.normal() as f32).collect();
        let mut devices = [&gpu, &small].map(|gpu| DeviceAdam::new(gpu, &start));
        for step in 1..=3 {
            let g = gradients(&mut rng, count);
            let split = 31_007.min(count - 1);
            let groups = ValueGroups { counts: [split, count - split], rates: [0.01, 0.002] };
            devices.iter_mut().for_each(|device| device.step_groups(&g, step, groups));
        }
        let [whole, parts] = devices.map(|device| device.download());
        assert!(parts == whole, "{count}");
    }
    assert_silent(&small);
}

/// Gradients whose sizes differ by ten orders of magnitude from value to value and vary from step to step.
fn gradients(rng: &mut Rng, count: usize) -> Vec<f32> {
    (0..count).map(|i| (10f64.powi(i as i32 % 11 - 8) * (rng.normal() + 0.3)) as f32).collect()
}

/// Largest errors over `steps` steps: of parameters in units of the way that the rate allows, and of moments relative to
/// the largest moment that the value has had.
fn errors(gpu: &Arc<Gpu>, (count, split): (usize, usize), steps: u64, plant: impl Fn(u64) -> u64) -> (f64, f64) {
    let mut rng = Rng::new(count as u64);
    let start: Vec<f32> = (0..count).map(|_| rng.normal() as f32).collect();
    let mut device = DeviceAdam::new(gpu, &start);
    let mut twin = AdamState::new(start.iter().map(|&v| f64::from(v)).collect());
    let mut largest = vec![[f64::MIN_POSITIVE; 2]; count];
    let mut way = 0.0;
    for step in 1..=steps {
        let g = gradients(&mut rng, count);
        let rates = [rng.range(0.001, 0.02), rng.range(0.001, 0.02)];
        way += rates[0].min(rates[1]);
        device.step_groups(&g, plant(step), ValueGroups { counts: [split, count - split], rates });
        let wide: Vec<f64> = g.iter().map(|&v| f64::from(v)).collect();
        adam_step(&AdamOptions::default(), &mut twin, &wide, step, (rates, split));
        for (i, l) in largest.iter_mut().enumerate() {
            *l = [l[0].max(twin.first_moments[i].abs()), l[1].max(twin.second_moments[i])];
        }
    }
    let (parameters, moments) = device.download();
    assert_eq!(parameters[count..], [7.5; TAIL]);
    assert_eq!(moments[count..], [[0.0; 2]; TAIL]);
    let parameter = (0..count).map(|i| (f64::from(parameters[i]) - twin.parameters[i]).abs() / way).fold(0.0, f64::max);
    let moment = (0..count).map(|i| {
        let first = (f64::from(moments[i][0]) - twin.first_moments[i]).abs() / largest[i][0];
        first.max((f64::from(moments[i][1]) - twin.second_moments[i]).abs() / largest[i][1])
    });
    (parameter, moment.fold(0.0, f64::max))
}

/// Measured: parameters 8.4e-6 of the way, moments 1.3e-5, which is how well f32 holds 1 - 0.999.
#[test]
fn many_steps_agree_with_the_twin() {
    let Some(gpu) = gpu() else { return };
    for (count, split, steps) in [(1, 1, 200), (255, 0, 60), (257, 131, 60), (100_003, 50_001, 25)] {
        let (parameter, moment) = errors(&gpu, (count, split), steps, |step| step);
        println!("adam, {count} values, {steps} steps: parameters {parameter:.1e} of the way, moments {moment:.1e}");
        assert!(parameter < 2e-5 && moment < 5e-5, "{count}: {parameter:e} {moment:e}");
    }
    let (late, _) = errors(&gpu, (255, 255), 60, |step| step + 1);
    assert!(late > 1e-3, "a step count that is off by one is not seen: {late:e}");
    assert_silent(&gpu);
}

/// Whatever its size, a first gradient moves a value by the rate; none moves it by nothing, not by 0 / 0.
#[test]
fn the_first_step_is_the_rate() {
    let Some(gpu) = gpu() else { return };
    let mut device = DeviceAdam::new(&gpu, &[0.0; 6]);
    device.step(&[1e-6, -3.0, 1e6, 0.0, -0.0, -1e-8], 1, 0.01);
    let (got, _) = device.download();
    for (got, want) in got.iter().zip([-0.01, 0.01, -0.01, 0.0, 0.0, 0.01]) {
        assert!((got - want).abs() < 2e-7, "{got} instead of {want}");
    }
    assert!(got[3].to_bits() == 0 && got[4].to_bits() == 0, "{got:?}");
    assert_silent(&gpu);
}

/// The border between the groups lies within a vector of four; a group without a rate is held to the bit; without any
/// rate not even moments change.
#[test]
fn groups_have_their_own_rates() {
    let Some(gpu) = gpu() else { return };
    for split in 0..=9 {
        let mut device = DeviceAdam::new(&gpu, &[1.0; 9]);
        let groups = |rates: [f64; 2]| ValueGroups { counts: [split, 9 - split], rates };
        device.step_groups(&[1.0; 9], 1, groups([0.0, 0.0]));
        assert_eq!(device.download().1[..9], [[0.0; 2]; 9]);
        device.step_groups(&[1.0; 9], 1, groups([0.25, 0.5]));
        device.step_groups(&[1.0; 9], 2, groups([0.0, 0.5]));
        for (i, got) in device.download().0[..9].iter().enumerate() {
            let want = if i < split { 0.75 } else { 0.0 };
            assert!((got - want).abs() < 1e-5, "{split} {i}: {got} instead of {want}");
        }
    }
    assert_silent(&gpu);
}

fn bits((parameters, moments): &(Vec<f32>, Vec<[f32; 2]>)) -> Vec<u32> {
    parameters.iter().chain(moments.as_flattened()).map(|v| v.to_bits()).collect()
}

#[test]
fn an_overflow_makes_it_a_no_op() {
    let Some(gpu) = gpu() else { return };
    let mut rng = Rng::new(1);
    let mut device = DeviceAdam::new(&gpu, &[1.0; 300]);
    device.step(&gradients(&mut rng, 300), 1, 0.01);
    let before = bits(&device.download());
    write(&gpu, &mut device.status, &[1, 0, 0, 0]).unwrap();
    device.step(&gradients(&mut rng, 300), 2, 0.01);
    assert!(bits(&device.download()) == before);
    write(&gpu, &mut device.status, &[0; 4]).unwrap();
    device.step(&gradients(&mut rng, 300), 2, 0.01);
    assert!(bits(&device.download()) != before);
    assert_silent(&gpu);
}

/// A gradient that is no number, or whose square is none, counts as 0: the value goes on by its momentum, and learns from
/// the next gradient as if nothing had been. The same in the twin.
#[test]
fn bad_gradients_count_as_none() {
    let Some(gpu) = gpu() else { return };
    let bad = [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX, -1e16, 1.0];
    let mut device = DeviceAdam::new(&gpu, &[1.0; 6]);
    let mut zeros = DeviceAdam::new(&gpu, &[1.0; 6]);
    let mut twin = AdamState::new(vec![1.0; 6]);
    for step in 1..=6 {
        let g = if step % 2 == 0 { bad } else { [0.5; 6] };
        device.step(&g, step, 0.01);
        zeros.step(&g.map(|v| if v == 1.0 || v == 0.5 { v } else { 0.0 }), step, 0.01);
        adam_step(&AdamOptions::default(), &mut twin, &g.map(f64::from), step, ([0.01, 0.0], 6));
    }
    assert!(bits(&device.download()) == bits(&zeros.download()));
    for (got, want) in device.download().0.iter().zip(&twin.parameters) {
        assert!((f64::from(*got) - want).abs() < 1e-6, "{got} instead of {want}");
    }
    assert_silent(&gpu);
}
