//! Ground truth for pass `cull_chunks`, by brute force: the pairs (instance, chunk of 256 Gaussians) with a visible
//! splat. The device's work list must contain all of these; it may contain more.

use crate::preprocess_instance_expand::{
    ALPHA_MIN, CullLimits, ProjectedSplat, SourceGaussian, pixel_center, project, sources,
};
use crate::view::{RenderOptions, View};
use instgs_vk::scene::SourceLayout;
use instgs_vk::scene::camera::Camera;
use instgs_vk::scene::instanced_scene::InstancedScene;

/// Number of Gaussians in a full chunk.
pub const CHUNK_SIZE: u32 = 256;

/// A chunk of one row of the device's instance table, in flat order.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct ChunkItem {
    /// Index of the row: of an instance's template, of its own Gaussians, or of the background.
    pub row: u32,
    /// Index of the chunk within what the row shows.
    pub chunk: u32,
}

/// The chunks with a splat whose alpha is at least 1/255 at some pixel centre, each once, ascending.
pub fn visible_chunks(scene: &InstancedScene, camera: &Camera, options: &RenderOptions) -> Vec<ChunkItem> {
    let view = View::device(camera, options);
    let first_rows = SourceLayout::of(scene).first_rows();
    let item_of = |source: &SourceGaussian| {
        let (k, local) = (source.instance as usize, source.local_index);
        let of_template = scene.instances.get(k).map(|i| scene.template_ranges[i.template as usize].count);
        match of_template.and_then(|count| local.checked_sub(count)) {
            Some(own) => ChunkItem { row: first_rows[k] + 1, chunk: own / CHUNK_SIZE },
            None => ChunkItem { row: first_rows[k], chunk: local / CHUNK_SIZE },
        }
    };
    let mut out: Vec<ChunkItem> = Vec::new();
    for source in sources(scene) {
        let item = item_of(&source);
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
