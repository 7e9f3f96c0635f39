//! Contributions of the Gaussians of a plain cloud to the masks of a view: `mask_contribution` on the lists of each
//! depth slab, its entries summed on the host.

use std::sync::Arc;

use rayon::prelude::*;

use crate::gpu::interface::types;
use crate::gpu::staging::{download, upload};
use crate::gpu::{Buffer, Gpu, GpuError, Grid, Recorder};
use crate::kernels::{SegmentPipelines, mask_contribution};
use crate::scene::{Camera, InstancedScene};

use super::device_scene::DeviceScene;
use super::error::RenderError;
use super::frame_stats::FrameStats;
use super::render_options::RenderOptions;
use super::renderer::{BlendedSlab, Renderer};

pub use crate::gpu::interface::constants::CONTRIBUTION_ONE;

/// Capacity of the entry buffer: 8 bytes each, 32 MiB. A view with more entries takes several batches.
const BATCH_ENTRIES: u32 = 1 << 22;

/// Contribution of one Gaussian to the pixels with one mask id.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Contribution {
    /// Index of the Gaussian in the cloud.
    pub gaussian: u32,
    /// Mask id, 0 = no mask.
    pub id: u16,
    /// Sum over these pixels of alpha T, in [`CONTRIBUTION_ONE`]ths of a pixel; above 0.
    pub weight: u64,
}

impl Contribution {
    /// The weight in pixels.
    pub fn weight_px(&self) -> f64 {
        self.weight as f64 / f64::from(CONTRIBUTION_ONE)
    }
}

/// Runs `mask_contribution` over views of one plain cloud.
pub struct ContributionRenderer {
    gpu: Arc<Gpu>,
    renderer: Renderer,
    scene: DeviceScene,
    pipelines: Option<SegmentPipelines>,
    recorder: Recorder,
    batch_entries: u32,
}

impl ContributionRenderer {
    /// Uploads a plain cloud (background only).
    ///
    /// # Errors
    /// A scene with instances, or beyond the device's limits.
    pub fn new(gpu: &Arc<Gpu>, cloud: &InstancedScene) -> Result<Self, RenderError> {
        // An entry is written for each splat of a tile and each block of it, and all are read back.
        Self::with_renderer(gpu, Renderer::new(gpu)?.with_tiles_of_one_block(), cloud)
    }

    /// The same as [`ContributionRenderer::new`], with the renderer's variant and capacities.
    ///
    /// # Errors
    /// The same errors as [`ContributionRenderer::new`].
    pub fn with_renderer(gpu: &Arc<Gpu>, renderer: Renderer, cloud: &InstancedScene) -> Result<Self, RenderError> {
        if !cloud.instances.is_empty() {
            let reason = format!("has {} instances; contributions are of plain clouds", cloud.instances.len());
            return Err(RenderError::Option { option: "the scene", reason });
        }
        let scene = renderer.upload(cloud)?;
        let recorder = Recorder::new(gpu)?;
        Ok(Self { gpu: gpu.clone(), renderer, scene, pipelines: None, recorder, batch_entries: BATCH_ENTRIES })
    }

    /// Sets the number of entries per batch; the result does not depend on it.
    pub fn set_batch_entries(&mut self, batch_entries: u32) {
        self.batch_entries = batch_entries;
    }

    /// The contributions of a view whose pixels have the mask ids `ids` (row by row, 0 = no mask), ordered by Gaussian,
    /// then by id. Gaussians without a contribution are absent. The result does not depend on the sizes of buffers.
    ///
    /// # Errors
    /// The same errors as [`Renderer::render`], or `ids` does not have one entry per pixel of the camera.
    pub fn contributions(
        &mut self,
        camera: &Camera,
        options: &RenderOptions,
        ids: &[u16],
    ) -> Result<(Vec<Contribution>, FrameStats), RenderError> {
        camera.validate().map_err(RenderError::Camera)?;
        let pixels = u64::from(camera.width) * u64::from(camera.height);
        if ids.len() as u64 != pixels {
            let reason = format!("{} pixels, the camera has {}x{}", ids.len(), camera.width, camera.height);
            return Err(RenderError::Option { option: "the mask", reason });
        }
        let Self { gpu, renderer, scene, pipelines, recorder, batch_entries } = self;
        let mut view = ViewBuffers::new(gpu, ids)?;
        let mut sums = Sums::default();
        let result = renderer.list_slabs(scene, camera, options, &mut |slab| {
            if pipelines.as_ref().is_none_or(|p| p.variant != slab.variant) {
                *pipelines = Some(SegmentPipelines::new(slab.gpu, slab.cache, slab.variant)?);
            }
            let Some(pipelines) = pipelines else { return Ok(()) };
            for batch in &batches_of_slab(&slab, ids, *batch_entries)? {
                sums.add(batch, &run_batch(recorder, pipelines, &slab, &view, batch)?);
            }
            if slab.last { Ok(()) } else { view.keep_depths(recorder, &slab) }
        });
        if result.is_err() {
            recorder.abandon();
        }
        Ok((sums.finish(), result?))
    }
}

