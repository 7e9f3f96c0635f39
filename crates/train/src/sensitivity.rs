//! Measures how much pictures change with each parameter, by the passes of training.
//!
//! A training step against a picture of pure noise, each channel of each pixel 0 or 1 at random, has the gradient of the
//! colour times +1 or -1 at random, whatever the rendering is: its square is on average the sum of the squared derivatives
//! over pixels and channels (Hutchinson's estimator of the diagonal of J^T J). Adam's second moments average it over the
//! views; learning rates are too small to change a parameter.
//! Shapes are no parameters: their squares are averaged on the host (`shape_sensitivity.rs`).

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;
use std::sync::Arc;

use instgs_io::small::{Sensitivity, SmallOptions};
use instgs_io::view_image::OPAQUE;
use instgs_io::{IoError, LoadedView, Split, View, ViewImage, read_views, write_small_scene_file};
use instgs_vk::gpu::staging::download;
use instgs_vk::gpu::{Gpu, GpuError};
use instgs_vk::kernels::Variant;
use instgs_vk::math::rng::Rng;
use instgs_vk::optim::Adam;
use instgs_vk::render::RenderOptions;
use instgs_vk::scene::offset_runs::sources_of_records;
use instgs_vk::scene::{Camera, InstancedScene, Owner, Parameter, ParameterSet};

use super::config::{GaussianRates, PoseRates, Rates};
use super::device_state::DeviceState;
use super::error::TrainError;
use super::shape_sensitivity::{ShapeGradients, ShapeSums};
use super::step_runner::{LearnEvery, StepPlan, StepRunner};
use super::views::TrainViews;

/// A learning rate that changes no f32 but 0, and that only by less than any picture shows.
const NO_RATE: f64 = 1e-30;
/// Decay of the second moments: over at most some hundred views, all count nearly the same.
const DECAY: f64 = 0.999;
/// Seed of the noise: the same scene and cameras give the same numbers.
const SEED: u64 = 1;

/// The usual closeness of pictures of a packed scene to those of the unpacked one, dB of PSNR by the measure of sensitivity,
/// which is some 3 dB more than what it comes to: scenes 30 to 32 dB from their photos lose 0.05 to 0.1 dB.
pub const USUAL_PICTURE_PSNR_DB: f64 = 50.0;

/// Sensitivity is measured from at most this many views: each has as many probes as a picture has values.
const MOST_VIEWS: usize = 60;

/// The cameras of a data set that sensitivity is measured from: training views, evenly over the set.
///
/// # Errors
/// The data set cannot be read.
pub fn sensitivity_cameras(data: &Path) -> Result<Vec<Camera>, IoError> {
    let dataset = read_views(data)?;
    let views: Vec<&View> = dataset.split(Split::Train).collect();
    Ok(views.iter().step_by(views.len().div_ceil(MOST_VIEWS).max(1)).map(|view| view.camera.clone()).collect())
}

/// Writes a scene as `--pack small`, as precisely as these views need.
///
/// # Errors
/// As for [`measure_sensitivity`], or the file cannot be written.
pub fn write_small(
    gpu: &Arc<Gpu>,
    path: &Path,
    scene: &InstancedScene,
    cameras: &[Camera],
    picture_psnr_db: f64,
) -> Result<(), TrainError> {
    let sensitivity = measure_sensitivity::<TrainError>(gpu, scene, cameras, || Ok(()))?;
    Ok(write_small_scene_file(path, scene, &SmallOptions { sensitivity: &sensitivity, picture_psnr_db })?)
}

/// Measures a scene's sensitivity from these cameras, one probe each. `on_view` is called after each; `E` is the caller's error
/// type, with which it can stop.
///
/// # Errors
/// There are no cameras; the scene is inconsistent or beyond the device's limits; the device fails; or what `on_view` returns.
pub fn measure_sensitivity<E: From<TrainError>>(
    gpu: &Arc<Gpu>,
    scene: &InstancedScene,
    cameras: &[Camera],
    mut on_view: impl FnMut() -> Result<(), E>,
) -> Result<Sensitivity, E> {
    let mut measurement = Measurement::new(gpu, scene, cameras)?;
    for (step, camera) in (0..).zip(cameras) {
        measurement.add(step, camera)?;
        on_view()?;
    }
    Ok(measurement.result()?)
}

/// Probes of a scene, view by view.
struct Measurement<'a> {
    gpu: &'a Arc<Gpu>,
    scene: &'a InstancedScene,
    copies: Unshared<'a>,
    runner: StepRunner,
    state: DeviceState,
    rates: Rates,
    shapes: ShapeSums,
    /// Number of views that are to be added.
    views: usize,
    /// Mean number of values of a picture.
    values: f64,
}

