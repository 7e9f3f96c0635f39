//! Times the frames of one scene, or of two in turn.
//!
//! Each scene has its own renderer on the same device. Every camera is rendered until no buffer grows any more. The
//! timed frames follow, A B A B, cycling through the cameras, so that other load on the machine affects both. What a
//! scene reads and uploads for a view comes before that view's time begins. Finally some frames are rendered with
//! timestamps by a second renderer, so that timestamps cannot affect the medians; `profiled_ms` shows their cost.

use std::sync::Arc;
use std::time::Instant;

use super::report::{CameraReport, DrawnCounts, Ratio, Report, SceneReport};
use crate::{Bytes, Counts, SceneOfViews};
use instgs_vk::gpu::Gpu;
use instgs_vk::kernels::Variant;
use instgs_vk::math::statistics::{Percentiles, median};
use instgs_vk::render::{FrameStats, RenderError, RenderOptions, Renderer};
use instgs_vk::scene::{Camera, InstancedScene};

/// Most warm-up rounds over all cameras: the first grows the buffers, the second confirms their sizes, and further ones
/// serve buffers that depend on others.
const MOST_WARM_UP_ROUNDS: u32 = 4;
/// Least number of frames with timestamps: enough for a median, too few to double the time of a measurement.
const LEAST_PROFILED_FRAMES: usize = 5;

/// Milliseconds by pass, in the order of a frame.
type PassesMs = Vec<(&'static str, f64)>;

/// A scene to be measured. `E` is what can go wrong with bringing it to the device, or with making it ready for a view.
pub struct Subject<'a, E> {
    /// Name in report and errors: the path of the file.
    pub name: String,
    /// Its Gaussians, levels of detail aside.
    pub counts: Counts,
    /// Length of the scene file, bytes.
    pub file_bytes: u64,
    /// Bytes of its numbers in host memory, as f32; of a scene in pages, without the pages.
    pub host_bytes: u64,
    /// How the scene is rendered.
    pub options: RenderOptions,
    /// Brings the scene to the device.
    pub upload: Upload<'a, E>,
}

/// Brings a scene to the device, for a renderer and the options that it is drawn with.
pub type Upload<'a, E> = Box<dyn FnOnce(&Renderer, &RenderOptions) -> Result<Box<dyn SceneOfViews<E> + 'a>, E> + 'a>;

impl<'a, E: From<BenchError>> Subject<'a, E> {
    /// A scene that is on the device as a whole, from a file of that many bytes.
    pub fn whole(name: String, scene: &'a InstancedScene, file_bytes: u64, options: RenderOptions) -> Self {
        let place = name.clone();
        let upload: Upload<'a, E> = Box::new(move |renderer, options| {
            let uploaded = renderer.upload_for(scene, options);
            Ok(Box::new(uploaded.map_err(|error| BenchError { scene: place, error })?))
        });
        Self { name, counts: Counts::of(scene), file_bytes, host_bytes: scene.tensor_bytes(), options, upload }
    }
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
/// A camera, option or scene that cannot be rendered, or what the scene itself returns.
pub fn run<'a, E: From<BenchError>>(
    gpu: &Arc<Gpu>,
    subject: Subject<'a, E>,
    against: Option<Subject<'a, E>>,
    cameras: &[Camera],
    frames: u32,
    on_event: &mut dyn FnMut(MeasurePhase),
) -> Result<Report, E> {
    let cameras = &cameras[..cameras.len().min(frames as usize)];
    let mut runs = Vec::new();
    for subject in std::iter::once(subject).chain(against) {
        runs.push(Run::prepare(gpu, subject, cameras, on_event)?);
    }
    for (frame, (index, camera)) in (0..frames).zip(cameras.iter().enumerate().cycle()) {
        // The first scene of a round finds the caches as the other left them: alternate.
        let order: &mut dyn Iterator<Item = &mut Run<'_, E>> =
            if (frame + frame / cameras.len() as u32).is_multiple_of(2) {
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
struct Run<'a, E> {
    drawn: Drawn<'a, E>,
    renderer: Renderer,
    counts: Counts,
    file_bytes: u64,
    host_bytes: u64,
    device_peak: u64,
    /// By camera: milliseconds of the timed frames.
    times_ms: Vec<Vec<f64>>,
    /// By camera: counts of the last timed frame.
    stats: Vec<FrameStats>,
}

impl<'a, E: From<BenchError>> Run<'a, E> {
    /// Uploads the scene and warms up. Nothing else may use the device meanwhile: its peak memory is measured.
    fn prepare(
        gpu: &Arc<Gpu>,
        subject: Subject<'a, E>,
        cameras: &[Camera],
        on_event: &mut dyn FnMut(MeasurePhase),
    ) -> Result<Self, E> {
        let Subject { name, counts, file_bytes, host_bytes, options, upload } = subject;
        gpu.reset_memory_peak();
        let (before, _) = gpu.memory_usage();
        let mut renderer = Renderer::new(gpu).map_err(|error| BenchError { scene: name.clone(), error })?;
        let mut drawn = Drawn { scene: upload(&renderer, &options)?, name, options };
        warm_up(&mut renderer, &mut drawn, cameras, on_event)?;
        let (_, peak) = gpu.memory_usage();
        let stats = vec![FrameStats::default(); cameras.len()];
        let times_ms = vec![Vec::new(); cameras.len()];
        Ok(Self { drawn, renderer, counts, file_bytes, host_bytes, device_peak: peak - before, times_ms, stats })
    }

    fn time_frame(&mut self, index: usize, camera: &Camera) -> Result<(), E> {
        let (stats, elapsed_ms) = self.drawn.frame(&mut self.renderer, camera)?;
        self.stats[index] = stats;
        self.times_ms[index].push(elapsed_ms);
        Ok(())
    }

    fn finish(
        self,
        gpu: &Arc<Gpu>,
        cameras: &[Camera],
        frames: u32,
        on_event: &mut dyn FnMut(MeasurePhase),
    ) -> Result<SceneReport, E> {
        let Self { mut drawn, renderer, counts, file_bytes, host_bytes, device_peak, times_ms, stats } = self;
        let variant = *renderer.variant();
        drop(renderer);
        let (passes_ms, profiled_ms) = profile(gpu, variant, &mut drawn, cameras, on_event)?;
        let scene = drawn.scene.on_device();
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
            scene: drawn.name.clone(),
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
                scene: counts,
                visible: mean(|s| s.visible),
                intersections: mean(|s| s.intersections),
            },
            bytes: Bytes {
                file: file_bytes,
                host: host_bytes,
                device_scene: scene.bytes(),
                scene_on_host: scene.host_bytes(),
                device_peak,
            },
            slabs: stats.iter().map(|s| s.slabs).max().unwrap_or(0),
            cameras: cameras.iter().zip(&times_ms).zip(&stats).map(camera_report).collect(),
        })
    }
}