/// Buffers of a view that stay the same, or are carried over, from depth slab to depth slab.
struct ViewBuffers {
    /// Mask id by pixel, row by row.
    pixel_ids: Buffer<u32>,
    /// `FrameBuffers::depths` after the previous slab.
    live_depths: Buffer<[f32; 2]>,
}

impl ViewBuffers {
    fn new(gpu: &Arc<Gpu>, ids: &[u16]) -> Result<Self, GpuError> {
        let wide: Vec<u32> = ids.iter().map(|&id| u32::from(id)).collect();
        let pixel_ids = upload(gpu, "pixel ids", &wide)?;
        Ok(Self { pixel_ids, live_depths: Buffer::new(gpu, "live depths", ids.len())? })
    }

    /// Keeps the transmittances behind this slab for the next slab.
    fn keep_depths(&mut self, recorder: &mut Recorder, slab: &BlendedSlab<'_>) -> Result<(), RenderError> {
        let bytes = self.live_depths.bytes();
        recorder.copy(&slab.frame.depths, &mut self.live_depths, bytes)?;
        let ticket = recorder.submit()?;
        Ok(recorder.wait(ticket)?)
    }
}

/// Units whose entries are computed in one dispatch.
#[derive(Default)]
struct Batch {
    units: Vec<types::MaskUnit>,
    /// Number of entries of all units.
    entries: u32,
}

/// Splits the units of a slab into batches of at most `batch_entries` entries, or of one unit if that has more.
fn batches_of_slab(slab: &BlendedSlab<'_>, ids: &[u16], batch_entries: u32) -> Result<Vec<Batch>, GpuError> {
    let plan = &slab.frame.plan;
    let ranges = download(slab.gpu, &slab.frame.tile_ranges, plan.tile_count() as usize)?;
    let blocks_per_tile = slab.variant.blocks_per_tile();
    let mut batches: Vec<Batch> = Vec::new();
    for (tile, &[first, end]) in (0..).zip(&ranges) {
        let list_len = end - first;
        if list_len == 0 {
            continue;
        }
        for in_tile in 0..blocks_per_tile {
            let origin = block_origin(plan.tiles[0], slab.variant.tile_size, tile, in_tile);
            for id in ids_of_block(ids, plan.size_px, origin) {
                let fits = |batch: &Batch| u64::from(batch.entries) + u64::from(list_len) <= u64::from(batch_entries);
                if !batches.last().is_some_and(fits) {
                    batches.push(Batch::default());
                }
                let Some(batch) = batches.last_mut() else { continue };
                let block = tile * blocks_per_tile + in_tile;
                batch.units.push(types::MaskUnit { block, id: u32::from(id), first_entry: batch.entries });
                batch.entries += list_len;
            }
        }
    }
    Ok(batches)
}

/// First pixel of block `in_tile` of a tile, as in `glsl/include/blend.glsl`.
fn block_origin(columns: u32, tile_size: u32, tile: u32, in_tile: u32) -> [u32; 2] {
    let per_side = tile_size / 8;
    let tile = [tile % columns, tile / columns];
    let block = [in_tile % per_side, in_tile / per_side];
    [0, 1].map(|axis| tile[axis] * tile_size + block[axis] * 8)
}

/// The distinct ids of an 8x8 block of a picture, ascending; empty outside the picture.
fn ids_of_block(ids: &[u16], [width, height]: [u32; 2], [x, y]: [u32; 2]) -> Vec<u16> {
    let mut out = Vec::new();
    for row in y..height.min(y + 8) {
        let start = row as usize * width as usize;
        let columns = start + x.min(width) as usize..start + width.min(x + 8) as usize;
        let mut last = None;
        for &id in &ids[columns] {
            if last != Some(id) {
                out.push(id);
                last = Some(id);
            }
        }
    }
    out.sort_unstable();
    out.dedup();
    out
}

/// Runs a batch and returns its entries: source Gaussian and weight.
fn run_batch(
    recorder: &mut Recorder,
    pipelines: &SegmentPipelines,
    slab: &BlendedSlab<'_>,
    view: &ViewBuffers,
    batch: &Batch,
) -> Result<Vec<[u32; 2]>, RenderError> {
    let (gpu, frame) = (slab.gpu, slab.frame);
    let units = upload(gpu, "mask units", &batch.units)?;
    let mut contributions = Buffer::new(gpu, "contributions", batch.entries as usize)?;
    let unit_count = batch.units.len() as u32;
    let params = mask_contribution::Params {
        size_px: frame.plan.size_px,
        tiles: frame.plan.tiles,
        unit_count,
        first_slab: u32::from(slab.first),
    };
    let bindings = mask_contribution::Bindings {
        splats: &frame.splats,
        footprints: &frame.footprints,
        isect_values: &frame.tile_sort.values,
        tile_ranges: &frame.tile_ranges,
        live_depths: &view.live_depths,
        pixel_ids: &view.pixel_ids,
        units: &units,
        contributions: &mut contributions,
    };
    let subgroups_per_group = slab.variant.blend_workgroup_size / slab.variant.subgroup_size;
    let grid = Grid::groups(unit_count.div_ceil(subgroups_per_group));
    recorder.dispatch(&pipelines.mask_contribution, grid, &params, bindings)?;
    let ticket = recorder.submit()?;
    recorder.wait(ticket)?;
    Ok(download(gpu, &contributions, batch.entries as usize)?)
}

