//! Shared by the strategies: scratch buffers, and the reordering of every array.

use std::ops::Range;
use std::sync::Arc;

use crate::device_state::DeviceState;
use instgs_vk::gpu::error::STORAGE_LIMIT;
use instgs_vk::gpu::interface::constants::*;
use instgs_vk::gpu::staging::download;
use instgs_vk::gpu::{Buffer, Gpu, GpuError, Grid, Home, PipelineCache, Recorder, bound_runs};
use instgs_vk::kernels::{DensifyPipelines, Primitives, Variant, move_gaussians};
use instgs_vk::render::scan::{Blocks, ScanInput, ScanScratch, plain, record_scan};
use instgs_vk::render::sort::{DigitTables, Sort, SortBuffers, record_sort};
use instgs_vk::render::{GradientBuffers, RenderError};
use instgs_vk::scene::Owner;

/// Pipelines and a recorder shared by the strategies.
pub(super) struct Tools {
    pub(super) gpu: Arc<Gpu>,
    pub(super) workgroup_size: u32,
    pub(super) primitives: Primitives,
    pub(super) pipelines: DensifyPipelines,
    pub(super) recorder: Recorder,
}

/// Flags of a push constant: the first is bit 0.
pub(super) fn bits<const N: usize>(flags: [bool; N]) -> u32 {
    flags.iter().enumerate().map(|(bit, &flag)| u32::from(flag) << bit).sum()
}

/// The origins of new Gaussians, or of new offset records.
pub(super) struct Moves {
    /// Index of the old Gaussian, for each new one.
    pub(super) origins: Buffer<u32>,
    /// 0 for a Gaussian that did not change, for each new one; others lose their moments.
    pub(super) made: Buffer<u32>,
    /// Number of new Gaussians.
    pub(super) count: u32,
}

impl Moves {
    /// Buffers for `count` new Gaussians.
    pub(super) fn new(gpu: &Arc<Gpu>, count: u32) -> Result<Self, GpuError> {
        Ok(Self {
            origins: Buffer::new(gpu, "origins", count as usize)?,
            made: Buffer::new(gpu, "made", count as usize)?,
            count,
        })
    }
}

/// The values that new or changed Gaussians get.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Made {
    /// They keep the value of their origin.
    Inherits,
    /// They start at zero, as moments do.
    IsZero,
}

/// Offsets are bound whole.
fn check_bound_whole(gpu: &Gpu, name: &str, rows: u32, width: u32) -> Result<(), GpuError> {
    let (bytes, limit) = (4 * u64::from(rows) * u64::from(width), gpu.caps().max_storage_bytes);
    if bytes > limit {
        return Err(GpuError::BufferTooLarge { name: name.into(), bytes, limit, limit_name: STORAGE_LIMIT });
    }
    Ok(())
}

impl Tools {
    pub(super) fn new(
        gpu: &Arc<Gpu>,
        cache: &PipelineCache,
        variant: &Variant,
        sh_degree: u32,
    ) -> Result<Self, GpuError> {
        Ok(Self {
            gpu: gpu.clone(),
            workgroup_size: variant.workgroup_size,
            primitives: Primitives::new(gpu, cache, variant)?,
            pipelines: DensifyPipelines::new(gpu, cache, variant, sh_degree)?,
            recorder: Recorder::new(gpu)?,
        })
    }

    /// One invocation for each of `count` elements.
    pub(super) fn threads(&self, count: u32) -> Grid {
        Grid::threads(count, self.workgroup_size)
    }

    /// Submits what was recorded and waits for it.
    pub(super) fn run(&mut self) -> Result<(), GpuError> {
        let ticket = self.recorder.submit()?;
        self.recorder.wait(ticket)
    }

    /// Scan scratch for lists of `count` elements: the counter `COUNTER_GAUSSIANS` is `count`, the others are zero.
    pub(super) fn scratch(&self, count: u32) -> Result<ScanScratch, GpuError> {
        ScanScratch::for_list(&self.gpu, COUNTER_GAUSSIANS, FAMILY_VISIBLE, count)
    }

    /// Records a sort of `COUNTER_GAUSSIANS` pairs by whole keys. The tables must live until it has finished.
    pub(super) fn record_sort(
        &mut self,
        scratch: &mut ScanScratch,
        tables: &mut DigitTables,
        buffers: &mut SortBuffers,
    ) -> Result<(), GpuError> {
        let sort = Sort { count_slot: COUNTER_GAUSSIANS, family: FAMILY_VISIBLE, passes: u32::BITS / RADIX_BITS };
        record_sort(&mut self.recorder, &self.primitives, scratch, tables, sort, buffers)
    }

