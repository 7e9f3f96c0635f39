//! A dataset's views, rendered and compared with their photos.

use crate::error::{EvalError, PairError};
use crate::pair::PicturePair;
use crate::report::{EvalReport, Extras, Metrics};
use instgs_io::View;
use instgs_io::view_image::{ViewImage, load_view};
use instgs_vk::render::{DeviceScene, Picture, RenderOptions, Renderer};
use instgs_vk::scene::Camera;

/// A scene in device memory that is made ready for each view before it is drawn. `E` is what can go wrong with that.
pub trait SceneOfViews<E> {
    /// The scene, with all that the view wants and there is room for.
    ///
    /// # Errors
    /// Whatever keeps the scene from being made ready.
    fn ready_for(&mut self, camera: &Camera, options: &RenderOptions) -> Result<&DeviceScene, E>;

    /// The scene as the last view left it.
    fn on_device(&self) -> &DeviceScene;
}

/// All of this scene is there: no view has anything to wait for.
impl<E> SceneOfViews<E> for DeviceScene {
    fn ready_for(&mut self, _: &Camera, _: &RenderOptions) -> Result<&DeviceScene, E> {
        Ok(self)
    }

    fn on_device(&self) -> &DeviceScene {
        self
    }
}

/// The same for a scene that others draw, too.
impl<E> SceneOfViews<E> for &DeviceScene {
    fn ready_for(&mut self, _: &Camera, _: &RenderOptions) -> Result<&DeviceScene, E> {
        Ok(self)
    }

    fn on_device(&self) -> &DeviceScene {
        self
    }
}

/// One view, reported as soon as it is compared.
#[derive(Debug)]
pub struct Evaluated<'a> {
    /// Name of the view's camera.
    pub name: &'a str,
    /// The rendered picture and the photo.
    pub pair: &'a PicturePair,
    /// Metrics of the pair.
    pub metrics: Metrics,
    /// Number of splats that touch at least one tile.
    pub visible: u64,
}

/// Renders every view at the size of its photo (`width` pixels wide if given), compares the two, and calls `on_view`
/// for each view in order. Photos are read one at a time. `E` is the caller's error type, with which `on_view` can stop
/// the evaluation.
///
/// # Errors
/// The first photo that cannot be read, view that cannot be rendered, or pair that cannot be compared; no views; or
/// what `scene` or `on_view` returns.
pub fn evaluate<E: From<EvalError>>(
    renderer: &mut Renderer,
    mut scene: impl SceneOfViews<E>,
    views: &[View],
    width: Option<u32>,
    options: &RenderOptions,
    extras: Extras<'_>,
    mut on_view: impl FnMut(Evaluated) -> Result<(), E>,
) -> Result<EvalReport, E> {
    let mut figures = Vec::with_capacity(views.len());
    for view in views {
        let name = view.camera.name.as_str();
        let photo = load_view(view, width).map_err(EvalError::from)?;
        let failed = |error| EvalError::Render { view: name.into(), error };
        let scene = scene.ready_for(&photo.camera, options)?;
        let stats = renderer.render(scene, &photo.camera, options).map_err(failed)?;
        let picture = renderer.download().map_err(failed)?;
        let pair = pair_of(&picture, &photo.image, options.background)
            .map_err(|error| EvalError::Pair { view: name.into(), error })?;
        let metrics = Metrics::of(&pair, extras).map_err(EvalError::from)?;
        on_view(Evaluated { name, pair: &pair, metrics, visible: stats.visible })?;
        figures.push(metrics.named(name));
    }
    Ok(EvalReport::new(figures)?)
}

/// The pair of a rendered picture and a photo of the same size. Transparent parts of the photo show `background`;
/// ignored pixels are masked.
///
/// # Errors
/// The same as [`PicturePair::new`].
pub fn pair_of(picture: &Picture, photo: &ViewImage, background: [f32; 3]) -> Result<PicturePair, PairError> {
    let render: Vec<[f32; 3]> = picture.colors.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
    let valid: Vec<bool> = photo.rgba.iter().map(|p| p[3] != 0).collect();
    let target: Vec<[f32; 3]> = photo.rgba.iter().map(|&pixel| composited(pixel, background)).collect();
    PicturePair::new((photo.width, photo.height), &render, &target, Some(&valid))
}

/// The colour of a photo's pixel over a background; an ignored pixel shows the background.
pub fn composited([r, g, b, a]: [u8; 4], background: [f32; 3]) -> [f32; 3] {
    let coverage = f32::from(a.saturating_sub(1)) / 254.0;
    let rgb = [r, g, b];
    std::array::from_fn(|c| f32::from(rgb[c]) / 255.0 * coverage + background[c] * (1.0 - coverage))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn coverage_and_mask() -> Result<(), PairError> {
        assert_eq!(composited([255, 0, 51, 255], [0.5; 3]), [1.0, 0.0, 0.2]);
        assert_eq!(composited([255, 0, 51, 1], [0.5, 0.25, 1.0]), [0.5, 0.25, 1.0]);
        assert_eq!(composited([255, 0, 255, 128], [0.0, 1.0, 1.0]), [0.5, 0.5, 1.0]);
        let picture = Picture { width: 2, height: 1, colors: vec![[0.25; 4]; 2], depths: Vec::new() };
        let photo = ViewImage { width: 2, height: 1, rgba: vec![[255, 255, 255, 0], [0, 0, 0, 1]] };
        let pair = pair_of(&picture, &photo, [0.75; 3])?;
        assert_eq!(pair.valid_pixels(), 1);
        assert_eq!((pair.render()[1], pair.target()[1]), ([0.25; 3], [0.75; 3]));
        assert_eq!(pair.render()[0], pair.target()[0]);
        Ok(())
    }
}
