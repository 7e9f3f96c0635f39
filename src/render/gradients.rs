//! Buffers of the backward pass: gradients by parameter, and the intermediate results on the way from the picture.

use std::collections::BTreeMap;
use std::sync::Arc;

use crate::gpu::interface::constants::{CHANNELS, LOG_STEPS, STATUS_COUNT, STRIP};
use crate::gpu::interface::types;
use crate::gpu::staging::upload;
use crate::gpu::{Buffer, BufferPart, Gpu, GpuError};
use crate::kernels::Variant;
use crate::scene::{Parameter, ParameterSet, SourceLayout, SourceRange};

use super::device_scene::DeviceScene;
use super::parameter_buffers::ParameterBuffers;
use super::plan::FramePlan;
use super::source_windows::SourceWindow;

/// Gradients by all parameters of a scene, in the layout of the [`DeviceScene`].
pub struct GradientBuffers {
    /// Gradients by the scene's buffers of the same names.
    pub parameters: ParameterBuffers,
    /// Gradients by the poses of the instances besides the background.
    pub poses: Buffer<types::PoseGradient>,
    /// Sums over steps for densification, by source: length of the gradient by the projected mean in units of half the
    /// image, number of views that show it, and the largest value of three standard deviations on screen, px.
    pub screen_statistics: Buffer<[f32; 3]>,
    /// The first two of these sums by offset record, in scenes in which instances may get own Gaussians.
    pub record_statistics: Buffer<[f32; 2]>,
}

impl GradientBuffers {
    /// Allocates the gradients of a scene.
    pub fn new(gpu: &Arc<Gpu>, scene: &DeviceScene) -> Result<Self, GpuError> {
        let statistics = vec![[0.0; 3]; scene.counts.rows[Parameter::Means].iter().sum()];
        let records = if scene.traits(0).own_may_grow { scene.counts.rows[Parameter::OffsetMeans][0] } else { 0 };
        Ok(Self {
            parameters: ParameterBuffers::new(gpu, "gradients, ", &scene.counts.rows)?,
            poses: Buffer::new(gpu, "gradients, poses", scene.posed_instances() as usize)?,
            screen_statistics: upload(gpu, "screen statistics", &statistics)?,
            record_statistics: upload(gpu, "record statistics", &vec![[0.0; 2]; records])?,
        })
    }

    /// Buffers of one element, which free the memory of the gradients until the next [`GradientBuffers::new`].
    pub fn placeholder(gpu: &Arc<Gpu>) -> Result<Self, GpuError> {
        Ok(Self {
            parameters: ParameterBuffers::new(gpu, "no gradients, ", &ParameterSet::from_fn(|_| [0, 0]))?,
            poses: Buffer::new(gpu, "no gradients", 1)?,
            screen_statistics: Buffer::new(gpu, "no gradients", 1)?,
            record_statistics: Buffer::new(gpu, "no gradients", 1)?,
        })
    }

    /// What a window shows of the arrays by source.
    pub(super) fn parts(&self, window: &SourceWindow) -> Vec<BufferPart> {
        let mut parts = self.parameters.parts(window);
        parts.push(window.part(&self.screen_statistics, Parameter::Means, size_of::<[f32; 3]>() as u64));
        parts
    }

    /// Size of all buffers, bytes.
    pub fn bytes(&self) -> u64 {
        self.parameters.bytes() + self.poses.bytes() + self.screen_statistics.bytes() + self.record_statistics.bytes()
    }
}

/// For each chunk of source Gaussians, the rows of the instance table that show it.
pub struct SourceTables {
    /// All chunks of the source pool: first those of templates and of what several instances own together.
    pub chunks: Buffer<types::SourceChunk>,
    /// Rows, template by template, in file order; then those of instances' own Gaussians, and the background's.
    pub instance_from_template: Buffer<u32>,
    /// Number of elements of `chunks`.
    pub chunk_count: u32,
    /// Number of chunks, from the first on, that several rows may show, or that have offset records. No more than one row shows
    /// each of the others.
    pub shared_chunks: u32,
    /// The largest number of instances that show a Gaussian.
    pub most_instances: u32,
}

impl SourceTables {
    /// The tables of a layout for kernels with `chunk_size` threads per work-group.
    pub fn new(gpu: &Arc<Gpu>, layout: &SourceLayout, chunk_size: u32) -> Result<Self, GpuError> {
        let HostTables { chunks, rows, shared_chunks } = source_tables(layout, chunk_size);
        Ok(Self {
            chunks: upload(gpu, "source chunks", &chunks)?,
            instance_from_template: upload(gpu, "instance_from_template", &rows)?,
            chunk_count: chunks.len() as u32,
            shared_chunks,
            most_instances: chunks.iter().map(|chunk| chunk.instance_count).max().unwrap_or(0),
        })
    }
}

/// [`SourceTables`] before they are uploaded.
#[derive(Default)]
struct HostTables {
    chunks: Vec<types::SourceChunk>,
    /// `instance_from_template`.
    rows: Vec<u32>,
    shared_chunks: u32,
}

