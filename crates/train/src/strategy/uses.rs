//! How source Gaussians are used: by how many instances they are shown, and what the loss feels of each.

use instgs_vk::gpu::interface::constants::*;
use instgs_vk::gpu::{Buffer, GpuError, Grid};
use instgs_vk::kernels::source_use;
use instgs_vk::render::scan::ScanInput;
use instgs_vk::scene::Parameter;

use super::tools::Tools;
use crate::device_state::DeviceState;

/// What leaves a full scene: 1 for each source Gaussian that does, and then for each offset record. Zero before anything is marked.
pub(super) fn none_retired(tools: &mut Tools, state: &DeviceState) -> Result<Buffer<u32>, GpuError> {
    let mut retired = Buffer::new(&tools.gpu, "retired", state.source_count() + state.layout.offsets)?;
    tools.recorder.fill(&mut retired, 0)?;
    Ok(retired)
}

/// The output of kernel `source_use`, which says what each is.
pub(super) struct Uses {
    /// Number of instances that show it, by source Gaussian.
    pub(super) uses: Buffer<u32>,
    /// Largest opacity logit in any instance, by source Gaussian.
    pub(super) highest_logits: Buffer<f32>,
    /// Logarithm of the largest scale of an instance, by source Gaussian.
    pub(super) log_world_scales: Buffer<f32>,
    /// What the loss feels of its opacity, by source Gaussian.
    pub(super) felt: Buffer<f32>,
    /// The same by offset record, if records are judged one by one.
    pub(super) record_felt: Buffer<f32>,
    /// Number of records that are judged one by one: all or none.
    pub(super) records: u32,
    counts_hidden: bool,
}

impl Uses {
    /// Records how Gaussians are used if those leave that are marked in `retired`. `counts_hidden` counts instances that do not show
    /// a Gaussian, too.
    pub(super) fn find(
        tools: &mut Tools,
        state: &DeviceState,
        retired: &Buffer<u32>,
        counts_hidden: bool,
    ) -> Result<Self, GpuError> {
        let (gpu, sources) = (tools.gpu.clone(), state.source_count());
        // Only then records have statistics, and belong to one instance each.
        let by_record = state.scene.traits(0).own_may_grow;
        let records = if by_record { state.layout.offsets } else { 0 };
        let mut out = Self {
            uses: Buffer::new(&gpu, "uses", sources)?,
            highest_logits: Buffer::new(&gpu, "highest_logits", sources)?,
            log_world_scales: Buffer::new(&gpu, "log_world_scales", sources)?,
            felt: Buffer::new(&gpu, "felt", sources)?,
            record_felt: Buffer::new(&gpu, "record_felt", records.max(1))?,
            records: records as u32,
            counts_hidden,
        };
        // A Gaussian of no template is used by no instance, and shown by none.
        tools.recorder.fill(&mut out.uses, 0)?;
        tools.recorder.fill(&mut out.highest_logits, f32::MIN.to_bits())?;
        tools.recorder.fill(&mut out.log_world_scales, 0)?;
        tools.recorder.fill(&mut out.felt, 0)?;
        out.update(tools, state, retired)?;
        Ok(out)
    }

    /// Records the same again after more was marked in `retired`.
    pub(super) fn update(
        &mut self,
        tools: &mut Tools,
        state: &DeviceState,
        retired: &Buffer<u32>,
    ) -> Result<(), GpuError> {
        let parameters = &state.scene.parameters;
        let bindings = source_use::Bindings {
            source_chunks: &state.tables.chunks,
            instance_from_template: &state.tables.instance_from_template,
            instances: &state.scene.instances,
            opacity_logits: &parameters.opacity_logits,
            offset_opacity_logits: &parameters.offset_opacity_logits,
            uses: &mut self.uses,
            highest_logits: &mut self.highest_logits,
            log_world_scales: &mut self.log_world_scales,
            logit_moments: &state.moments.parameters[Parameter::OpacityLogits],
            offset_logit_moments: &state.moments.parameters[Parameter::OffsetOpacityLogits],
            felt: &mut self.felt,
            retired,
            record_felt: &mut self.record_felt,
        };
        let params = source_use::Params {
            chunk_count: state.tables.chunk_count,
            first_retired: state.source_count() as u32,
            by_record: u32::from(self.records > 0),
            counts_hidden: u32::from(self.counts_hidden),
        };
        let grid = Grid::groups(state.tables.chunk_count);
        tools.recorder.dispatch(&tools.pipelines.source_use, grid, &params, bindings)
    }

    /// Number of expanded Gaussians: the sum of `uses`. Runs what is recorded.
    pub(super) fn total(&self, tools: &mut Tools) -> Result<u64, GpuError> {
        let count = self.uses.len() as u32;
        let mut before = Buffer::new(&tools.gpu, "uses before", count as usize)?;
        let mut scratch = tools.scratch(count)?;
        tools.record_scan(&mut scratch, Some(COUNTER_SHOWN), ScanInput::in_order(&self.uses), &mut before)?;
        tools.run()?;
        Ok(u64::from(tools.counters(&scratch)?[COUNTER_SHOWN as usize]))
    }
}

/// Number of expanded Gaussians that are shown: all but those that an instance hides.
pub(super) fn shown(tools: &mut Tools, state: &DeviceState) -> Result<u64, GpuError> {
    let retired = none_retired(tools, state)?;
    Uses::find(tools, state, &retired, false)?.total(tools)
}
