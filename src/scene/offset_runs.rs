//! Which source Gaussian an offset record belongs to.

use super::instanced_scene::InstancedScene;
use super::lod::{Cloud, Levels};

/// The offset records of an instance, or of a level of it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct OffsetRun {
    /// Index of the first of its Gaussians among those of the templates.
    pub first_source: u32,
    /// Index of its first record.
    pub first_offset: u32,
    /// Number of Gaussians, and of records.
    pub count: u32,
}

impl InstancedScene {
    /// The runs of all instances that have offsets; copies of an instance may share one.
    pub fn offset_runs(&self) -> Vec<OffsetRun> {
        let with_offsets = self.instances.iter().filter_map(|instance| Some((instance, instance.first_offset?)));
        let run = |(instance, first_offset): (&super::Instance, u32)| {
            let range = self.template_ranges[instance.template as usize];
            OffsetRun { first_source: range.first, first_offset, count: range.count }
        };
        with_offsets.map(run).collect()
    }
}

impl Levels {
    /// The runs of all parts that have offsets.
    pub fn offset_runs(&self) -> Vec<OffsetRun> {
        let of_templates = self.parts.iter().filter(|part| part.cloud == Cloud::Templates);
        let run = |part: &super::lod::Part| {
            let (range, first_offset) = (part.range, part.first_offset?);
            Some(OffsetRun { first_source: range.first, first_offset, count: range.count })
        };
        of_templates.filter_map(run).collect()
    }
}

/// By offset record, of which there are `records`, the Gaussian of the templates that it belongs to, and whether one belongs
/// to several.
pub fn sources_of_records(runs: &[OffsetRun], records: usize) -> (Vec<Option<u32>>, bool) {
    let mut sources = vec![None; records];
    let mut several = false;
    for run in runs {
        for local in 0..run.count {
            let source = &mut sources[(run.first_offset + local) as usize];
            several |= source.is_some_and(|source| source != run.first_source + local);
            *source = Some(run.first_source + local);
        }
    }
    (sources, several)
}
