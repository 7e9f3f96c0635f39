//! How the arrays of a scene are divided: which source Gaussians a template has, and which template and offset records an
//! instance has. Training changes it when it adds or removes Gaussians.

use std::collections::{BTreeMap, BTreeSet};

use super::gaussians::Gaussians;
use super::instanced_scene::{Instance, InstancedScene, TemplateRange};
use super::parameters::{Owner, Parameter, Rows};

/// Number of Gaussians and SH degree of a cloud.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct CloudSize {
    /// Number of Gaussians.
    pub len: usize,
    /// SH degree.
    pub sh_degree: u32,
}

impl Parameter {
    /// Rows of templates and background, if source Gaussians own this parameter.
    pub fn source_rows(self, clouds: [CloudSize; 2]) -> Option<Rows> {
        match self.owner() {
            Owner::Source => Some(clouds.map(|cloud| cloud.len)),
            Owner::ShBand(l) => Some(clouds.map(|cloud| if cloud.sh_degree >= l { cloud.len } else { 0 })),
            Owner::Offset | Owner::Instance => None,
        }
    }
}

impl CloudSize {
    /// The size of a cloud.
    pub fn of(cloud: &Gaussians) -> Self {
        Self { len: cloud.len(), sh_degree: cloud.sh_degree }
    }
}

/// What an instance shows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct InstanceSource {
    /// Index of its template.
    pub template: u32,
    /// Index of its first offset record; `None` without offsets.
    pub first_offset: Option<u32>,
}

/// Sizes and ranges of the arrays of an [`InstancedScene`]. The source pool is the templates, then the background.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SourceLayout {
    /// All templates together.
    pub templates: CloudSize,
    /// The background.
    pub background: CloudSize,
    /// The source Gaussians of each template.
    pub template_ranges: Vec<TemplateRange>,
    /// What each instance shows, in file order.
    pub instances: Vec<InstanceSource>,
    /// Number of offset records.
    pub offsets: usize,
}

/// A run of offset records that moves because its template's Gaussians have moved. Instances that share a run before
/// share it afterwards.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct MovedRun {
    /// Index of its first record before.
    pub before: u32,
    /// Index of its first record afterwards.
    pub after: u32,
    /// The template of its instances.
    pub template: u32,
}

impl SourceLayout {
    /// The layout of a valid scene.
    pub fn of(scene: &InstancedScene) -> Self {
        let source =
            |instance: &Instance| InstanceSource { template: instance.template, first_offset: instance.first_offset };
        Self {
            templates: CloudSize::of(&scene.templates),
            background: CloudSize::of(&scene.background),
            template_ranges: scene.template_ranges.clone(),
            instances: scene.instances.iter().map(source).collect(),
            offsets: scene.offsets.len(),
        }
    }

    /// Number of source Gaussians: templates and background.
    pub fn source_count(&self) -> usize {
        self.templates.len + self.background.len
    }

    /// Gaussians after expanding all instances, the background included.
    pub fn expanded_len(&self) -> u64 {
        let of = |instance: &InstanceSource| u64::from(self.template_ranges[instance.template as usize].count);
        self.instances.iter().map(of).sum::<u64>() + self.background.len as u64
    }

    /// Indices of source Gaussians at which a template or the background begins or ends, ascending.
    pub fn boundaries(&self) -> Vec<u32> {
        let ends = [self.templates.len, self.source_count()].map(|end| end as u32);
        let of_ranges = self.template_ranges.iter().flat_map(|range| [range.first, range.first + range.count]);
        of_ranges.chain(ends).collect::<BTreeSet<u32>>().into_iter().collect()
    }

    /// The layout after source Gaussians were added and removed in place, and the offset records that move with them.
    /// `moved` maps each of the [`boundaries`](Self::boundaries) to its index afterwards.
    pub fn after_moves(&self, moved: impl Fn(u32) -> u32) -> (Self, Vec<MovedRun>) {
        let templates = moved(self.templates.len as u32) as usize;
        let range = |range: &TemplateRange| {
            let first = moved(range.first);
            TemplateRange { first, count: moved(range.first + range.count) - first }
        };
        let mut out = Self {
            templates: CloudSize { len: templates, ..self.templates },
            background: CloudSize { len: moved(self.source_count() as u32) as usize - templates, ..self.background },
            template_ranges: self.template_ranges.iter().map(range).collect(),
            ..self.clone()
        };
        let run = |instance: &InstanceSource| instance.first_offset.map(|first| (first, instance.template));
        let runs: BTreeSet<(u32, u32)> = self.instances.iter().filter_map(run).collect();
        let mut after = 0;
        let mut moves = Vec::with_capacity(runs.len());
        for (before, template) in runs {
            moves.push(MovedRun { before, after, template });
            after += out.template_ranges[template as usize].count;
        }
        out.offsets = after as usize;
        let placed: BTreeMap<(u32, u32), u32> =
            moves.iter().map(|moved| ((moved.before, moved.template), moved.after)).collect();
        for (instance, before) in out.instances.iter_mut().zip(&self.instances) {
            instance.first_offset = run(before).and_then(|run| placed.get(&run).copied());
        }
        (out, moves)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layout() -> SourceLayout {
        let source = |template, first_offset| InstanceSource { template, first_offset };
        SourceLayout {
            templates: CloudSize { len: 10, sh_degree: 1 },
            background: CloudSize { len: 5, sh_degree: 2 },
            // Gaussian 4 is in no template.
            template_ranges: vec![TemplateRange { first: 5, count: 5 }, TemplateRange { first: 0, count: 4 }],
            // The last two share their offsets.
            instances: vec![
                source(0, Some(4)),
                source(1, Some(0)),
                source(0, None),
                source(1, Some(9)),
                source(1, Some(9)),
            ],
            offsets: 13,
        }
    }

    #[test]
    fn boundaries_are_where_ranges_begin_and_end() {
        assert_eq!(layout().boundaries(), [0, 4, 5, 10, 15]);
        assert_eq!(layout().expanded_len(), 5 + 4 + 5 + 4 + 4 + 5);
    }

    #[test]
    fn ranges_and_runs_follow_what_moves() {
        // Every template Gaussian below 5 gets a copy, two of the second template vanish, and three of the background.
        let moved = |i: u32| match i {
            0..=5 => 2 * i,
            10 => 13,
            _ => 15,
        };
        let (after, runs) = layout().after_moves(moved);
        assert_eq!((after.templates.len, after.background.len), (13, 2));
        assert_eq!(
            after.template_ranges,
            [TemplateRange { first: 10, count: 3 }, TemplateRange { first: 0, count: 8 }]
        );
        assert_eq!(after.offsets, 8 + 3 + 8);
        let firsts: Vec<_> = after.instances.iter().map(|i| i.first_offset).collect();
        assert_eq!(firsts, [Some(8), Some(0), None, Some(11), Some(11)]);
        let runs: Vec<_> = runs.iter().map(|run| (run.before, run.after, run.template)).collect();
        assert_eq!(runs, [(0, 0, 1), (4, 8, 0), (9, 11, 1)]);
        assert_eq!(layout().after_moves(|i| i).0, layout());
    }
}
