//! Draws masks from a labelled cloud.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::segment::error::SegmentError;
use instgs_io::View;
use instgs_io::masks::Mask;
use instgs_io::view_image::camera_at_width;
use instgs_vk::gpu::Gpu;
use instgs_vk::render::{RenderOptions, Renderer, Surfaces};
use instgs_vk::scene::{Camera, InstancedScene};

/// Draws the masks of all views of a plain cloud in order and passes each to `sink` with the view's index. A pixel has
/// the label of the Gaussian at its surface, or 0 where more than half of the light passes through. Masks have the size
/// and lens distortion of the photo; they are rendered at `width`, or, if `None`, at the photo's width reduced to what
/// fits on the device. Returns the number of masks that contain each label above 0.
///
/// # Errors
/// A cloud that does not fit on the device; a camera that cannot be rendered; errors of `sink`.
pub fn draw_masks<E: From<SegmentError>>(
    gpu: &Arc<Gpu>,
    cloud: &InstancedScene,
    labels: &[u16],
    views: &[View],
    width: Option<u32>,
    render: &RenderOptions,
    mut sink: impl FnMut(usize, &Mask) -> Result<(), E>,
) -> Result<BTreeMap<u16, usize>, E> {
    let mut renderer = Renderer::new(gpu).map_err(SegmentError::Cloud)?;
    let scene = renderer.upload(cloud).map_err(SegmentError::Cloud)?;
    let mut surfaces = Surfaces::new(gpu).map_err(SegmentError::Cloud)?;
    let mut views_of_label = BTreeMap::new();
    for (i, view) in views.iter().enumerate() {
        let camera = camera_at_width(&view.camera, width.or_else(|| width_that_fits(gpu, &view.camera)));
        let failed = |error| SegmentError::View { view: camera.name.clone(), error };
        renderer.render_with_surfaces(&scene, &camera, render, &mut surfaces).map_err(failed)?;
        let points = surfaces.download().map_err(failed)?;
        let label = |point: &instgs_vk::render::SurfacePoint| labels.get(point.local as usize).copied().unwrap_or(0);
        let ids = points.iter().map(|point| point.as_ref().map_or(0, label)).collect();
        let mask = Mask { width: camera.width, height: camera.height, ids };
        let mask = mask.resized(view.camera.width, view.camera.height).as_photographed(view);
        mask.ids_present().keys().for_each(|&id| *views_of_label.entry(id).or_default() += 1);
        sink(i, &mask)?;
    }
    Ok(views_of_label)
}

/// The width at which the camera's largest buffer, four floats of colour per pixel, fits into one binding of the
/// device; `None` if it already fits.
fn width_that_fits(gpu: &Gpu, camera: &Camera) -> Option<u32> {
    let bytes = 16 * u64::from(camera.width) * u64::from(camera.height);
    let part = gpu.caps().max_storage_bytes as f64 / bytes as f64;
    // A margin for rounding the height.
    (part < 1.0).then(|| (0.99 * f64::from(camera.width) * part.sqrt()) as u32)
}
