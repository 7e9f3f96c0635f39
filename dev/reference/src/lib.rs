//! CPU twins of the kernels in f64, simple and slow. They take the same f32 inputs as the device (scene values are
//! f32; camera and options are rounded to f32 by `view::View::device`) and compute in f64.

pub mod adam;
pub mod compact;
pub mod cull_chunks;
pub mod densify;
pub mod emit_intersections;
pub mod exposure;
pub mod finite_diff;
pub mod gather_gradients;
pub mod image_loss;
pub mod layers;
pub mod lod;
pub mod mask_contribution;
pub mod mcmc;
pub mod plan_slab;
pub mod poses;
pub mod preprocess_instance_expand;
pub mod preprocess_instance_expand_backward;
pub mod present;
pub mod radix_sort;
pub mod random;
pub mod scan;
pub mod tile_blend;
pub mod tile_blend_backward;
pub mod tile_marks;
pub mod tile_ranges;
pub mod tile_surface;
pub mod view;

use rayon::prelude::*;

pub use view::{RenderOptions, View};

use instgs_vk::scene::camera::Camera;
use instgs_vk::scene::instanced_scene::InstancedScene;
use preprocess_instance_expand::{CullLimits, ProjectedSplat, SourceGaussian, project, sources};

/// A rendered image; all vectors have width * height entries, row by row from the top.
#[derive(Clone, Debug, PartialEq)]
pub struct ReferenceImage {
    /// Width of the image, px.
    pub width: u32,
    /// Height of the image, px.
    pub height: u32,
    /// Colour (r, g, b) over the background.
    pub color: Vec<[f64; 3]>,
    /// Alpha of the pixel, 1 - T.
    pub alpha: Vec<f64>,
    /// Expected view depth, scene units; 0 where nothing was blended.
    pub depth: Vec<f64>,
    /// False where f32 and f64 may legitimately decide differently: see `tile_blend`.
    pub robust: Vec<bool>,
    /// Number of splats blended.
    pub n_contrib: Vec<u32>,
}

/// Renders a valid scene; camera and options are rounded to f32 first.
pub fn render(scene: &InstancedScene, camera: &Camera, options: &RenderOptions) -> ReferenceImage {
    render_sources(&sources(scene), &View::device(camera, options))
}

/// Renders Gaussians given in f64; nothing is rounded. For finite differences and exact comparisons.
pub fn render_sources(sources: &[SourceGaussian], view: &View) -> ReferenceImage {
    let splats = splats_in_depth_order(sources, view, &tile_blend::relaxed_limits(view));
    let pixels = tile_blend::blend(view, &splats);
    ReferenceImage {
        width: view.width,
        height: view.height,
        color: pixels.iter().map(|p| p.color.to_array()).collect(),
        alpha: pixels.iter().map(|p| p.alpha).collect(),
        depth: pixels.iter().map(|p| p.depth).collect(),
        robust: pixels.iter().map(|p| p.robust).collect(),
        n_contrib: pixels.iter().map(|p| p.n_contrib).collect(),
    }
}

/// The splats that pass `limits`, nearest first; the flat index breaks ties in depth.
pub fn splats_in_depth_order(sources: &[SourceGaussian], view: &View, limits: &CullLimits) -> Vec<ProjectedSplat> {
    in_depth_order(sources.par_iter().filter_map(|source| project(view, source, limits)).collect())
}

/// Sorts splats nearest first; the flat index breaks ties in depth.
pub fn in_depth_order(mut splats: Vec<ProjectedSplat>) -> Vec<ProjectedSplat> {
    splats.sort_by(|a, b| a.depth.total_cmp(&b.depth).then(a.flat_index.cmp(&b.flat_index)));
    splats
}
