//! Template Gaussians that only one instance shows become that instance's own: they cost every other instance an offset record
//! and time, and show nothing there.

use crate::math::covariance::sigmoid;
use crate::scene::flatten::Local;
use crate::scene::gaussians::Gaussians;
use crate::scene::instanced_scene::{InstancedScene, SourceRange};

impl InstancedScene {
    /// Makes template Gaussians whose opacity, offset included, is at least `opacity_min` in exactly one of several instances
    /// that instance's own, in the template's order behind what it has; returns their number. Up to 1/255 pictures stay the
    /// same but for rounding in colour matrices. Templates that share Gaussians with others, or would have none left, are not
    /// changed.
    ///
    /// Instances no longer share own Gaussians afterwards. Unknown tensors parallel to Gaussians or records are dropped if any
    /// Gaussian moves.
    pub fn give_to_single_users(&mut self, opacity_min: f64) -> usize {
        let moves = self.single_users(opacity_min);
        let count = moves.iter().map(Vec::len).sum();
        if count == 0 {
            return 0;
        }
        let mut packed = self.with_packed_own().into_owned();
        packed.own_ranges.resize(packed.instances.len(), SourceRange::default());
        let mut own = Gaussians { sh_degree: packed.templates.sh_degree, ..Gaussians::default() };
        let mut keep = vec![true; packed.templates.len()];
        for (k, locals) in moves.iter().enumerate() {
            let range = packed.own_ranges[k];
            let first = own.len() as u32;
            range.indices().for_each(|i| own.push_from(&packed.own, i));
            for &local in locals {
                let (instance, matrix) = (&packed.instances[k], packed.color_matrix(k));
                Local::shown(&packed, instance, matrix, local).push_to(&mut own);
                keep[packed.source_of(k, local)] = false;
            }
            packed.own_ranges[k] = SourceRange { first, count: own.len() as u32 - first };
        }
        packed.own = own;
        packed.compact_templates(&keep);
        packed.drop_parallel_tensors();
        *self = packed;
        count
    }

    /// By instance, the positions in its template of Gaussians that it alone shows.
    fn single_users(&self, opacity_min: f64) -> Vec<Vec<usize>> {
        let mut out = vec![Vec::new(); self.instances.len()];
        for (t, range) in self.template_ranges.iter().enumerate() {
            let users: Vec<usize> =
                (0..self.instances.len()).filter(|&k| self.instances[k].template as usize == t).collect();
            if users.len() < 2 || self.shares_gaussians(t) {
                continue;
            }
            let single_user = |local: usize| {
                let mut shown = users.iter().copied().filter(|&k| self.opacity_in(k, local) >= opacity_min);
                shown.next().filter(|_| shown.next().is_none())
            };
            let moves: Vec<(usize, usize)> =
                (0..range.count as usize).filter_map(|local| Some((single_user(local)?, local))).collect();
            if moves.len() < range.count as usize {
                moves.into_iter().for_each(|(k, local)| out[k].push(local));
            }
        }
        out
    }

    fn source_of(&self, k: usize, local: usize) -> usize {
        self.template_ranges[self.instances[k].template as usize].first as usize + local
    }

