//! Gradients of a whole scene from the device, in the form the twin gives them.

use std::sync::Arc;

use instgs_reference::gather_gradients::{CloudGradient, SceneGradient};
use instgs_vk::gpu::interface::types::{self, StepRecord};
use instgs_vk::gpu::staging::{download, upload, write};
use instgs_vk::gpu::{Gpu, Recorder};
use instgs_vk::kernels::Variant;
use instgs_vk::render::{
    DeviceScene, GradientBuffers, GradientStep, LossInputs, RenderError, SourceTables, StepLog, TrainFrame, TrainView,
    WantedGradients,
};
use instgs_vk::scene::{Camera, InstancedScene, Owner, Parameter, ParameterSet, SourceLayout};

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
    /// Screen statistics by source Gaussian.
    pub(crate) screen_statistics: Vec<[f32; 3]>,
    /// Screen statistics by offset record, in scenes with own Gaussians.
    pub(crate) record_statistics: Vec<[f32; 2]>,
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

    /// Splats of a tile that the device's loops have iterations for.
    pub(crate) fn longest_list(&self) -> u32 {
        self.frame.longest_list()
    }

    /// Gradients of the sum of `cotangents` (by rgb and alpha, per pixel) times the picture.
    pub(crate) fn run(
        &mut self,
        scene: &InstancedScene,
        camera: &Camera,
        options: &instgs_reference::RenderOptions,
        cotangents: &[[f64; 4]],
    ) -> DeviceGradient {
        self.try_run(scene, camera, options, cotangents).unwrap()
    }

    /// The same as [`GradientRunner::run`], or the error of a view that does not fit.
    pub(crate) fn try_run(
        &mut self,
        scene: &InstancedScene,
        camera: &Camera,
        options: &instgs_reference::RenderOptions,
        cotangents: &[[f64; 4]],
    ) -> Result<DeviceGradient, RenderError> {
        let gpu = self.gpu.clone();
        let chunk_size = self.frame.variant().workgroup_size;
        let device_scene = DeviceScene::unbounded(&gpu, scene, chunk_size).unwrap();
        let tables = SourceTables::new(&gpu, &SourceLayout::of(scene), chunk_size).unwrap();
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
            let loss = LossInputs { targets: &targets, lambda_dssim: 0.2, exposed: None };
            self.frame.record_loss(recorder, &device_scene, &view, loss, &mut log, 7).unwrap();
            let ticket = recorder.submit().unwrap();
            recorder.wait(ticket).unwrap();
            let record: StepRecord = download(&gpu, &log.records, 8).unwrap()[7];
            assert_eq!(record.step, 7);
            // The loss's own gradient is replaced by the one asked for.
            let (_, backward) = self.frame.buffers_mut().unwrap();
            write(&gpu, &mut backward.cotangents, &cotangents).unwrap();
            let step = GradientStep { tables: &tables, view: &view, log: &log, wanted: WantedGradients::ALL };
            self.frame.record_gradients(recorder, &device_scene, step, &mut gradients).unwrap();
            let ticket = recorder.submit().unwrap();
            recorder.wait(ticket).unwrap();
            if !self.frame.grow(&record)? {
                break;
            }
            redone += 1;
        }
        let (frame, _) = self.frame.buffers().unwrap();
        let colors = download(&gpu, &frame.colors, cotangents.len()).unwrap();
        let records = if scene.own_ranges.is_empty() { 0 } else { scene.offsets.len() };
        Ok(DeviceGradient {
            gradient: scene_gradient(&gpu, scene, &gradients),
            colors,
            redone,
            screen_statistics: download(&gpu, &gradients.screen_statistics, scene.source_len()).unwrap(),
            record_statistics: download(&gpu, &gradients.record_statistics, records).unwrap(),
        })
    }
}

fn scene_gradient(gpu: &Arc<Gpu>, scene: &InstancedScene, buffers: &GradientBuffers) -> SceneGradient {
    let rows = scene.parameter_rows();
    let values = |parameter: Parameter| -> Vec<f64> {
        let count = rows[parameter].iter().sum::<usize>() * parameter.width();
        let values = download(gpu, buffers.parameters.scalars()[parameter], count).unwrap();
        values.into_iter().map(f64::from).collect()
    };
    let mut out = SceneGradient {
        templates: CloudGradient::zeros(&scene.templates),
        background: CloudGradient::zeros(&scene.background),
        own: CloudGradient::zeros(&scene.own),
        per_instance: ParameterSet::from_fn(|parameter| match parameter.owner() {
            Owner::Source | Owner::ShBand(_) => Vec::new(),
            Owner::Offset | Owner::Instance => values(parameter),
        }),
        instances: Vec::new(),
        poses: pose_gradients(gpu, buffers, scene.instances.len()),
    };
    for parameter in Parameter::ALL {
        let all = values(parameter);
        let (posed, of_background) = all.split_at(rows[parameter][0] * parameter.width());
        let of_own = if rows[parameter][0] == 0 { 0 } else { scene.own.len() * parameter.width() };
        let (of_templates, of_own) = posed.split_at(posed.len() - of_own.min(posed.len()));
        set_cloud_gradient(&mut out.templates, parameter, of_templates);
        set_cloud_gradient(&mut out.own, parameter, of_own);
        set_cloud_gradient(&mut out.background, parameter, of_background);
    }
    out
}

/// Puts the gradient by one parameter of source Gaussians where the twin has it.
fn set_cloud_gradient(cloud: &mut CloudGradient, parameter: Parameter, values: &[f64]) {
    match parameter {
        Parameter::Means => cloud.means = values.as_chunks().0.to_vec(),
        Parameter::Quats => cloud.quats = values.as_chunks().0.to_vec(),
        Parameter::LogScales => cloud.log_scales = values.as_chunks().0.to_vec(),
        Parameter::OpacityLogits => cloud.opacity_logits = values.to_vec(),
        _ => {
            let Owner::ShBand(l) = parameter.owner() else { return };
            let (first, colors) = ((l * l) as usize, values.as_chunks().0);
            let rows = colors.chunks_exact(parameter.width() / 3);
            let of_gaussians = cloud.sh.chunks_exact_mut(((cloud.sh_degree + 1) * (cloud.sh_degree + 1)) as usize);
            of_gaussians.zip(rows).for_each(|(sh, row)| sh[first..][..row.len()].copy_from_slice(row));
        }
    }
}

fn pose_gradients(gpu: &Arc<Gpu>, buffers: &GradientBuffers, count: usize) -> Vec<[f64; 7]> {
    let values = |g: types::PoseGradient| {
        let ([x, y, z], [a, b, c]) = (g.translation, g.rotation);
        [x, y, z, a, b, c, g.log_scale].map(f64::from)
    };
    download(gpu, &buffers.poses, count).unwrap().into_iter().map(values).collect()
}
