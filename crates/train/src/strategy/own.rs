//! Growth of single instances: a template's Gaussian whose gradient is large in a few of its instances grows in these
//! alone, as Gaussians of their own. A copy looks like what the instance has of the template, offsets and colours included.

use instgs_vk::gpu::interface::constants::*;
use instgs_vk::gpu::staging::download_elements;
use instgs_vk::gpu::{Buffer, GpuError, Grid};
use instgs_vk::kernels::{densify_own, densify_own_need, densify_own_select, densify_place_own};
use instgs_vk::render::scan::ScanInput;
use instgs_vk::render::source_windows::SourceWindow;
use instgs_vk::scene::{Parameter, SourceLayout};

use super::densify::{Fates, Limits};
use super::tools::{Moves, Tools, bits};
use crate::device_state::DeviceState;

/// Which instances call for growth alone.
pub(super) struct Needs {
    /// Number of these instances, by source Gaussian.
    pub(super) own_counts: Buffer<u32>,
    /// Their mean screen gradient, by source Gaussian.
    pub(super) own_gradients: Buffer<f32>,
    /// 1 if the instance gets a Gaussian of its own, by offset record.
    records: Buffer<u32>,
    /// Exclusive scan of `records`.
    records_before: Buffer<u32>,
    /// False if no instance may grow alone: then all is zero.
    may_grow: bool,
}

/// How many Gaussians each instance gets for its own.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Gains {
    /// By instance; empty if none may get any.
    pub(super) by_instance: Vec<u32>,
}

/// A run of old source Gaussians, whose new places are `shift` behind those that they have without own Gaussians.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct ShiftedRun {
    /// Index of the first old source Gaussian of the run.
    pub(super) first: u32,
    /// Number of old source Gaussians in the run.
    pub(super) count: u32,
    /// Number of own Gaussians inserted before them.
    pub(super) shift: u32,
}

/// The Gaussians that an instance gets, and where they come from.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Inserted {
    /// Index of the instance.
    instance: u32,
    /// Gaussians of its template before.
    count: u32,
    /// First Gaussian of its template, before and afterwards.
    first_source: [u32; 2],
    /// First offset record of the instance, before and afterwards.
    first_offset: [u32; 2],
    /// New index of the first Gaussian that it gets.
    first_new: u32,
}

impl Needs {
    /// Finds which instances call for growth alone, by the statistics of their offset records.
    pub(super) fn find(tools: &mut Tools, state: &DeviceState, limits: &Limits) -> Result<Self, GpuError> {
        let gpu = tools.gpu.clone();
        let (sources, records) = (state.source_count(), state.layout.offsets);
        let may_grow = limits.own_share > 0.0 && !state.layout.own_ranges.is_empty() && records > 0;
        let mut out = Self {
            own_counts: Buffer::new(&gpu, "own_counts", sources)?,
            own_gradients: Buffer::new(&gpu, "own_gradients", sources)?,
            records: Buffer::new(&gpu, "needs", if may_grow { records } else { 1 })?,
            records_before: Buffer::new(&gpu, "needs_before", if may_grow { records } else { 1 })?,
            may_grow,
        };
        tools.recorder.fill(&mut out.own_counts, 0)?;
        tools.recorder.fill(&mut out.own_gradients, 0)?;
        tools.recorder.fill(&mut out.records, 0)?;
        if may_grow {
            let bindings = densify_own_need::Bindings {
                source_chunks: &state.tables.chunks,
                instance_from_template: &state.tables.instance_from_template,
                instances: &state.scene.instances,
                record_statistics: &state.gradients.record_statistics,
                own_counts: &mut out.own_counts,
                own_gradients: &mut out.own_gradients,
                needs: &mut out.records,
            };
            let params = densify_own_need::Params {
                chunk_count: state.tables.chunk_count,
                gradient_threshold: limits.gradient_threshold(),
                own_share: limits.own_share,
            };
            let grid = Grid::groups(state.tables.chunk_count);
            tools.recorder.dispatch(&tools.pipelines.densify_own_need, grid, &params, bindings)?;
        }
        Ok(out)
    }