    /// Opacity of a Gaussian of instance `k`'s template in that instance.
    fn opacity_in(&self, k: usize, local: usize) -> f64 {
        let offset = self.instances[k].first_offset.map_or(0.0, |m| self.offsets.opacity_logits[m as usize + local]);
        sigmoid(f64::from(self.templates.opacity_logits[self.source_of(k, local)] + offset))
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::math::similarity::Similarity;
    use crate::scene::instanced_scene::{Instance, SAME_COLOR};
    use crate::scene::offsets::Offsets;

    /// A template of four Gaussians in three instances: the first shows in all, the second in instance 2 alone, the third in
    /// none, the fourth in instances 0 and 1.
    fn scene() -> InstancedScene {
        let mut templates = Gaussians::with_capacity(1, 4);
        for i in 0..4 {
            templates.means.push([i as f32, 0.0, 0.5]);
            templates.quats.push([1.0, 0.1 * i as f32, 0.0, 0.0]);
            templates.log_scales.push([-2.0, -1.0, -3.0]);
            templates.opacity_logits.push([1.0, -8.0, -8.0, 1.0][i]);
            templates.sh.extend((0..4).map(|c| [0.1 * i as f32, 0.2 * c as f32, 0.3]));
        }
        let instance = |k: u32| Instance {
            template: 0,
            world_from_template: Similarity::from_parts(glam::DMat3::IDENTITY, 2.0, DVec3::X * f64::from(k)),
            first_offset: Some(4 * k),
        };
        let mut offsets = Offsets {
            means: (0..12).map(|m| [0.01 * m as f32, 0.0, 0.0]).collect(),
            sh_dc: (0..12).map(|m| [0.0, 0.02 * m as f32, 0.0]).collect(),
            opacity_logits: vec![0.0; 12],
            ..Offsets::default()
        };
        offsets.opacity_logits[8 + 1] = 9.0;
        offsets.opacity_logits[8 + 3] = -9.0;
        InstancedScene {
            own: templates.filtered(|i| i == 0),
            templates,
            template_ranges: vec![SourceRange { first: 0, count: 4 }],
            instances: (0..3).map(instance).collect(),
            own_ranges: [(0, 0), (0, 1), (0, 1)].map(|(first, count)| SourceRange { first, count }).into(),
            offsets,
            ..InstancedScene::default()
        }
    }

    #[test]
    fn what_one_instance_shows_becomes_its_own() {
        for colored in [false, true] {
            let mut scene = scene();
            if colored {
                scene.color_from_template = vec![SAME_COLOR.map(|row| row.map(|v| 0.5 * v + 0.1)); 3];
            }
            let before = scene.flatten();
            assert_eq!(scene.give_to_single_users(1.0 / 255.0), 1);
            scene.validate().unwrap();
            assert_eq!((scene.templates.len(), scene.offsets.len(), scene.own.len()), (3, 9, 3));
            let after = scene.flatten();
            // Instance 2 had its Gaussians from 9 on: 0, 1, 2, 3, own; now 0, 2, 3, own, 1.
            let order = [0, 2, 3, 4, 6, 7, 8, 9, 11, 12, 13, 10];
            assert_eq!(after.len(), order.len());
            for (j, i) in order.into_iter().enumerate() {
                assert_eq!(after.opacity_logits[j], before.opacity_logits[i]);
                let near = |(a, b): (&[f32; 3], &[f32; 3])| (0..3).all(|c| (a[c] - b[c]).abs() < 1e-6);
                assert!(near((&after.means[j], &before.means[i])), "{j}");
                assert!(after.sh_of(j).iter().zip(before.sh_of(i)).all(near), "{j}");
            }
            assert_eq!(scene.give_to_single_users(1.0 / 255.0), 0, "nothing is left to do");
        }
    }

    #[test]
    fn templates_that_share_gaussians_and_single_instances_stay() {
        let mut shared = scene();
        shared.template_ranges.push(SourceRange { first: 2, count: 1 });
        let mut alone = scene();
        (alone.instances, alone.own_ranges) = (vec![alone.instances[2].clone()], vec![alone.own_ranges[2]]);
        // The second instance shows nothing: the template must not become empty.
        let mut lone = scene();
        lone.instances.truncate(2);
        lone.own_ranges.truncate(2);
        lone.templates.opacity_logits.fill(1.0);
        lone.offsets.opacity_logits[4..8].fill(-9.0);
        for mut scene in [shared, alone, lone] {
            let before = scene.clone();
            assert_eq!(scene.give_to_single_users(1.0 / 255.0), 0);
            assert!(scene == before);
        }
    }
}
