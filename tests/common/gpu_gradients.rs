//! Gradients of a whole scene from the device, in the form the twin gives them.

use std::sync::Arc;

use instgs_vk::gpu::interface::types::{self, StepRecord};
use instgs_vk::gpu::staging::{download, upload, write};
use instgs_vk::gpu::{Buffer, Gpu, Recorder};
use instgs_vk::kernels::Variant;
use instgs_vk::reference;
use instgs_vk::reference::gather_gradients::{CloudGradient, OffsetGradient, SceneGradient};
use instgs_vk::render::{DeviceScene, GradientBuffers, SourceTables, StepLog, TrainFrame, TrainView};
use instgs_vk::scene::{Camera, Gaussians, InstancedScene};

use super::gpu::device_options;

/// Runs forward and backward passes of single views.
pub(crate) struct GradientRunner {
    gpu: Arc<Gpu>,
    frame: TrainFrame,
    recorder: Recorder,
}

/// What a run gave.
pub(crate) struct DeviceGradient {
    /// Gradients; those by transforms are left empty.
    pub(crate) gradient: SceneGradient,
    /// rgb over the background, and alpha.
    pub(crate) colors: Vec<[f32; 4]>,
    /// How often the step was done again because buffers were too small.
    pub(crate) redone: u32,
}

impl GradientRunner {
    pub(crate) fn new(gpu: &Arc<Gpu>, variant: Variant) -> Self {
        let frame = TrainFrame::new(gpu, variant).unwrap();
        Self { gpu: gpu.clone(), frame, recorder: Recorder::new(gpu).unwrap() }
    }

    /// Starts with buffers for so many intersections.
    pub(crate) fn set_intersections(&mut self, intersections: u32) {
        self.frame.set_intersections(intersections);
    }

    /// Gradients of the sum of `cotangents` (by rgb and alpha, per pixel) times the picture.
    pub(crate) fn run(
        &mut self,
        scene: &InstancedScene,
        camera: &Camera,
        options: &reference::RenderOptions,
        cotangents: &[[f64; 4]],
    ) -> DeviceGradient {
        let gpu = self.gpu.clone();
        let chunk_size = self.frame.variant().workgroup_size;
        let device_scene = DeviceScene::unbounded(&gpu, scene, chunk_size).unwrap();
        let tables = SourceTables::new(&gpu, scene, chunk_size).unwrap();
        let mut gradients = GradientBuffers::new(&gpu, &device_scene).unwrap();
        let view = TrainView { camera, options: device_options(options) };
        let targets = upload(&gpu, "targets", &vec![0u32; (camera.width * camera.height) as usize]).unwrap();
        let cotangents: Vec<[f32; 4]> = cotangents.iter().map(|c| c.map(|v| v as f32)).collect();
        let mut redone = 0;
        loop {
            let mut log = StepLog::new(&gpu, 1).unwrap();
            self.frame.prepare(&device_scene, [camera.width, camera.height], scene.sh_degree(), true).unwrap();
            let recorder = &mut self.recorder;
            self.frame.record_forward(recorder, &device_scene, &view).unwrap();
            let loss = (&targets, 0.2);
            self.frame.record_loss(recorder, &device_scene, &view, loss, (&mut log, 7)).unwrap();
            let ticket = recorder.submit().unwrap();
            recorder.wait(ticket).unwrap();
            let record: StepRecord = download(&gpu, &log.records, 8).unwrap()[7];
            assert_eq!(record.step, 7);
            // The loss's own gradient is replaced by the one asked for.
            let (_, backward) = self.frame.buffers_mut().unwrap();
            write(&gpu, &mut backward.cotangents, &cotangents).unwrap();
            self.frame.record_gradients(recorder, (&device_scene, &tables), &view, &log, &mut gradients).unwrap();
            let ticket = recorder.submit().unwrap();
            recorder.wait(ticket).unwrap();
            if !self.frame.grow(&record).unwrap() {
                break;
            }
            redone += 1;
        }
        let (frame, _) = self.frame.buffers().unwrap();
        let colors = download(&gpu, &frame.colors, cotangents.len()).unwrap();
        DeviceGradient { gradient: scene_gradient(&gpu, scene, &gradients), colors, redone }
    }
}

fn wide<const N: usize>(gpu: &Arc<Gpu>, buffer: &Buffer<[f32; N]>, len: usize) -> Vec<[f64; N]> {
    download(gpu, buffer, len).unwrap().into_iter().map(|v| v.map(f64::from)).collect()
}

fn scene_gradient(gpu: &Arc<Gpu>, scene: &InstancedScene, buffers: &GradientBuffers) -> SceneGradient {
    let offsets = scene.offsets.len();
    SceneGradient {
        templates: cloud_gradient(gpu, buffers, &scene.templates, 0, [0; 4]),
        background: cloud_gradient(
            gpu,
            buffers,
            &scene.background,
            scene.templates.len(),
            [0, 1, 2, 3].map(|l| if scene.templates.sh_degree >= l { scene.templates.len() } else { 0 }),
        ),
        offsets: OffsetGradient {
            means: wide(gpu, &buffers.offset_means, offsets),
            sh_dc: wide(gpu, &buffers.offset_sh_dc, offsets),
            opacity_logits: narrow(gpu, &buffers.offset_opacity_logits, offsets),
            sh_rest: wide(gpu, &buffers.offset_sh_rest, scene.offsets.sh_rest.len()),
            log_scales: wide(gpu, &buffers.offset_log_scales, scene.offsets.log_scales.len()),
            quats: wide(gpu, &buffers.offset_quats, scene.offsets.quats.len()),
        },
        instances: Vec::new(),
        poses: pose_gradients(gpu, buffers, scene.instances.len()),
    }
}

fn pose_gradients(gpu: &Arc<Gpu>, buffers: &GradientBuffers, count: usize) -> Vec<[f64; 7]> {
    let values = |g: types::PoseGradient| {
        let ([x, y, z], [a, b, c]) = (g.translation, g.rotation);
        [x, y, z, a, b, c, g.log_scale].map(f64::from)
    };
    download(gpu, &buffers.poses, count).unwrap().into_iter().map(values).collect()
}

fn narrow(gpu: &Arc<Gpu>, buffer: &Buffer<f32>, len: usize) -> Vec<f64> {
    download(gpu, buffer, len).unwrap().into_iter().map(f64::from).collect()
}

fn cloud_gradient(
    gpu: &Arc<Gpu>,
    buffers: &GradientBuffers,
    cloud: &Gaussians,
    first: usize,
    first_in_band: [usize; 4],
) -> CloudGradient {
    let n = cloud.len();
    let end = first + n;
    let mut out = CloudGradient::zeros(cloud);
    if n == 0 {
        return out;
    }
    out.means = wide(gpu, &buffers.means, end)[first..].to_vec();
    out.quats = wide(gpu, &buffers.quats, end)[first..].to_vec();
    out.log_scales = wide(gpu, &buffers.log_scales, end)[first..].to_vec();
    out.opacity_logits = narrow(gpu, &buffers.opacity_logits, end)[first..].to_vec();
    for l in 0..=cloud.sh_degree as usize {
        let width = 2 * l + 1;
        let band = wide(gpu, &buffers.sh_bands[l], (first_in_band[l] + n) * width);
        for i in 0..n {
            for m in 0..width {
                out.sh[i * cloud.sh_coefficients() + l * l + m] = band[(first_in_band[l] + i) * width + m];
            }
        }
    }
    out
}
