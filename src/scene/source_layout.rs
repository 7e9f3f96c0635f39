//! How the arrays of a scene are divided: which source Gaussians a template has, and which template, own Gaussians and offset
//! records an instance has. Training changes it when it adds or removes Gaussians.

use std::collections::{BTreeMap, BTreeSet};

use super::gaussians::Gaussians;
use super::instanced_scene::{Instance, InstancedScene, SourceRange};
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
    /// Rows of posed Gaussians (templates, then instances' own) and background, if source Gaussians own this parameter.
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

/// Sizes and ranges of the arrays of an [`InstancedScene`]. The source pool is the templates, then instances' own Gaussians,
/// then the background.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct SourceLayout {
    /// All templates together.
    pub templates: CloudSize,
    /// Number of Gaussians that instances have of their own; their SH degree is that of the templates.
    pub own: usize,
    /// The background.
    pub background: CloudSize,
    /// The source Gaussians of each template.
    pub template_ranges: Vec<SourceRange>,
    /// What each instance shows, in file order.
    pub instances: Vec<InstanceSource>,
    /// By instance, its own Gaussians, by index among the own ones; empty if no instance has any.
    pub own_ranges: Vec<SourceRange>,
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
            own: scene.own.len(),
            background: CloudSize::of(&scene.background),
            template_ranges: scene.template_ranges.clone(),
            instances: scene.instances.iter().map(source).collect(),
            own_ranges: scene.own_ranges.clone(),
            offsets: scene.offsets.len(),
        }
    }

    /// Templates and instances' own Gaussians together: what moves with instances.
    pub fn posed(&self) -> CloudSize {
        CloudSize { len: self.templates.len + self.own, ..self.templates }
    }

    /// Number of source Gaussians: templates, instances' own, and background.
    pub fn source_count(&self) -> usize {
        self.posed().len + self.background.len
    }

    /// Indices of the own Gaussians of instance `k` in the source pool; empty if it has none.
    pub fn own_sources(&self, k: usize) -> SourceRange {
        let SourceRange { first, count } = self.own_ranges.get(k).copied().unwrap_or_default();
        SourceRange { first: self.templates.len as u32 + first, count }
    }

    /// For each instance, its first row in the device's instance table; then the background's row. An instance with own
    /// Gaussians has two rows.
    pub fn first_rows(&self) -> Vec<u32> {
        let mut rows = Vec::with_capacity(self.instances.len() + 1);
        let mut next = 0;
        for k in 0..self.instances.len() {
            rows.push(next);
            next += 1 + u32::from(self.own_sources(k).count > 0);
        }
        rows.push(next);
        rows
    }

    /// Gaussians after expanding all instances, the background included.
    pub fn expanded_len(&self) -> u64 {
        let of = |instance: &InstanceSource| u64::from(self.template_ranges[instance.template as usize].count);
        let own: u64 = self.own_ranges.iter().map(|range| u64::from(range.count)).sum();
        self.instances.iter().map(of).sum::<u64>() + own + self.background.len as u64
    }

    /// Indices of source Gaussians at which a template, an instance's own or the background begin or end, ascending.
    pub fn boundaries(&self) -> Vec<u32> {
        let ends = [self.templates.len, self.posed().len, self.source_count()].map(|end| end as u32);
        let own = (0..self.own_ranges.len()).map(|k| self.own_sources(k));
        let ranges = self.template_ranges.iter().copied().chain(own);
        let of_ranges = ranges.flat_map(|range| [range.first, range.first + range.count]);
        of_ranges.chain(ends).collect::<BTreeSet<u32>>().into_iter().collect()
    }

    /// The layout after source Gaussians were added and removed in place, and the offset records that move with them.
    /// `moved` maps each of the [`boundaries`](Self::boundaries) to its index afterwards; `more_own` has the number of
    /// Gaussians that each instance then gets behind its own, none if it is empty. Own Gaussians must be packed
    /// ([`InstancedScene::with_packed_own`]) and stay so.
    pub fn after_moves(&self, moved: impl Fn(u32) -> u32, more_own: &[u32]) -> (Self, Vec<MovedRun>) {
        let [templates, posed] = [self.templates.len, self.posed().len].map(|end| moved(end as u32) as usize);
        let mut own = 0;
        let mut own_range = |k: usize| {
            let before = self.own_sources(k);
            let kept = moved(before.first + before.count) - moved(before.first);
            let range = SourceRange { first: own, count: kept + more_own.get(k).copied().unwrap_or(0) };
            own += range.count;
            range
        };
        let own_ranges = (0..self.own_ranges.len()).map(&mut own_range).collect();
        let range = |range: &SourceRange| {
            let first = moved(range.first);
            SourceRange { first, count: moved(range.first + range.count) - first }
        };
        let mut out = Self {
            templates: CloudSize { len: templates, ..self.templates },
            own: own as usize,
            background: CloudSize { len: moved(self.source_count() as u32) as usize - posed, ..self.background },
            template_ranges: self.template_ranges.iter().map(range).collect(),
            own_ranges,
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
            template_ranges: vec![SourceRange { first: 5, count: 5 }, SourceRange { first: 0, count: 4 }],
            // The last two share their offsets.
            instances: vec![source(0, Some(4)), source(1, Some(0)), source(1, Some(9)), source(1, Some(9))],
            own: 6,
            own_ranges: [0, 2, 2, 3, 6].windows(2).map(|w| SourceRange { first: w[0], count: w[1] - w[0] }).collect(),
            offsets: 13,
        }
    }

    #[test]
    fn boundaries_are_where_ranges_begin_and_end() {
        assert_eq!(layout().boundaries(), [0, 4, 5, 10, 12, 13, 16, 21]);
        assert_eq!(layout().expanded_len(), (5 + 4 + 4 + 4) + 6 + 5);
    }

    #[test]
    fn instances_with_own_gaussians_have_two_rows() {
        assert_eq!(layout().first_rows(), [0, 2, 3, 5, 7]);
        assert_eq!(layout().own_sources(2), SourceRange { first: 12, count: 1 });
    }

    #[test]
    fn ranges_and_runs_follow_what_moves() {
        // Every template Gaussian below 5 gets a copy, two of the second template vanish, one of the last instance's own, and
        // three of the background. The second instance and the last get some of their own.
        let moved = |i: u32| match i {
            0..=5 => 2 * i,
            10..=13 => i + 3,
            16 => 18,
            _ => 20,
        };
        let (after, runs) = layout().after_moves(moved, &[0, 3, 0, 1]);
        assert_eq!((after.templates.len, after.own, after.background.len), (13, 5 + 4, 2));
        let own: Vec<_> = after.own_ranges.iter().map(|own| (own.first, own.count)).collect();
        assert_eq!(own, [(0, 2), (2, 3), (5, 1), (6, 3)]);
        assert_eq!(after.template_ranges, [SourceRange { first: 10, count: 3 }, SourceRange { first: 0, count: 8 }]);
        assert_eq!(after.offsets, 8 + 3 + 8);
        let firsts: Vec<_> = after.instances.iter().map(|i| i.first_offset).collect();
        assert_eq!(firsts, [Some(8), Some(0), Some(11), Some(11)]);
        let runs: Vec<_> = runs.iter().map(|run| (run.before, run.after, run.template)).collect();
        assert_eq!(runs, [(0, 0, 1), (4, 8, 0), (9, 11, 1)]);
        assert_eq!(layout().after_moves(|i| i, &[]).0, layout());
    }
}
