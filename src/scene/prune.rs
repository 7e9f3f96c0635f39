//! Removing Gaussians from a scene while offsets stay aligned with templates.

use std::collections::BTreeMap;

use crate::math::covariance::sigmoid;
use crate::scene::gaussians::Gaussians;
use crate::scene::instanced_scene::{InstancedScene, SourceRange};
use crate::scene::offsets::Offsets;

impl InstancedScene {
    /// Removes non-finite Gaussians from a consistent scene; returns the number of removed Gaussians of templates, instances'
    /// own, and background. A template Gaussian is removed from all instances if it or its offset record in any instance is not
    /// finite. A finite scene is not changed.
    pub fn drop_non_finite(&mut self) -> usize {
        let dropped = self.background.drop_non_finite() + self.keep_own(|own, i| own.is_finite(i));
        let mut keep: Vec<bool> = (0..self.templates.len()).map(|i| self.templates.is_finite(i)).collect();
        for instance in &self.instances {
            let range = self.template_ranges[instance.template as usize];
            if let Some(first) = instance.first_offset {
                for j in 0..range.count as usize {
                    keep[range.first as usize + j] &= self.offsets.is_finite(first as usize + j);
                }
            }
        }
        self.keep_templates(&keep, dropped)
    }

    /// Removes template Gaussians whose opacity, offset included, is below `opacity_min` in every instance of every template
    /// that has them, and own and background Gaussians of lower opacity; returns their number. Up to 1/255 no picture changes:
    /// blending skips them. Templates without instances are not changed.
    pub fn prune_transparent(&mut self, opacity_min: f64) -> usize {
        // Written as >=, so that NaN counts as transparent.
        let seen = |logit: f32| sigmoid(f64::from(logit)) >= opacity_min;
        let mut keep = vec![true; self.templates.len()];
        self.template_ranges.iter().for_each(|range| keep[range.indices()].fill(false));
        // Templates may share Gaussians: these stay if they have to in any of them.
        for (t, range) in self.template_ranges.iter().enumerate() {
            let users: Vec<_> = self.instances.iter().filter(|i| i.template as usize == t).collect();
            for (j, keep) in keep[range.indices()].iter_mut().enumerate() {
                let logit = self.templates.opacity_logits[range.first as usize + j];
                let offset = |first: u32| self.offsets.opacity_logits[first as usize + j];
                let is_seen = || users.iter().any(|i| seen(logit + i.first_offset.map_or(0.0, offset)));
                *keep |= users.is_empty() || is_seen();
            }
        }
        let before = self.background.len();
        if !self.background.opacity_logits.iter().all(|&logit| seen(logit)) {
            self.background = self.background.filtered(|i| seen(self.background.opacity_logits[i]));
        }
        let of_own = self.keep_own(|own, i| seen(own.opacity_logits[i]));
        self.keep_templates(&keep, of_own + before - self.background.len())
    }

    /// Keeps the own Gaussians of instances that satisfy a condition; returns the number removed.
    pub(super) fn keep_own(&mut self, stays: impl Fn(&Gaussians, usize) -> bool) -> usize {
        let kept_before = counts_before((0..self.own.len()).map(|i| stays(&self.own, i)));
        let left = kept_before[self.own.len()];
        let dropped = self.own.len() - left as usize;
        if dropped > 0 {
            self.own = self.own.filtered(|i| kept_before[i] < kept_before[i + 1]);
            self.own_ranges.iter_mut().for_each(|range| *range = range.compacted(&kept_before));
        }
        dropped
    }

    /// Keeps the marked template Gaussians with their offset records; returns the number removed, including those that
    /// were removed elsewhere. If there are any, unknown tensors parallel to these arrays are dropped: they would no longer
    /// be aligned.
    pub(super) fn keep_templates(&mut self, keep: &[bool], dropped_elsewhere: usize) -> usize {
        let dropped = keep.iter().filter(|&&k| !k).count();
        if dropped > 0 {
            self.compact_templates(keep);
        }
        if dropped + dropped_elsewhere > 0 {
            self.drop_parallel_tensors();
        }
        dropped + dropped_elsewhere
    }

    /// Drops unknown tensors that are parallel to Gaussians or offset records, for when those have changed their places.
    pub fn drop_parallel_tensors(&mut self) {
        let follows = |name: &str| ["offset.", "template.", "own.", "background."].iter().any(|p| name.starts_with(p));
        self.foreign_tensors.retain(|name, _| !follows(name));
    }

    /// Removes the template Gaussians that are not marked, with their offset records.
    pub(super) fn compact_templates(&mut self, keep: &[bool]) {
        let kept_before = counts_before(keep.iter().copied());
        let mut offsets = Offsets::default();
        // Instances may share a run of records, which moves once.
        let mut moved = BTreeMap::new();
        for instance in &mut self.instances {
            let SourceRange { first: range_first, count } = self.template_ranges[instance.template as usize];
            let Some(first) = instance.first_offset else { continue };
            let new_first = *moved.entry((first, range_first, count)).or_insert_with(|| {
                let new_first = offsets.len() as u32;
                let kept = (0..count as usize).filter(|j| keep[range_first as usize + j]);
                kept.for_each(|j| offsets.push_from(&self.offsets, first as usize + j));
                new_first
            });
            instance.first_offset = Some(new_first);
        }
        self.offsets = offsets;
        self.template_ranges.iter_mut().for_each(|range| *range = range.compacted(&kept_before));
        self.templates = self.templates.filtered(|i| keep[i]);
    }
}

