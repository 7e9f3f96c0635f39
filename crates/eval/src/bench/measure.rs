//! Times the frames of one scene, or of two in turn.
//!
//! Each scene has its own renderer on the same device. Every camera is rendered until no buffer grows any more. The
//! timed frames follow, A B A B, cycling through the cameras, so that other load on the machine affects both. Finally
//! some frames are rendered with timestamps by a second renderer, so that timestamps cannot affect the medians;
//! `profiled_ms` shows their cost.

use std::sync::Arc;
use std::time::Instant;

use super::report::{CameraReport, DrawnCounts, Ratio, Report, SceneReport};
use crate::{Bytes, Counts};
use instgs_vk::gpu::Gpu;
use instgs_vk::kernels::Variant;
use instgs_vk::math::statistics::{Percentiles, median};
use instgs_vk::render::{DeviceScene, FrameStats, RenderError, RenderOptions, Renderer};
use instgs_vk::scene::{Camera, InstancedScene};

/// Most warm-up rounds over all cameras: the first grows the buffers, the second confirms their sizes, and further ones
/// serve buffers that depend on others.
const MOST_WARM_UP_ROUNDS: u32 = 4;
/// Least number of frames with timestamps: enough for a median, too few to double the time of a measurement.
const LEAST_PROFILED_FRAMES: usize = 5;

/// Milliseconds by pass, in the order of a frame.
type PassesMs = Vec<(&'static str, f64)>;

/// A scene to be measured.
pub struct Subject<'a> {
    /// Name in report and errors: the path of the file.
    pub name: String,
    /// The scene, as loaded.
    pub scene: &'a InstancedScene,
    /// Length of the scene file, bytes.
    pub file_bytes: u64,
    /// How the scene is rendered.
    pub options: RenderOptions,
}

/// Progress events of [`run`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MeasurePhase {
    /// A warm-up frame is done.
    WarmUp,
    /// A frame of each scene has been timed.
    Timed,
    /// A frame with timestamps is done.
    Profiled,
}

/// A frame could not be rendered.
#[derive(Debug, thiserror::Error)]
#[error("{scene}: {error}")]
pub struct BenchError {
    /// Name of the scene in the report.
    pub scene: String,
    /// What the renderer reports.
    pub error: RenderError,
}

/// Measures `subject`, in turn with `against` if given. Only the first `frames` cameras are used.
///
/// # Errors
/// A camera, option or scene that cannot be rendered.
pub fn run(
    gpu: &Arc<Gpu>,
    subject: &Subject<'_>,
    against: Option<&Subject<'_>>,
    cameras: &[Camera],
    frames: u32,
    on_event: &mut dyn FnMut(MeasurePhase),
) -> Result<Report, BenchError> {
    let cameras = &cameras[..cameras.len().min(frames as usize)];
    let mut runs = Vec::new();
    for subject in std::iter::once(subject).chain(against) {
        runs.push(Run::prepare(gpu, subject, cameras, on_event)?);
    }
    for (frame, (index, camera)) in (0..frames).zip(cameras.iter().enumerate().cycle()) {
        // The first scene of a round finds the caches as the other left them: alternate.
        let order: &mut dyn Iterator<Item = &mut Run<'_>> = if (frame + frame / cameras.len() as u32).is_multiple_of(2)
        {
            &mut runs.iter_mut()
        } else {
            &mut runs.iter_mut().rev()
        };
        for run in order {
            run.time_frame(index, camera)?;
        }
        on_event(MeasurePhase::Timed);
    }
    let mut reports = Vec::new();
    for run in runs {
        reports.push(run.finish(gpu, cameras, frames, on_event)?);
    }
    let against = (reports.len() > 1).then(|| reports.pop()).flatten();
    let Some(scene) = reports.pop() else { unreachable!("there is a report for every subject") };
    let ratio = against.as_ref().map(|against| Ratio::of(&scene, against));
    Ok(Report { scene, against, ratio, process_peak_bytes: process_peak_bytes() })
}

/// One scene on the device, with its measurements.
struct Run<'a> {
    subject: &'a Subject<'a>,
    renderer: Renderer,
    scene: DeviceScene,
    device_peak: u64,
    /// By camera: milliseconds of the timed frames.
    times_ms: Vec<Vec<f64>>,
    /// By camera: counts of the last timed frame.
    stats: Vec<FrameStats>,
}

impl<'a> Run<'a> {
    /// Uploads the scene and warms up. Nothing else may use the device meanwhile: its peak memory is measured.
    fn prepare(
        gpu: &Arc<Gpu>,
        subject: &'a Subject<'a>,
        cameras: &[Camera],
        on_event: &mut dyn FnMut(MeasurePhase),
    ) -> Result<Self, BenchError> {
        let fail = |error| BenchError { scene: subject.name.clone(), error };
        gpu.reset_memory_peak();
        let (before, _) = gpu.memory_usage();
        let mut renderer = Renderer::new(gpu).map_err(fail)?;
        let scene = renderer.upload_for(subject.scene, &subject.options).map_err(fail)?;
        warm_up(&mut renderer, &scene, subject, cameras, on_event)?;
        let (_, peak) = gpu.memory_usage();
        let stats = vec![FrameStats::default(); cameras.len()];
        let times_ms = vec![Vec::new(); cameras.len()];
        Ok(Self { subject, renderer, scene, device_peak: peak - before, times_ms, stats })
    }