    /// Histogram and digit offsets for a sort of `count` pairs.
    pub(super) fn sort_tables(&self, count: u32) -> Result<DigitTables, GpuError> {
        DigitTables::new(&self.gpu, (count.div_ceil(BLOCK_SIZE) * RADIX_SIZE) as usize)
    }

    /// Reorders parameters and moments, one array at a time: source Gaussians by `sources`, offset records by `offsets`,
    /// which scenes without offsets do not need. Gradients and tables are empty until [`DeviceState::relayout`].
    pub(super) fn move_arrays(
        &mut self,
        state: &mut DeviceState,
        sources: &Moves,
        offsets: Option<&Moves>,
    ) -> Result<(), RenderError> {
        state.gradients = GradientBuffers::placeholder(&self.gpu)?;
        let (rows, records) = (state.scene.counts.rows, state.layout.offsets.max(1));
        let parameters = state.scene.parameters.scalars_mut();
        for (parameter, values, of_values) in parameters.zip(state.moments.parameters.each_mut()) {
            // SH bands above the cloud's degree have no rows; offsets of coefficients above 0 have several per record.
            let (moves, rows_each) = match parameter.owner() {
                _ if rows[parameter] == [0, 0] => continue,
                Owner::Source | Owner::ShBand(_) => (Some(sources), 1),
                Owner::Offset => (offsets, rows[parameter][0] / records),
                Owner::Instance => continue,
            };
            if let Some(moves) = moves {
                let width = (rows_each * parameter.width()) as u32;
                if parameter.owner() == Owner::Offset {
                    check_bound_whole(&self.gpu, values.name(), moves.count, width)?;
                }
                self.move_array(values, width, moves, Made::Inherits)?;
                self.move_array(of_values.scalars_mut(), 2 * width, moves, Made::IsZero)?;
            }
        }
        Ok(())
    }

    /// Reorders an array of `width` f32 per Gaussian.
    fn move_array(&mut self, array: &mut Buffer<f32>, width: u32, moves: &Moves, made: Made) -> Result<(), GpuError> {
        let mut after = Buffer::in_parts(&self.gpu, array.name(), moves.count as usize * width as usize, Home::Device)?;
        let row_bytes = 4 * u64::from(width);
        let parts = |buffer: &Buffer<f32>, run: &Range<usize>| {
            buffer.part(run.start as u64 * row_bytes, run.end as u64 * row_bytes)
        };
        let rows_before = array.len() / width as usize;
        // Where the array is larger than a binding, each part of the new one is filled from each part of the old one.
        for of_after in bound_runs(&self.gpu, moves.count as usize, row_bytes) {
            for of_before in bound_runs(&self.gpu, rows_before, row_bytes) {
                let params = move_gaussians::Params {
                    count: of_after.len() as u32 * width,
                    width,
                    first_after: of_after.start as u32,
                    first_before: of_before.start as u32,
                    count_before: of_before.len() as u32,
                    zero_made: u32::from(made == Made::IsZero),
                };
                let parts = [parts(array, &of_before), parts(&after, &of_after)];
                let bindings = move_gaussians::Bindings {
                    origins: &moves.origins,
                    made: &moves.made,
                    before: array,
                    after: &mut after,
                };
                let grid = self.threads(params.count);
                self.recorder.dispatch_parts(&self.pipelines.move_gaussians, grid, &params, bindings, &parts)?;
            }
        }
        self.run()?;
        *array = after;
        Ok(())
    }

    /// Records a scan of `COUNTER_GAUSSIANS` elements, in the order of `input.indices` if there is one.
    pub(super) fn record_scan(
        &mut self,
        scratch: &mut ScanScratch,
        total_slot: Option<u32>,
        input: ScanInput<'_>,
        offsets: &mut Buffer<u32>,
    ) -> Result<(), GpuError> {
        let mut scan = plain(COUNTER_GAUSSIANS);
        scan.total_slot = total_slot.unwrap_or(scan.total_slot);
        let blocks = Blocks::Direct(Grid::threads(offsets.len() as u32, BLOCK_SIZE));
        record_scan(&mut self.recorder, &self.primitives.scan, scratch, blocks, scan, input, offsets)
    }

    /// Reads back the counters of a scratch.
    pub(super) fn counters(&self, scratch: &ScanScratch) -> Result<Vec<u32>, GpuError> {
        download(&self.gpu, &scratch.counters, COUNTER_COUNT as usize)
    }
}