impl<'a> Measurement<'a> {
    fn new(gpu: &'a Arc<Gpu>, scene: &'a InstancedScene, cameras: &[Camera]) -> Result<Self, TrainError> {
        let sizes = cameras.iter().map(|c| [c.width, c.height]);
        let largest = sizes.reduce(|a, b| [a[0].max(b[0]), a[1].max(b[1])]).ok_or(TrainError::NoViews)?;
        let runner = StepRunner::new(gpu, Variant::for_training(gpu.caps()), largest, false)?;
        let copies = Unshared::of(scene);
        let state = DeviceState::new(gpu, &copies.unshared, runner.chunk_size())?;
        let gaussian = GaussianRates {
            means: NO_RATE,
            sh_dc: NO_RATE,
            sh_rest: NO_RATE,
            opacity: NO_RATE,
            log_scales: NO_RATE,
            quats: NO_RATE,
        };
        let rates = Rates {
            template: gaussian,
            background: gaussian,
            offsets: gaussian,
            color_matrices: 0.0,
            poses: PoseRates::default(),
        };
        let shapes = ShapeSums::new(&copies.unshared);
        Ok(Self { gpu, scene, copies, runner, state, rates, shapes, views: cameras.len(), values: 0.0 })
    }

    fn add(&mut self, step: u64, camera: &Camera) -> Result<(), TrainError> {
        // One view at a time on the device; its buffers are only read by this step, which is waited for.
        let noise = noise_view(camera, &mut Rng::new(SEED).fork(step));
        self.values += 3.0 * noise.image.rgba.len() as f64 / self.views as f64;
        let mut views = TrainViews::from_images(self.gpu, &[noise])?;
        let plan = StepPlan {
            step,
            view: 0,
            options: RenderOptions::of(self.scene),
            rates: self.rates,
            sh_degree: self.scene.sh_degree(),
            lambda_dssim: 0.0,
            adam: Adam { beta1: 0.0, beta2: DECAY, epsilon: 1.0, step: step + 1 },
            learn_every: LearnEvery::STEP,
            exposure: None,
            mcmc: None,
        };
        self.runner.submit(&mut self.state, &mut views, plan)?;
        while self.runner.collect(&mut self.state, &mut views)?.is_some() {}
        self.shapes.add(&shape_gradients(self.gpu, &self.state)?);
        Ok(())
    }

    fn result(self) -> Result<Sensitivity, TrainError> {
        let Self { gpu, scene, copies, state, shapes, views, values, .. } = self;
        // The loss is a mean over the values of a picture, so its gradient is that of the colours' sum divided by them; the
        // squared error is to be a mean, too.
        let scale = values / (1.0 - DECAY.powf(views as f64));
        let mut rows = measured_rows(gpu, &state, scale)?;
        let (source_shapes, offset_shapes) = shapes.scaled(values / views as f64);
        let add = |sum: &mut f32, copy: &f32| *sum += copy;
        let rows = ParameterSet::from_fn(|parameter| {
            let values = std::mem::take(&mut rows[parameter]);
            match parameter.owner() {
                Owner::Source => copies.of_sources(values, add),
                Owner::ShBand(l) if l <= scene.templates.sh_degree => copies.of_sources(values, add),
                Owner::ShBand(_) | Owner::Instance => values,
                Owner::Offset => copies.of_records(values, add, |value, by| value * by),
            }
        });
        let add = |sum: &mut [f32; 6], copy: &[f32; 6]| sum.iter_mut().zip(copy).for_each(|(sum, copy)| *sum += copy);
        let source_shapes = copies.of_sources(source_shapes, add);
        let mut offset_shapes = copies.of_records(offset_shapes, add, |sums, by| sums.map(|sum| sum * by));
        if sources_of_records(&scene.offset_runs(), scene.offsets.len()).1 {
            // Records of several Gaussians have no shape of their own; see `ShapeSums`.
            offset_shapes.fill([0.0; 6]);
        }
        Ok(Sensitivity { rows, source_shapes, offset_shapes })
    }
}

fn noise_view(camera: &Camera, rng: &mut Rng) -> LoadedView {
    let (width, height) = (camera.width, camera.height);
    let mut bits = (0, 0);
    let mut byte = || {
        if bits.1 == 0 {
            bits = (rng.next_u64(), 64);
        }
        let bit = bits.0 & 1;
        bits = (bits.0 >> 1, bits.1 - 1);
        if bit == 1 { u8::MAX } else { 0 }
    };
    let rgba = (0..width as usize * height as usize).map(|_| [byte(), byte(), byte(), OPAQUE]).collect();
    LoadedView { image: ViewImage { width, height, rgba }, camera: camera.clone() }
}