    fn time_frame(&mut self, index: usize, camera: &Camera) -> Result<(), BenchError> {
        let start = Instant::now();
        let stats = self.renderer.render(&self.scene, camera, &self.subject.options);
        let elapsed_ms = 1e3 * start.elapsed().as_secs_f64();
        self.stats[index] = stats.map_err(|error| BenchError { scene: self.subject.name.clone(), error })?;
        self.times_ms[index].push(elapsed_ms);
        Ok(())
    }

    fn finish(
        self,
        gpu: &Arc<Gpu>,
        cameras: &[Camera],
        frames: u32,
        on_event: &mut dyn FnMut(MeasurePhase),
    ) -> Result<SceneReport, BenchError> {
        let Self { subject, renderer, scene, device_peak, times_ms, stats } = self;
        let variant = *renderer.variant();
        drop(renderer);
        let (passes_ms, profiled_ms) = profile(gpu, variant, &scene, subject, cameras, on_event)?;
        let ms = Percentiles::of(&times_ms.concat());
        let mean = |field: fn(&FrameStats) -> u64| {
            (stats.iter().map(field).sum::<u64>() + stats.len() as u64 / 2) / stats.len() as u64
        };
        let camera_report = |((camera, times), stats): ((&Camera, &Vec<f64>), &FrameStats)| CameraReport {
            name: camera.name.clone(),
            resolution: [camera.width, camera.height],
            frames: times.len() as u32,
            ms: Percentiles::of(times),
            visible: stats.visible,
            intersections: stats.intersections,
            slabs: stats.slabs,
        };
        Ok(SceneReport {
            scene: subject.name.clone(),
            device: gpu.caps().name.clone(),
            driver: gpu.caps().driver.clone(),
            variant,
            device_precision: scene.precision,
            resolution: [cameras[0].width, cameras[0].height],
            frames,
            ms,
            fps: 1e3 / ms.median,
            passes_ms,
            profiled_ms,
            gaussians: DrawnCounts {
                scene: Counts::of(subject.scene),
                visible: mean(|s| s.visible),
                intersections: mean(|s| s.intersections),
            },
            bytes: Bytes {
                file: subject.file_bytes,
                host: subject.scene.tensor_bytes(),
                device_scene: scene.bytes(),
                scene_on_host: scene.host_bytes(),
                device_peak,
            },
            slabs: stats.iter().map(|s| s.slabs).max().unwrap_or(0),
            cameras: cameras.iter().zip(&times_ms).zip(&stats).map(camera_report).collect(),
        })
    }
}

/// Renders every camera until a round changes no buffer.
pub(super) fn warm_up(
    renderer: &mut Renderer,
    scene: &DeviceScene,
    subject: &Subject<'_>,
    cameras: &[Camera],
    on_event: &mut dyn FnMut(MeasurePhase),
) -> Result<(), BenchError> {
    let mut slabs_before = Vec::new();
    for round in 0..MOST_WARM_UP_ROUNDS {
        let mut slabs = Vec::new();
        let mut redone = 0;
        for camera in cameras {
            let stats = renderer
                .render(scene, camera, &subject.options)
                .map_err(|error| BenchError { scene: subject.name.clone(), error })?;
            slabs.push(stats.slabs);
            redone += stats.redone;
            on_event(MeasurePhase::WarmUp);
        }
        // A frame of several slabs enlarges the buffer for the next one, unless the limit is reached.
        let settled = redone == 0 && (slabs.iter().all(|&s| s == 1) || slabs == slabs_before);
        if settled && (round > 0 || cameras.len() > 1) {
            break;
        }
        slabs_before = slabs;
    }
    Ok(())
}

/// Milliseconds by pass, summed over a frame's dispatches and medians over frames, and the median wall time of these
/// frames.
fn profile(
    gpu: &Arc<Gpu>,
    variant: Variant,
    scene: &DeviceScene,
    subject: &Subject<'_>,
    cameras: &[Camera],
    on_event: &mut dyn FnMut(MeasurePhase),
) -> Result<(PassesMs, f64), BenchError> {
    if gpu.caps().timestamp_period_ns == 0.0 {
        return Ok((Vec::new(), 0.0));
    }
    let fail = |error| BenchError { scene: subject.name.clone(), error };
    let mut renderer = Renderer::with_variant(gpu, variant, true).map_err(fail)?;
    warm_up(&mut renderer, scene, subject, cameras, on_event)?;
    let frames = cameras.len().max(LEAST_PROFILED_FRAMES);
    let mut profiled = Vec::with_capacity(frames);
    let mut times_ms = Vec::with_capacity(frames);
    for camera in cameras.iter().cycle().take(frames) {
        let start = Instant::now();
        profiled.push(renderer.render(scene, camera, &subject.options).map_err(fail)?);
        times_ms.push(1e3 * start.elapsed().as_secs_f64());
        on_event(MeasurePhase::Profiled);
    }
    Ok((FrameStats::median_ms_by_pass(&profiled), median(&times_ms)))
}

/// Peak resident set size of the process, bytes; Linux only.
fn process_peak_bytes() -> Option<u64> {
    let status = std::fs::read_to_string("/proc/self/status").ok()?;
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"))?;
    line.trim().strip_suffix("kB")?.trim().parse::<u64>().ok().map(|kib| kib * 1024)
}