/// A scene on the device, and how it is drawn.
pub(super) struct Drawn<'a, E> {
    /// Path of its file, which an error begins with.
    pub(super) name: String,
    pub(super) scene: Box<dyn SceneOfViews<E> + 'a>,
    pub(super) options: RenderOptions,
}

impl<E: From<BenchError>> Drawn<'_, E> {
    /// Renders a frame, and returns how many milliseconds that took once the scene was ready for it.
    pub(super) fn frame(&mut self, renderer: &mut Renderer, camera: &Camera) -> Result<(FrameStats, f64), E> {
        let fail = |error| BenchError { scene: self.name.clone(), error };
        let scene = self.scene.ready_for(camera, &self.options)?;
        if scene.has_changes() {
            // Pages have come: their copies may still run, and the next frame writes which levels are there.
            renderer.render(scene, camera, &self.options).map_err(fail)?;
        }
        let start = Instant::now();
        let stats = renderer.render(scene, camera, &self.options);
        let elapsed_ms = 1e3 * start.elapsed().as_secs_f64();
        Ok((stats.map_err(fail)?, elapsed_ms))
    }
}

/// Renders every camera until a round changes no buffer.
pub(super) fn warm_up<E: From<BenchError>>(
    renderer: &mut Renderer,
    drawn: &mut Drawn<'_, E>,
    cameras: &[Camera],
    on_event: &mut dyn FnMut(MeasurePhase),
) -> Result<(), E> {
    let mut slabs_before = Vec::new();
    for round in 0..MOST_WARM_UP_ROUNDS {
        let mut slabs = Vec::new();
        let mut redone = 0;
        for camera in cameras {
            let (stats, _) = drawn.frame(renderer, camera)?;
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
fn profile<E: From<BenchError>>(
    gpu: &Arc<Gpu>,
    variant: Variant,
    drawn: &mut Drawn<'_, E>,
    cameras: &[Camera],
    on_event: &mut dyn FnMut(MeasurePhase),
) -> Result<(PassesMs, f64), E> {
    if gpu.caps().timestamp_period_ns == 0.0 {
        return Ok((Vec::new(), 0.0));
    }
    let fail = |error| BenchError { scene: drawn.name.clone(), error };
    let mut renderer = Renderer::with_variant(gpu, variant, true).map_err(fail)?;
    warm_up(&mut renderer, drawn, cameras, on_event)?;
    let frames = cameras.len().max(LEAST_PROFILED_FRAMES);
    let mut profiled = Vec::with_capacity(frames);
    let mut times_ms = Vec::with_capacity(frames);
    for camera in cameras.iter().cycle().take(frames) {
        let (stats, elapsed_ms) = drawn.frame(&mut renderer, camera)?;
        profiled.push(stats);
        times_ms.push(elapsed_ms);
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