    /// Takes back what `fates` do not grant; returns what each instance gets.
    pub(super) fn select(&mut self, tools: &mut Tools, state: &DeviceState, fates: &Fates) -> Result<Gains, GpuError> {
        if !self.may_grow {
            return Ok(Gains::default());
        }
        let bindings = densify_own_select::Bindings {
            source_chunks: &state.tables.chunks,
            instance_from_template: &state.tables.instance_from_template,
            instances: &state.scene.instances,
            growths: &fates.growths,
            needs: &mut self.records,
        };
        let params = densify_own_select::Params { chunk_count: state.tables.chunk_count };
        let grid = Grid::groups(state.tables.chunk_count);
        tools.recorder.dispatch(&tools.pipelines.densify_own_select, grid, &params, bindings)?;
        let records = state.layout.offsets;
        let mut scratch = tools.scratch(records as u32)?;
        let input = ScanInput::in_order(&self.records);
        tools.record_scan(&mut scratch, Some(COUNTER_DENSIFIED), input, &mut self.records_before)?;
        tools.run()?;
        let total = tools.counters(&scratch)?[COUNTER_DENSIFIED as usize];
        // The scan at the first record of each instance and behind its last.
        let ends: Vec<[usize; 2]> = (0..state.layout.instances.len()).map(|k| record_range(&state.layout, k)).collect();
        let inner: Vec<usize> = ends.as_flattened().iter().copied().filter(|&record| record < records).collect();
        let mut found = download_elements(&tools.gpu, &self.records_before, &inner)?.into_iter();
        let mut at = |record: usize| if record < records { found.next().unwrap_or(total) } else { total };
        let gain = |[first, end]: [usize; 2]| {
            let before = at(first);
            at(end) - before
        };
        Ok(Gains { by_instance: ends.into_iter().map(gain).collect() })
    }

    /// Adds the Gaussians that instances get to the list of new ones.
    pub(super) fn place(
        &self,
        tools: &mut Tools,
        fates: &Fates,
        inserted: &[Inserted],
        moves: &mut Moves,
    ) -> Result<(), GpuError> {
        for own in inserted {
            let bindings = densify_place_own::Bindings {
                needs: &self.records,
                needs_before: &self.records_before,
                growths: &fates.growths,
                origins: &mut moves.origins,
                made: &mut moves.made,
            };
            let params = densify_place_own::Params {
                count: own.count,
                first_source_before: own.first_source[0],
                first_offset_before: own.first_offset[0],
                first_new: own.first_new,
                instance: own.instance,
            };
            let grid = tools.threads(own.count);
            tools.recorder.dispatch(&tools.pipelines.densify_place_own, grid, &params, bindings)?;
        }
        tools.run()
    }

    /// Makes the new Gaussians look like what their instances have of the template. All arrays have been moved.
    pub(super) fn apply_offsets(
        &self,
        tools: &mut Tools,
        state: &mut DeviceState,
        fates: &Fates,
        inserted: &[Inserted],
    ) -> Result<(), GpuError> {
        let traits = state.scene.traits(0);
        let kinds = bits([traits.offset_log_scales, traits.offset_quats]);
        let colored = state.scene.has(Parameter::ColorFromTemplate);
        let windows: Vec<SourceWindow> = state.scene.windows.iter().collect();
        for (own, window) in inserted.iter().flat_map(|own| windows.iter().map(move |window| (own, window))) {
            let parts = state.scene.parts(window);
            let parameters = &mut state.scene.parameters;
            let bindings = densify_own::Bindings {
                needs: &self.records,
                needs_before: &self.records_before,
                firsts: &fates.firsts,
                means: &mut parameters.means,
                quats: &mut parameters.quats,
                log_scales: &mut parameters.log_scales,
                opacity_logits: &mut parameters.opacity_logits,
                sh0: &mut parameters.sh0,
                sh1: &mut parameters.sh1,
                sh2: &mut parameters.sh2,
                sh3: &mut parameters.sh3,
                offset_means: &parameters.offset_means,
                offset_sh_dc: &parameters.offset_sh_dc,
                offset_opacity_logits: &parameters.offset_opacity_logits,
                offset_sh_rest: &parameters.offset_sh_rest,
                offset_log_scales: &parameters.offset_log_scales,
                offset_quats: &parameters.offset_quats,
                color_from_template: &parameters.color_from_template,
            };
            let params = densify_own::Params {
                count: own.count,
                first_source_before: own.first_source[0],
                first_source: own.first_source[1],
                first_offset_before: own.first_offset[0],
                first_offset: own.first_offset[1],
                first_new: own.first_new,
                color: if colored { own.instance } else { NO_COLOR },
                first_bound: window.shown.first,
                count_bound: window.shown.count,
                kinds,
                rest: traits.offset_sh_rest,
            };
            let grid = tools.threads(own.count);
            tools.recorder.dispatch_parts(&tools.pipelines.densify_own, grid, &params, bindings, &parts)?;
        }
        tools.run()
    }
}

