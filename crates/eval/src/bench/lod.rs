//! Cost and benefit of levels of detail: quality and time at one or several error limits, compared with full quality.
//!
//! Quality comes first: each camera's picture at each error limit is compared with full quality and, if there is one,
//! with the photo. Timed frames follow: full, first limit, second limit, then in reverse order, and so on through the
//! cameras, so that other load on the machine affects all of them.

use std::sync::Arc;
use std::time::Instant;

use serde::Serialize;

use super::measure::{BenchError, Drawn, warm_up};
use crate::{EvalError, PicturePair, SceneOfViews, pair_of, psnr};
use instgs_io::view_image::ViewImage;
use instgs_vk::gpu::Gpu;
use instgs_vk::math::statistics::Percentiles;
use instgs_vk::render::{DeviceScene, FrameStats, Picture, RenderOptions, Renderer};
use instgs_vk::scene::{Camera, InstancedScene};

/// A scene to be measured at several error limits.
pub struct LodSubject<'a> {
    /// Name in report and errors: the path of the file.
    pub name: String,
    /// The scene, as loaded.
    pub scene: &'a InstancedScene,
    /// How it is rendered; the error limit is replaced.
    pub options: RenderOptions,
}

/// A camera, and the photo for it if there is one of its size.
pub struct LodView {
    /// Camera that is rendered.
    pub camera: Camera,
    /// Photo of the same view.
    pub photo: Option<ViewImage>,
}

/// Measurement of one scene at all error limits.
#[derive(Clone, Debug, Serialize)]
pub struct LodReport {
    /// Path of the scene file.
    pub scene: String,
    /// Name of the Vulkan device.
    pub device: String,
    /// Name and version of the driver.
    pub driver: String,
    /// Width and height of the first camera, pixels.
    pub resolution: [u32; 2],
    /// Number of timed frames per error limit.
    pub frames: u32,
    /// Number of Gaussians after expanding all instances, at full quality.
    pub expanded: u64,
    /// Full quality (error 0), then the error limits in the order given.
    pub rows: Vec<LodRow>,
}

/// Measurement of one error limit.
#[derive(Clone, Debug, Serialize)]
pub struct LodRow {
    /// Error limit in pixels; 0 = full quality.
    pub lod_px: f32,
    /// PSNR against full quality, mean over the cameras, dB; `None` at full quality.
    pub psnr_to_full: Option<f64>,
    /// PSNR against the photos, mean over the cameras, dB; `None` without photos.
    pub psnr: Option<f64>,
    /// PSNR against the photos lost relative to full quality, dB; negative if it improves.
    pub psnr_loss: Option<f64>,
    /// Wall time of a frame, milliseconds.
    pub ms: Percentiles,
    /// Frames per second: 1000 / median of `ms`.
    pub fps: f64,
    /// Frames per second relative to full quality.
    pub fps_ratio: f64,
    /// Number of expanded chunks, mean over the cameras.
    pub chunks: u64,
    /// Number of splats that touch at least one tile, mean over the cameras.
    pub visible: u64,
    /// Number of (splat, tile) pairs, mean over the cameras.
    pub intersections: u64,
    /// Size of the scene's buffers on the device, bytes.
    pub device_scene_bytes: u64,
    /// Figures of each camera.
    pub cameras: Vec<LodCamera>,
}

/// Measurement of one camera at one error limit.
#[derive(Clone, Debug, Serialize)]
pub struct LodCamera {
    /// Name of the camera in its file.
    pub name: String,
    /// PSNR against full quality, dB; `None` at full quality.
    pub psnr_to_full: Option<f64>,
    /// PSNR against the photo, dB; `None` without a photo.
    pub psnr: Option<f64>,
    /// Median wall time of a frame, milliseconds.
    pub ms: f64,
    /// Number of splats that touch at least one tile.
    pub visible: u64,
}

/// Errors of [`run_lod`].
#[derive(Debug, thiserror::Error)]
pub enum LodError {
    /// A frame cannot be rendered.
    #[error(transparent)]
    Bench(#[from] BenchError),
    /// Pictures cannot be compared.
    #[error(transparent)]
    Eval(#[from] EvalError),
}

/// Measures a scene at the error limits `errors_px`, each above 0, and at full quality, with at least one view.
/// `on_frame` is called after each round of timed frames.
///
/// # Errors
/// A camera, option or scene that cannot be rendered, or a picture that cannot be compared.
pub fn run_lod(
    gpu: &Arc<Gpu>,
    subject: &LodSubject<'_>,
    errors_px: &[f32],
    views: &[LodView],
    frames: u32,
    on_frame: &mut dyn FnMut(),
) -> Result<LodReport, LodError> {
    let cameras: Vec<Camera> = views.iter().map(|view| view.camera.clone()).collect();
    let mut bench = Bench { subject, scenes: Vec::new(), runs: Vec::new() };
    for &lod_error_px in [0.0].iter().chain(errors_px) {
        bench.add(gpu, lod_error_px, &cameras)?;
    }
    for view in views {
        bench.compare(view)?;
    }
    for (frame, (index, camera)) in (0..frames as usize).zip(cameras.iter().enumerate().cycle()) {
        let backwards = (frame + frame / cameras.len()) % 2 == 1;
        for turn in 0..bench.runs.len() {
            let run = if backwards { bench.runs.len() - 1 - turn } else { turn };
            bench.time(run, index, camera)?;
        }
        on_frame();
    }
    Ok(LodReport {
        scene: subject.name.clone(),
        device: gpu.caps().name.clone(),
        driver: gpu.caps().driver.clone(),
        resolution: cameras.first().map_or([0; 2], |c| [c.width, c.height]),
        frames,
        expanded: subject.scene.expanded_len(),
        rows: bench.rows(&cameras),
    })
}

/// State of one error limit, with its own renderer, so that buffer sizes settle. Measurements are by camera.
struct Run {
    renderer: Renderer,
    options: RenderOptions,
    psnr_to_full: Vec<f64>,
    psnr: Vec<Option<f64>>,
    times_ms: Vec<Vec<f64>>,
    stats: Vec<FrameStats>,
}

struct Bench<'a> {
    subject: &'a LodSubject<'a>,
    /// The scene at full quality, and with levels of detail, which all error limits share.
    scenes: Vec<DeviceScene>,
    /// Full quality first, then the error limits.
    runs: Vec<Run>,
}

impl Bench<'_> {
    fn failed(&self) -> impl Fn(instgs_vk::render::RenderError) -> BenchError + use<> {
        let scene = self.subject.name.clone();
        move |error| BenchError { scene: scene.clone(), error }
    }