/// Accumulates the entries of a view.
#[derive(Default)]
struct Sums {
    /// Weight of id 0, which most entries have, by Gaussian; as long as the largest index seen so far needs.
    unmasked: Vec<u64>,
    /// (Gaussian, id above 0) packed into a number that sorts like the pair, and a weight.
    keyed: Vec<(u64, u64)>,
    /// Number of leading entries of `keyed` whose keys are sorted and distinct.
    merged: usize,
}

/// Number of new entries after which they are merged: 16 bytes each, 64 MiB.
const MERGE_AT: usize = 1 << 22;

impl Sums {
    fn add(&mut self, batch: &Batch, entries: &[[u32; 2]]) {
        let ends = batch.units.iter().skip(1).map(|u| u.first_entry).chain([batch.entries]);
        for (unit, end) in batch.units.iter().zip(ends) {
            let entries = entries[unit.first_entry as usize..end as usize].iter().filter(|[_, weight]| *weight > 0);
            if unit.id == 0 {
                entries.for_each(|&[gaussian, weight]| self.add_unmasked(gaussian as usize, weight));
            } else {
                let key = |gaussian: u32| u64::from(gaussian) << 16 | u64::from(unit.id);
                self.keyed.extend(entries.map(|&[gaussian, weight]| (key(gaussian), u64::from(weight))));
            }
        }
        if self.keyed.len() - self.merged >= MERGE_AT {
            self.merge();
        }
    }

    fn add_unmasked(&mut self, gaussian: usize, weight: u32) {
        if gaussian >= self.unmasked.len() {
            self.unmasked.resize(gaussian + 1, 0);
        }
        // Weights of one (Gaussian, id) stay below the pixels of a picture times 2^24: far from 2^64.
        self.unmasked[gaussian] += u64::from(weight);
    }

    fn merge(&mut self) {
        self.keyed.par_sort_unstable_by_key(|(key, _)| *key);
        self.keyed.dedup_by(|later, kept| {
            let same = later.0 == kept.0;
            kept.1 += if same { later.1 } else { 0 };
            same
        });
        self.merged = self.keyed.len();
    }

    /// The sums, ordered by Gaussian, then by id.
    fn finish(mut self) -> Vec<Contribution> {
        self.merge();
        let split = |&(key, weight): &(u64, u64)| Contribution { gaussian: (key >> 16) as u32, id: key as u16, weight };
        let mut keyed = self.keyed.iter().map(split).peekable();
        let mut out = Vec::with_capacity(self.keyed.len() + self.unmasked.len());
        for (gaussian, &weight) in (0..).zip(&self.unmasked) {
            while let Some(earlier) = keyed.next_if(|c| c.gaussian < gaussian) {
                out.push(earlier);
            }
            if weight > 0 {
                out.push(Contribution { gaussian, id: 0, weight });
            }
        }
        out.extend(keyed);
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_cover_the_picture_once_at_any_tile_size() {
        for tile_size in [8, 16, 32] {
            let (width, height) = (37u32, 19u32);
            let columns = width.div_ceil(tile_size);
            let tiles = columns * height.div_ceil(tile_size);
            let per_tile = (tile_size / 8) * (tile_size / 8);
            // Every pixel has an id of its own, so the ids of a block are its pixels.
            let ids: Vec<u16> = (0..width * height).map(|i| i as u16).collect();
            let mut seen: Vec<u16> = (0..tiles)
                .flat_map(|tile| (0..per_tile).map(move |in_tile| block_origin(columns, tile_size, tile, in_tile)))
                .flat_map(|origin| ids_of_block(&ids, [width, height], origin))
                .collect();
            seen.sort_unstable();
            assert_eq!(seen, ids, "tile size {tile_size}");
        }
    }

    #[test]
    fn entries_of_a_pair_add_up_and_zeros_are_absent() {
        let unit = |id, first_entry| types::MaskUnit { block: 0, id, first_entry };
        let batch = Batch { units: vec![unit(65535, 0), unit(0, 2)], entries: 4 };
        let mut sums = Sums::default();
        sums.add(&batch, &[[7, 5], [3, 1], [0, 0], [7, 2]]);
        sums.merge();
        sums.add(&batch, &[[7, u32::MAX], [2, 0], [0, 0], [7, 1]]);
        let found: Vec<_> = sums.finish().iter().map(|c| (c.gaussian, c.id, c.weight)).collect();
        assert_eq!(found, [(3, 65535, 1), (7, 0, 3), (7, 65535, 5 + u64::from(u32::MAX))]);
    }
}