/// Source Gaussians that the same rows show.
struct Shown<'a> {
    range: SourceRange,
    rows: &'a [u32],
    sh_degree: u32,
    /// Index of the first of them in SH bands 1, 2, 3.
    first_in_band: [u32; 3],
}

impl HostTables {
    fn push(&mut self, shown: Shown<'_>, chunk_size: u32) {
        let Shown { range, rows, sh_degree, first_in_band } = shown;
        self.chunks.extend((0..range.count.div_ceil(chunk_size)).map(|chunk| types::SourceChunk {
            first_source: range.first,
            source_count: range.count,
            chunk,
            first_instance: self.rows.len() as u32,
            instance_count: rows.len() as u32,
            sh_degree,
            first_in_band,
        }));
        self.rows.extend_from_slice(rows);
    }
}

fn source_tables(layout: &SourceLayout, chunk_size: u32) -> HostTables {
    let mut tables = HostTables::default();
    let push_posed = |tables: &mut HostTables, range: SourceRange, rows: &[u32]| {
        let sh_degree = layout.templates.sh_degree;
        tables.push(Shown { range, rows, sh_degree, first_in_band: [range.first; 3] }, chunk_size);
    };
    let first_rows = layout.first_rows();
    for (t, range) in layout.template_ranges.iter().enumerate() {
        let uses = |k: &usize| layout.instances[*k].template as usize == t;
        let rows: Vec<u32> = (0..layout.instances.len()).filter(uses).map(|k| first_rows[k]).collect();
        push_posed(&mut tables, *range, &rows);
    }
    let mut rows_of_own: BTreeMap<SourceRange, Vec<u32>> = BTreeMap::new();
    for k in (0..layout.instances.len()).filter(|&k| layout.own_sources(k).count > 0) {
        rows_of_own.entry(layout.own_sources(k)).or_default().push(first_rows[k] + 1);
    }
    let (shared, single): (Vec<_>, Vec<_>) = rows_of_own.into_iter().partition(|(_, rows)| rows.len() > 1);
    for (own, rows) in shared {
        push_posed(&mut tables, own, &rows);
    }
    tables.shared_chunks = tables.chunks.len() as u32;
    // Gaussians that no template shows have gradients of zero.
    let mut ranges: Vec<SourceRange> = layout.template_ranges.iter().copied().filter(|range| range.count > 0).collect();
    ranges.sort_by_key(|range| range.first);
    let end = SourceRange { first: layout.templates.len as u32, count: 0 };
    let mut first = 0;
    for range in ranges.into_iter().chain([end]) {
        push_posed(&mut tables, SourceRange { first, count: range.first.saturating_sub(first) }, &[]);
        first = first.max(range.first + range.count);
    }
    for (own, rows) in single {
        push_posed(&mut tables, own, &rows);
    }
    let posed = layout.posed();
    let background = Shown {
        range: SourceRange { first: posed.len as u32, count: layout.background.len as u32 },
        rows: &[first_rows[layout.instances.len()]],
        sh_degree: layout.background.sh_degree,
        first_in_band: [1, 2, 3].map(|l| if posed.sh_degree >= l { posed.len as u32 } else { 0 }),
    };
    tables.push(background, chunk_size);
    tables
}

/// Intermediate buffers of a training step, sized by the plan of its frame.
pub struct BackwardBuffers {
    /// Gradient of the loss by rgb and alpha, by pixel.
    pub cotangents: Buffer<[f32; 4]>,
    /// Moments along rows, by channel and pixel.
    pub row_moments: Buffer<[f32; 4]>,
    /// Derivatives of SSIM by the windowed moments, by channel and pixel.
    pub ssim_gradients: Buffer<[f32; 3]>,
    /// Derivatives of SSIM, windowed along rows, by channel and pixel.
    pub row_gradients: Buffer<[f32; 3]>,
    /// Sum of SSIM over each strip of pixels.
    pub ssim_sums: Buffer<f32>,
    /// Sums of absolute and squared errors over each strip of pixels.
    pub error_sums: Buffer<[f32; 2]>,
    /// Contribution of an 8x8 block of pixels to the gradient of a splat, by emission index and block.
    pub isect_moments: Buffer<types::SplatMoments>,
    /// Gradients by place and shape of the Gaussians of instances, by work item and index in the chunk.
    pub shape_gradients: Buffer<types::ShapeGradient>,
    /// Gradients by their colours and opacities, and what else is summed over instances, as `shape_gradients`.
    pub look_gradients: Buffer<types::LookGradient>,
    /// Terms of the gradients by instances' colour matrices, as `shape_gradients`; one element without matrices.
    pub color_terms: Buffer<types::ColorTerms>,
    /// Gradients by poses, by work item and subgroup; one element without pose refinement.
    pub pose_sums: Buffer<types::PoseGradient>,
}

