//! Trains one level of a template.

use std::sync::Arc;

use instgs_io::LoadedView;
use instgs_io::view_image::{OPAQUE, ViewImage};
use instgs_train::TrainError;
use instgs_train::config::{GaussianRates, PoseRates, Rates};
use instgs_train::device_state::DeviceState;
use instgs_train::step_runner::{LearnEvery, StepPlan, StepRunner};
use instgs_train::view_order::ViewOrder;
use instgs_train::views::TrainViews;
use instgs_vk::gpu::Gpu;
use instgs_vk::optim::Adam;
use instgs_vk::render::{DeviceScene, Picture, RenderOptions, Renderer};
use instgs_vk::scene::{Gaussians, InstancedScene, PixelFilter};

use crate::views::FitView;

/// Learning rates at the first step; means in cells. All decay to `FINAL_FACTOR` of that, log-linearly.
const RATES: GaussianRates =
    GaussianRates { means: 0.02, sh_dc: 0.02, sh_rest: 0.004, opacity: 0.05, log_scales: 0.02, quats: 0.005 };
const FINAL_FACTOR: f64 = 0.03;

/// A template at full detail on the device, with what pictures of it are made with.
pub(crate) struct Target<'a> {
    /// Device of renderer and training.
    pub(crate) gpu: &'a Arc<Gpu>,
    /// Draws the template and its levels.
    pub(crate) renderer: &'a mut Renderer,
    /// The template, as a background.
    pub(crate) scene: DeviceScene,
    /// The pixel filter of the scene that the template is from.
    pub(crate) filter: PixelFilter,
}

impl Target<'_> {
    /// Options to render a view with.
    pub(crate) fn options(&self, view: &FitView) -> RenderOptions {
        RenderOptions { near: view.near, background: view.background, ..RenderOptions::default() }.filtered(self.filter)
    }

    /// Pictures of a scene.
    pub(crate) fn pictures_of(&mut self, cloud: &Gaussians, views: &[FitView]) -> Result<Vec<Picture>, TrainError> {
        let scene = self.renderer.upload(&InstancedScene::from_cloud(cloud.clone()))?;
        views.iter().map(|view| picture(self.renderer, &scene, view, &self.options(view))).collect()
    }

    /// Pictures of the template.
    pub(crate) fn pictures(&mut self, views: &[FitView]) -> Result<Vec<Picture>, TrainError> {
        views.iter().map(|view| picture(self.renderer, &self.scene, view, &self.options(view))).collect()
    }
}

fn picture(
    renderer: &mut Renderer,
    scene: &DeviceScene,
    view: &FitView,
    options: &RenderOptions,
) -> Result<Picture, TrainError> {
    renderer.render(scene, &view.camera, options)?;
    Ok(renderer.download()?)
}

/// How one level is trained.
pub(crate) struct Training<'a> {
    /// The Gaussians to begin with.
    pub(crate) level: &'a Gaussians,
    /// Side of the level's cells, template units.
    pub(crate) cell: f64,
    /// Views of the template that it is trained on.
    pub(crate) views: &'a [FitView],
    /// Number of steps, each on one view.
    pub(crate) steps: u64,
}

/// Trains a level against pictures of its template; returns its Gaussians in the same order.
pub(crate) fn fit(
    target: &mut Target<'_>,
    runner: &mut StepRunner,
    Training { level, cell, views, steps }: &Training<'_>,
) -> Result<Gaussians, TrainError> {
    let pictures = target.pictures(views)?;
    let loaded: Vec<LoadedView> =
        views.iter().zip(&pictures).map(|(view, picture)| training_view(view, picture)).collect();
    let mut device_views = TrainViews::from_images(target.gpu, &loaded)?;
    let mut state = DeviceState::new(target.gpu, &InstancedScene::from_cloud((*level).clone()), runner.chunk_size())?;
    let mut order = ViewOrder::new(0, views.len());
    for step in 0..*steps {
        let view = order.view_at(step).ok_or(TrainError::NoViews)?;
        let plan = StepPlan {
            step,
            view,
            options: target.options(&views[view]),
            rates: rates_at(*cell, step as f64 / *steps as f64),
            sh_degree: level.sh_degree,
            lambda_dssim: 0.0,
            adam: Adam { beta1: 0.9, beta2: 0.99, epsilon: 1e-15, step: step + 1 },
            learn_every: LearnEvery::STEP,
            exposure: None,
            mcmc: None,
        };
        runner.submit(&mut state, &mut device_views, plan)?;
    }
    while runner.is_busy() {
        runner.collect(&mut state, &mut device_views)?;
    }
    Ok(state.download(target.gpu)?.background)
}

fn rates_at(cell: f64, part: f64) -> Rates {
    let factor = FINAL_FACTOR.powf(part);
    let GaussianRates { means, sh_dc, sh_rest, opacity, log_scales, quats } = RATES;
    let background = GaussianRates {
        means: means * cell * factor,
        sh_dc: sh_dc * factor,
        sh_rest: sh_rest * factor,
        opacity: opacity * factor,
        log_scales: log_scales * factor,
        quats: quats * factor,
    };
    let none = GaussianRates::default();
    Rates { template: none, background, offsets: none, color_matrices: 0.0, poses: PoseRates::default() }
}

fn training_view(view: &FitView, picture: &Picture) -> LoadedView {
    let rgba = picture.rgb8().as_chunks().0.iter().map(|&[r, g, b]| [r, g, b, OPAQUE]).collect();
    let image = ViewImage { width: picture.width, height: picture.height, rgba };
    LoadedView { image, camera: view.camera.clone() }
}