impl Gains {
    /// All old source Gaussians in runs that move by the same number of places.
    pub(super) fn shifted_runs(&self, layout: &SourceLayout) -> Vec<ShiftedRun> {
        let mut runs = Vec::new();
        let (mut first, mut shift) = (0, 0);
        for (k, &gain) in self.by_instance.iter().enumerate().filter(|(_, gain)| **gain > 0) {
            let own = layout.own_sources(k);
            let end = own.first + own.count;
            runs.push(ShiftedRun { first, count: end - first, shift });
            (first, shift) = (end, shift + gain);
        }
        runs.push(ShiftedRun { first, count: layout.source_count() as u32 - first, shift });
        runs.retain(|run| run.count > 0);
        runs
    }

    /// Where the new Gaussians of each instance go in the layout `after`.
    pub(super) fn inserted(&self, before: &SourceLayout, after: &SourceLayout) -> Vec<Inserted> {
        let inserted = |(k, &gain): (usize, &u32)| {
            let (was, is) = (before.instances[k], after.instances[k]);
            let ranges = [before, after].map(|layout| layout.template_ranges[was.template as usize]);
            let own = after.own_sources(k);
            (gain > 0).then_some(Inserted {
                instance: k as u32,
                count: ranges[0].count,
                first_source: ranges.map(|range| range.first),
                first_offset: [was.first_offset?, is.first_offset?],
                first_new: own.first + own.count - gain,
            })
        };
        self.by_instance.iter().enumerate().filter_map(inserted).collect()
    }
}

/// First offset record of instance `k`, and the one behind its last; both 0 if it has none.
fn record_range(layout: &SourceLayout, k: usize) -> [usize; 2] {
    let instance = layout.instances[k];
    let count = layout.template_ranges[instance.template as usize].count;
    instance.first_offset.map_or([0; 2], |first| [first as usize, (first + count) as usize])
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::scene::SourceRange;
    use instgs_vk::scene::source_layout::{CloudSize, InstanceSource};

    /// A template of 4 and three instances with 2, 0 and 3 own Gaussians; a background of 5.
    fn layout() -> SourceLayout {
        let range = |first, count| SourceRange { first, count };
        let instance = |first_offset| InstanceSource { template: 0, first_offset: Some(first_offset) };
        SourceLayout {
            templates: CloudSize { len: 4, sh_degree: 0 },
            own: 5,
            background: CloudSize { len: 5, sh_degree: 0 },
            template_ranges: vec![range(0, 4)],
            instances: [0, 4, 8].map(instance).into(),
            own_ranges: vec![range(0, 2), range(2, 0), range(2, 3)],
            offsets: 12,
        }
    }

    #[test]
    fn what_is_behind_new_gaussians_moves_back() {
        let run = |first, count, shift| ShiftedRun { first, count, shift };
        let runs = |gains: &[u32]| Gains { by_instance: gains.into() }.shifted_runs(&layout());
        assert_eq!(runs(&[]), [run(0, 14, 0)]);
        assert_eq!(runs(&[0, 0, 0]), [run(0, 14, 0)]);
        assert_eq!(runs(&[1, 2, 0]), [run(0, 6, 0), run(6, 8, 3)]);
        assert_eq!(runs(&[0, 2, 7]), [run(0, 6, 0), run(6, 3, 2), run(9, 5, 9)]);
    }

    #[test]
    fn new_gaussians_come_behind_an_instances_own() {
        let gains = Gains { by_instance: vec![1, 0, 7] };
        let (after, _) = layout().after_moves(|i| i, &gains.by_instance);
        let places: Vec<_> =
            gains.inserted(&layout(), &after).iter().map(|own| (own.instance, own.first_new)).collect();
        assert_eq!(places, [(0, 4 + 2), (2, 4 + 3 + 3)]);
    }
}