/// For every element, the number of marked ones before it; and the number of all marked ones.
fn counts_before(marks: impl Iterator<Item = bool>) -> Vec<u32> {
    let mut out = vec![0];
    let mut count = 0;
    marks.for_each(|marked| {
        count += u32::from(marked);
        out.push(count);
    });
    out
}

impl SourceRange {
    /// The same range after only some elements were kept, of which `kept_before` has the number before each.
    fn compacted(self, kept_before: &[u32]) -> Self {
        let (first, end) = (kept_before[self.first as usize], kept_before[(self.first + self.count) as usize]);
        Self { first, count: end - first }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::similarity::Similarity;
    use crate::scene::gaussians::Gaussians;
    use crate::scene::instanced_scene::Instance;

    fn cloud(logits: &[f32]) -> Gaussians {
        let mut out = Gaussians::with_capacity(0, logits.len());
        for (i, &logit) in logits.iter().enumerate() {
            out.means.push([i as f32; 3]);
            out.quats.push([1.0, 0.0, 0.0, 0.0]);
            out.log_scales.push([0.0; 3]);
            out.opacity_logits.push(logit);
            out.sh.push([0.5; 3]);
        }
        out
    }

    /// Templates 0..3 and 3..5, instances (0, offsets 0), (1, none), (0, offsets 3), (1, offsets 6).
    fn sample() -> InstancedScene {
        let instance =
            |template, first_offset| Instance { template, world_from_template: Similarity::IDENTITY, first_offset };
        let offsets = cloud(&[0.0, 0.0, -9.0, 0.0, 0.0, -9.0, 0.0, 9.0]);
        InstancedScene {
            templates: cloud(&[1.0, -9.0, 0.0, 1.0, -9.0]),
            template_ranges: vec![SourceRange { first: 0, count: 3 }, SourceRange { first: 3, count: 2 }],
            instances: vec![instance(0, Some(0)), instance(1, None), instance(0, Some(3)), instance(1, Some(6))],
            offsets: Offsets {
                means: offsets.means,
                sh_dc: offsets.sh,
                opacity_logits: offsets.opacity_logits,
                sh_rest: Vec::new(),
                log_scales: offsets.log_scales,
                quats: offsets.quats,
            },
            background: cloud(&[-9.0, 2.0, 2.0, 2.0]),
            ..InstancedScene::default()
        }
    }

    #[test]
    fn drops_keep_offsets_aligned() -> Result<(), Box<dyn std::error::Error>> {
        let mut scene = sample();
        assert_eq!(scene.drop_non_finite(), 0);
        assert_eq!(scene, sample());
        scene.templates.means[0][1] = f32::NAN;
        scene.offsets.log_scales[4][1] = f32::INFINITY;
        scene.background.log_scales[1][0] = f32::NAN;
        assert_eq!(scene.drop_non_finite(), 3);
        scene.validate()?;
        assert_eq!(scene.template_ranges, [SourceRange { first: 0, count: 1 }, SourceRange { first: 1, count: 2 }]);
        assert_eq!(scene.templates.means, sample().templates.means[2..]);
        let firsts: Vec<_> = scene.instances.iter().map(|i| i.first_offset).collect();
        assert_eq!(firsts, [Some(0), None, Some(1), Some(2)]);
        let want: Vec<_> = [2, 5, 6, 7].iter().map(|&m: &usize| sample().offsets.means[m]).collect();
        assert_eq!((scene.offsets.means, scene.offsets.quats.len()), (want, 4));
        Ok(())
    }

    /// Gaussian 1 is transparent in all instances, 2 in both of its instances; 4 is visible in one.
    #[test]
    fn what_no_instance_shows_is_removed() -> Result<(), Box<dyn std::error::Error>> {
        let mut scene = sample();
        let seen = |scene: &InstancedScene| {
            let flat = scene.flatten();
            flat.filtered(|i| flat.opacity_logits[i] > -6.0)
        };
        assert_eq!(scene.prune_transparent(0.003), 3);
        scene.validate()?;
        assert_eq!(scene.templates.means, [[0.0; 3], [3.0; 3], [4.0; 3]]);
        assert_eq!((scene.background.len(), scene.offsets.len()), (3, 4));
        assert_eq!(seen(&scene), seen(&sample()));
        // NaN is transparent; a template without instances stays.
        scene.background.opacity_logits[0] = f32::NAN;
        scene.instances.clear();
        assert_eq!(scene.prune_transparent(0.003), 1);
        assert_eq!(scene.templates.len(), 3);
        Ok(())
    }

    /// Gaussian 2 is transparent in all instances of one template, and visible in those of the other, in either order.
    #[test]
    fn what_another_template_shows_stays() -> Result<(), Box<dyn std::error::Error>> {
        for swapped in [false, true] {
            let mut scene = sample();
            scene.template_ranges[1] = SourceRange { first: 2, count: 2 };
            if swapped {
                scene.template_ranges.swap(0, 1);
                scene.instances.iter_mut().for_each(|instance| instance.template = 1 - instance.template);
            }
            let mut unused = scene.clone();
            unused.instances.retain(|instance| scene.template_ranges[instance.template as usize].first == 0);
            for mut scene in [scene, unused] {
                assert_eq!(scene.prune_transparent(0.003), 2, "Gaussian 1 and one of the background");
                scene.validate()?;
                assert_eq!(scene.templates.means, [[0.0; 3], [2.0; 3], [3.0; 3], [4.0; 3]]);
            }
        }
        Ok(())
    }
}