/// The mean of the second moments of each row, times `scale`.
fn measured_rows(gpu: &Arc<Gpu>, state: &DeviceState, scale: f64) -> Result<ParameterSet<Vec<f32>>, GpuError> {
    ParameterSet::try_from_fn(|parameter| {
        let (rows, width) = (state.scene.counts.rows[parameter].iter().sum::<usize>(), parameter.width());
        let moments = download(gpu, &state.moments.parameters[parameter], rows * width)?;
        let mean = |row: &[[f32; 2]]| row.iter().map(|moment| f64::from(moment[1])).sum::<f64>() / width as f64;
        Ok(moments.chunks_exact(width).map(|row| (scale * mean(row)) as f32).collect())
    })
}

/// The last step's gradients by rotations and sizes.
fn shape_gradients(gpu: &Arc<Gpu>, state: &DeviceState) -> Result<ShapeGradients, GpuError> {
    let arrays = state.gradients.parameters.scalars();
    let of = |parameter: Parameter| {
        let rows = state.scene.counts.rows[parameter].iter().sum::<usize>();
        download(gpu, arrays[parameter], rows * parameter.width())
    };
    Ok(ShapeGradients {
        quats: of(Parameter::Quats)?,
        log_scales: of(Parameter::LogScales)?,
        offset_quats: of(Parameter::OffsetQuats)?,
        offset_log_scales: of(Parameter::OffsetLogScales)?,
    })
}

/// Of the instances that share offset records, at most this many are measured with them; the others are drawn without, and count as
/// much as these in the mean. It bounds memory, where a thousand copies share one run.
const MOST_USERS: usize = 8;

/// A scene whose instances may share own Gaussians and offset records, and as training has it: each with copies of its own.
struct Unshared<'a> {
    scene: &'a InstancedScene,
    unshared: Cow<'a, InstancedScene>,
}

impl<'a> Unshared<'a> {
    fn of(scene: &'a InstancedScene) -> Self {
        let unshared = match scene.with_packed_own() {
            Cow::Borrowed(scene) => scene.with_unshared_offsets(MOST_USERS),
            Cow::Owned(packed) => Cow::Owned(packed.with_unshared_offsets(MOST_USERS).into_owned()),
        };
        Self { scene, unshared }
    }

    /// Values by source Gaussian of the scene from those of the copies: what the scene has once has the sum over its copies.
    fn of_sources<T: Copy + Default>(&self, values: Vec<T>, add: impl Fn(&mut T, &T)) -> Vec<T> {
        let Self { scene, unshared } = self;
        if unshared.own.len() == scene.own.len() && unshared.own_ranges == scene.own_ranges {
            return values;
        }
        let (first, copies) = (scene.templates.len(), unshared.own.len());
        let mut own = vec![T::default(); scene.own.len()];
        for (to, from) in scene.own_ranges.iter().zip(&unshared.own_ranges) {
            let copies = &values[first + from.first as usize..][..from.count as usize];
            own[to.first as usize..].iter_mut().zip(copies).for_each(|(sum, copy)| add(sum, copy));
        }
        [&values[..first], &own, &values[first + copies..]].concat()
    }

    /// The same by offset record; empty if the scene has none of this kind. Copies beyond [`MOST_USERS`] count like the mean of the
    /// others: `scale` multiplies a value by a factor.
    fn of_records<T: Copy + Default>(
        &self,
        values: Vec<T>,
        add: impl Fn(&mut T, &T),
        scale: impl Fn(&T, f32) -> T,
    ) -> Vec<T> {
        let Self { scene, unshared } = self;
        if matches!(unshared, Cow::Borrowed(_)) || values.is_empty() {
            return values;
        }
        // Records of SH have several rows each.
        let rows = values.len() / unshared.offsets.len().max(1);
        let mut records = vec![T::default(); rows * scene.offsets.len()];
        let mut users: BTreeMap<(u32, u32), usize> = BTreeMap::new();
        let runs = scene.instances.iter().filter_map(|instance| Some((instance.template, instance.first_offset?)));
        runs.for_each(|run| *users.entry(run).or_default() += 1);
        for (to, from) in scene.instances.iter().zip(&unshared.instances) {
            let (Some(first), Some(copy)) = (to.first_offset, from.first_offset) else { continue };
            let count = rows * scene.template_ranges[to.template as usize].count as usize;
            let copies = &values[rows * copy as usize..][..count];
            let all = users.get(&(to.template, first)).copied().unwrap_or(1);
            let each_for = all as f32 / all.min(MOST_USERS) as f32;
            records[rows * first as usize..]
                .iter_mut()
                .zip(copies)
                .for_each(|(sum, copy)| add(sum, &scale(copy, each_for)));
        }
        records
    }
}
