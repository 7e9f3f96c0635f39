//! Which source Gaussian an offset record belongs to, and which instances share records.

use std::borrow::Cow;
use std::collections::BTreeMap;

use super::instanced_scene::InstancedScene;
use super::lod::{Cloud, Levels};
use super::offsets::Offsets;

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

    /// True if two instances share an offset record.
    pub fn shares_offsets(&self) -> bool {
        let mut runs = self.offset_runs();
        runs.retain(|run| run.count > 0);
        runs.sort_by_key(|run| run.first_offset);
        let end = |run: &OffsetRun| u64::from(run.first_offset) + u64::from(run.count);
        runs.windows(2).any(|two| end(&two[0]) > two[1].first_offset.into())
    }

    /// The same scene with a run of offset records for each instance that has offsets, in the order of instances, and
    /// without unused ones; borrowed if no two instances share a record. Of the instances of one run at most `most_users`,
    /// the first, keep their offsets: each takes memory of its own.
    pub fn with_unshared_offsets(&self, most_users: usize) -> Cow<'_, Self> {
        if !self.shares_offsets() {
            return Cow::Borrowed(self);
        }
        let mut out = Self { offsets: Offsets::default(), ..self.clone() };
        let mut users: BTreeMap<(u32, u32), usize> = BTreeMap::new();
        for instance in &mut out.instances {
            let Some(first) = instance.first_offset else { continue };
            let users = users.entry((instance.template, first)).or_default();
            *users += 1;
            if *users > most_users {
                instance.first_offset = None;
                continue;
            }
            instance.first_offset = Some(out.offsets.len() as u32);
            let count = self.template_ranges[instance.template as usize].count;
            (first..first + count).for_each(|record| out.offsets.push_from(&self.offsets, record as usize));
        }
        out.drop_parallel_tensors();
        Cow::Owned(out)
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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::similarity::Similarity;
    use crate::scene::{Instance, SourceRange};

    #[test]
    fn instances_get_records_of_their_own() {
        let instance = |first_offset| Instance { template: 0, world_from_template: Similarity::IDENTITY, first_offset };
        let means: Vec<[f32; 3]> = (0..5).map(|i| [i as f32; 3]).collect();
        let offsets = Offsets { means, sh_dc: vec![[0.0; 3]; 5], opacity_logits: vec![0.0; 5], ..Offsets::default() };
        let scene = InstancedScene {
            template_ranges: vec![SourceRange { first: 0, count: 2 }],
            instances: [Some(3), None, Some(1), Some(3), Some(3)].map(instance).into(),
            offsets,
            ..InstancedScene::default()
        };
        assert!(scene.shares_offsets());
        let firsts = |scene: &InstancedScene| scene.instances.iter().map(|i| i.first_offset).collect::<Vec<_>>();
        let unshared = scene.with_unshared_offsets(2);
        assert_eq!(firsts(&unshared), [Some(0), None, Some(2), Some(4), None]);
        assert_eq!(unshared.offsets.means.iter().map(|m| m[0]).collect::<Vec<_>>(), [3.0, 4.0, 1.0, 2.0, 3.0, 4.0]);
        assert!(!unshared.shares_offsets() && unshared.offsets.opacity_logits.len() == 6);
        assert_eq!(firsts(&scene.with_unshared_offsets(usize::MAX))[4], Some(6));
        // Neighbours share nothing, and then nothing changes: not even what nobody uses goes.
        let apart = InstancedScene { instances: [Some(1), Some(3)].map(instance).into(), ..scene.clone() };
        assert!(!apart.shares_offsets() && matches!(apart.with_unshared_offsets(1), Cow::Borrowed(_)));
        let overlapping = InstancedScene { instances: [Some(2), Some(3)].map(instance).into(), ..scene };
        assert!(overlapping.shares_offsets());
    }
}
