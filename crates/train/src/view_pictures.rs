//! How training and test views are rendered, and how test views are judged.

use instgs_eval::{EvalReport, Evaluated, Extras, evaluate};
use instgs_io::{IoError, View};
use instgs_vk::math::rng::Rng;
use instgs_vk::render::{DeviceScene, RenderOptions, Renderer};

use super::config::{Background, TrainConfig};
use super::error::TrainError;

/// Sub-stream of the seed for random backgrounds ("back" in ASCII).
const BACKGROUND_STREAM: u64 = 0x6261_636b;

/// Renders a scene from test views as the configuration has it and compares the renderings with their photos; `on_picture` is
/// called for each view in order.
///
/// # Errors
/// A photo that cannot be read, a view that cannot be rendered, or no views; or what `on_picture` returns.
pub fn evaluate_test_views(
    renderer: &mut Renderer,
    scene: &DeviceScene,
    test: &[View],
    config: &TrainConfig,
    on_picture: &mut dyn FnMut(Evaluated<'_>) -> Result<(), IoError>,
) -> Result<EvalReport, TrainError> {
    let width = (config.width > 0).then_some(config.width);
    let extras = Extras { lpips: None, exposures: config.exposure.rate > 0.0 };
    evaluate::<TrainError>(renderer, scene, test, width, &eval_options(config), extras, |view| Ok(on_picture(view)?))
}

/// Rendering options for training views over a background colour.
pub(super) fn train_options(config: &TrainConfig, background: [f32; 3]) -> RenderOptions {
    RenderOptions { near: config.near as f32, background, ..RenderOptions::default() }.filtered(config.pixel_filter())
}

/// Rendering options for test views; a random background is black there.
pub fn eval_options(config: &TrainConfig) -> RenderOptions {
    train_options(config, if config.background == Background::White { [1.0; 3] } else { [0.0; 3] })
}

/// The background colour of a step.
pub(super) fn background_at(config: &TrainConfig, step: u64) -> [f32; 3] {
    match config.background {
        Background::Black => [0.0; 3],
        Background::White => [1.0; 3],
        Background::Random => {
            let mut rng = Rng::new(config.seed).fork(BACKGROUND_STREAM).fork(step);
            std::array::from_fn(|_| rng.uniform() as f32)
        }
    }
}