impl BackwardBuffers {
    /// Allocates the buffers of a plan.
    ///
    /// # Errors
    /// A buffer exceeds the device's limits; the error names it.
    pub fn new(gpu: &Arc<Gpu>, plan: &FramePlan, variant: &Variant) -> Result<Self, GpuError> {
        let pixels = plan.pixels() as usize;
        let values = CHANNELS as usize * pixels;
        // Threads past the last strip of the last work-group write nothing.
        let strips = column_strips(plan.size_px) as usize;
        let moments = plan.capacities.intersections as usize * variant.blocks_per_tile() as usize;
        let subgroups = if plan.poses { plan.slots / variant.expand_backward_subgroup_size } else { 1 };
        let colored = if plan.color_matrices { plan.slots } else { 1 };
        Ok(Self {
            cotangents: Buffer::new(gpu, "cotangents", pixels)?,
            row_moments: Buffer::new(gpu, "row_moments", values)?,
            ssim_gradients: Buffer::new(gpu, "ssim_gradients", values)?,
            row_gradients: Buffer::new(gpu, "row_gradients", values)?,
            ssim_sums: Buffer::new(gpu, "ssim_sums", strips)?,
            error_sums: Buffer::new(gpu, "error_sums", strips)?,
            isect_moments: Buffer::new(gpu, "isect_moments", moments)?,
            shape_gradients: Buffer::new(gpu, "shape_gradients", plan.slots as usize)?,
            look_gradients: Buffer::new(gpu, "look_gradients", plan.slots as usize)?,
            color_terms: Buffer::new(gpu, "color_terms", colored as usize)?,
            pose_sums: Buffer::new(gpu, "pose_sums", subgroups as usize)?,
        })
    }

    /// Size of all buffers, bytes.
    pub fn bytes(&self) -> u64 {
        self.cotangents.bytes()
            + self.row_moments.bytes()
            + self.ssim_gradients.bytes()
            + self.row_gradients.bytes()
            + self.ssim_sums.bytes()
            + self.error_sums.bytes()
            + self.isect_moments.bytes()
            + self.shape_gradients.bytes()
            + self.look_gradients.bytes()
            + self.color_terms.bytes()
            + self.pose_sums.bytes()
    }
}

/// Number of strips of `STRIP` pixels in the columns of an image.
pub fn column_strips(size_px: [u32; 2]) -> u32 {
    size_px[0] * size_px[1].div_ceil(STRIP)
}

/// Number of strips of `STRIP` pixels in the rows of an image.
pub fn row_strips(size_px: [u32; 2]) -> u32 {
    size_px[0].div_ceil(STRIP) * size_px[1]
}

/// Status and records of a run of training steps, which the host reads.
pub struct StepLog {
    /// The sticky overflow flag, `STATUS_*`.
    pub status: Buffer<u32>,
    /// Ring of `LOG_STEPS` records.
    pub records: Buffer<types::StepRecord>,
    /// Host-visible copies of `records`, one per step in flight.
    pub readback: Vec<Buffer<types::StepRecord>>,
}

impl StepLog {
    /// A log for `in_flight` submitted steps, all zero.
    pub fn new(gpu: &Arc<Gpu>, in_flight: usize) -> Result<Self, GpuError> {
        let readback = |i| Buffer::for_readback(gpu, &format!("step records {i}"), LOG_STEPS as usize);
        Ok(Self {
            status: upload(gpu, "status", &[0; STATUS_COUNT as usize])?,
            records: upload(gpu, "step records", &[types::StepRecord::default(); LOG_STEPS as usize])?,
            readback: (0..in_flight).map(readback).collect::<Result<_, _>>()?,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::source_layout::{CloudSize, InstanceSource};

    /// Every source Gaussian has a chunk, whatever shows it: no gradient is left undefined.
    #[test]
    fn gaussians_that_no_template_shows_have_chunks_without_instances() {
        let range = |first, count| SourceRange { first, count };
        let layout = SourceLayout {
            templates: CloudSize { len: 12, sh_degree: 0 },
            background: CloudSize { len: 3, sh_degree: 0 },
            template_ranges: vec![range(6, 3), range(1, 3), range(2, 0)],
            instances: vec![InstanceSource { template: 1, first_offset: None }; 2],
            own: 0,
            own_ranges: Vec::new(),
            offsets: 0,
        };
        let tables = source_tables(&layout, 2);
        // Of the range of three and of the second, which two instances show.
        assert_eq!(tables.shared_chunks, 4);
        let mut instances_of = vec![None; 15];
        for chunk in &tables.chunks {
            let begin = chunk.first_source + 2 * chunk.chunk;
            let end = (begin + 2).min(chunk.first_source + chunk.source_count);
            for source in begin..end {
                assert_eq!(instances_of[source as usize].replace(chunk.instance_count), None, "{source}");
            }
        }
        let want = [0, 2, 2, 2, 0, 0, 0, 0, 0, 0, 0, 0, 1, 1, 1].map(Some);
        assert_eq!(instances_of, want);
    }
}
