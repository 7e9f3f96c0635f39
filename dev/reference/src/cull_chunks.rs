//! Ground truth for pass `cull_chunks`, by brute force: the pairs (instance, chunk of 256 Gaussians) with a visible
//! splat. The device's work list must contain all of these; it may contain more.

use crate::preprocess_instance_expand::{ALPHA_MIN, CullLimits, ProjectedSplat, pixel_center, project, sources};
use crate::view::{RenderOptions, View};
use instgs_vk::scene::camera::Camera;
use instgs_vk::scene::instanced_scene::InstancedScene;

/// Number of Gaussians in a full chunk.
pub const CHUNK_SIZE: u32 = 256;

/// A chunk of one instance, in flat order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ChunkItem {
    /// Index of the instance; the number of instances for the background.
    pub instance: u32,
    /// Index of the chunk within its template or the background.
    pub chunk: u32,
}

/// The chunks with a splat whose alpha is at least 1/255 at some pixel centre, each once, ascending.
pub fn visible_chunks(scene: &InstancedScene, camera: &Camera, options: &RenderOptions) -> Vec<ChunkItem> {
    let view = View::device(camera, options);
    let mut out: Vec<ChunkItem> = Vec::new();
    for source in sources(scene) {
        let item = ChunkItem { instance: source.instance, chunk: source.local_index / CHUNK_SIZE };
        if out.last() == Some(&item) {
            continue;
        }
        if project(&view, &source, &CullLimits::exact(&view))
            .is_some_and(|splat| shows(&splat, view.width, view.height))
        {
            out.push(item);
        }
    }
    out
}

/// True if alpha is at least 1/255 at any pixel centre of the image.
pub fn shows(splat: &ProjectedSplat, width: u32, height: u32) -> bool {
    let [x0, x1, y0, y1] = splat.pixel_box(width, height, 0.0);
    (y0..y1).any(|y| (x0..x1).any(|x| splat.alpha_at(pixel_center(x, y)) >= ALPHA_MIN))
}