    fn add(&mut self, gpu: &Arc<Gpu>, lod_error_px: f32, cameras: &[Camera]) -> Result<(), BenchError> {
        let fail = self.failed();
        let mut renderer = Renderer::new(gpu).map_err(&fail)?;
        let options = RenderOptions { lod_error_px, ..self.subject.options };
        if self.scenes.len() < 2 {
            self.scenes.push(renderer.upload_for(self.subject.scene, &options).map_err(&fail)?);
        }
        let scene: Box<dyn SceneOfViews<BenchError>> = Box::new(self.scene_of(self.runs.len()));
        warm_up(&mut renderer, &mut Drawn { name: self.subject.name.clone(), scene, options }, cameras, &mut |_| ())?;
        self.runs.push(Run {
            renderer,
            options,
            psnr_to_full: Vec::new(),
            psnr: Vec::new(),
            times_ms: vec![Vec::new(); cameras.len()],
            stats: vec![FrameStats::default(); cameras.len()],
        });
        Ok(())
    }

    fn scene_of(&self, run: usize) -> &DeviceScene {
        &self.scenes[run.min(1)]
    }

    /// Compares the pictures of one view at all error limits.
    fn compare(&mut self, view: &LodView) -> Result<(), LodError> {
        let fail = self.failed();
        let failed_pair = |error| EvalError::Pair { view: view.camera.name.clone(), error };
        let mut full: Option<Picture> = None;
        for (run, scene) in self.runs.iter_mut().zip([0, 1].into_iter().chain(std::iter::repeat(1))) {
            run.renderer.render(&self.scenes[scene], &view.camera, &run.options).map_err(&fail)?;
            let picture = run.renderer.download().map_err(&fail)?;
            let photo = view.photo.as_ref().map(|photo| pair_of(&picture, photo, run.options.background));
            run.psnr.push(photo.transpose().map_err(failed_pair)?.as_ref().map(psnr));
            if let Some(full) = &full {
                let size = (picture.width, picture.height);
                let pair = PicturePair::new(size, &rgb(&picture), &rgb(full), None).map_err(failed_pair)?;
                run.psnr_to_full.push(psnr(&pair));
            } else {
                full = Some(picture);
            }
        }
        Ok(())
    }

    fn time(&mut self, run: usize, index: usize, camera: &Camera) -> Result<(), BenchError> {
        let fail = self.failed();
        let (scene, run) = (&self.scenes[run.min(1)], &mut self.runs[run]);
        let start = Instant::now();
        let stats = run.renderer.render(scene, camera, &run.options);
        let elapsed_ms = 1e3 * start.elapsed().as_secs_f64();
        run.stats[index] = stats.map_err(fail)?;
        run.times_ms[index].push(elapsed_ms);
        Ok(())
    }

    fn rows(&self, cameras: &[Camera]) -> Vec<LodRow> {
        let median = |run: &Run| Percentiles::of(&run.times_ms.concat()).median;
        let psnr_of = |run: &Run| run.psnr.iter().copied().collect::<Option<Vec<f64>>>().map(|all| mean(&all));
        let full = &self.runs[0];
        let row = |(index, run): (usize, &Run)| {
            let ms = Percentiles::of(&run.times_ms.concat());
            // Cameras beyond the number of frames were not timed.
            let timed = run.times_ms.iter().filter(|times| !times.is_empty()).count().max(1) as u64;
            let count = |of: fn(&FrameStats) -> u64| (run.stats.iter().map(of).sum::<u64>() + timed / 2) / timed;
            LodRow {
                lod_px: run.options.lod_error_px,
                psnr_to_full: (index > 0).then(|| mean(&run.psnr_to_full)),
                psnr: psnr_of(run),
                psnr_loss: psnr_of(full).zip(psnr_of(run)).map(|(full, own)| full - own),
                ms,
                fps: 1e3 / ms.median,
                fps_ratio: median(full) / ms.median,
                chunks: count(|s| s.work_items),
                visible: count(|s| s.visible),
                intersections: count(|s| s.intersections),
                device_scene_bytes: self.scene_of(index).bytes(),
                cameras: cameras.iter().enumerate().map(|(k, camera)| camera_of(run, k, camera)).collect(),
            }
        };
        self.runs.iter().enumerate().map(row).collect()
    }
}

fn camera_of(run: &Run, k: usize, camera: &Camera) -> LodCamera {
    LodCamera {
        name: camera.name.clone(),
        psnr_to_full: run.psnr_to_full.get(k).copied(),
        psnr: run.psnr[k],
        ms: Percentiles::of(&run.times_ms[k]).median,
        visible: run.stats[k].visible,
    }
}

fn mean(values: &[f64]) -> f64 {
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn rgb(picture: &Picture) -> Vec<[f32; 3]> {
    picture.colors.iter().map(|&[r, g, b, _]| [r, g, b]).collect()
}
