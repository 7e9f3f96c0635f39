//! Unions of a group's objects: for each object, the surface of all others together.

use std::cmp::Reverse;

use glam::DVec3;
use rayon::prelude::*;

use super::sample::FINE;
use super::surface::{Sample, Surface};
use super::together::Member;

/// Number of objects in a union at most: those seen best. More add nothing.
const MOST_MODELS: usize = 8;

/// For each object of a group, the union of all others, in the group's frame.
pub(super) struct Unions {
    /// Place of each object when they are in order of how well they were seen.
    rank: Vec<usize>,
    /// Without the object of each rank. All objects that are not among the best are left out of the same union, the last.
    without: Vec<Option<Surface>>,
}

impl Unions {
    /// The unions of `members` at their poses. `points` gives the points of a member in its local frame.
    pub(super) fn new(members: &[Member<'_>], points: impl Fn(usize) -> Vec<Sample> + Sync) -> Self {
        let mut order: Vec<usize> = (0..members.len()).collect();
        order.sort_by_key(|&i| (Reverse(members[i].surface.gaussians), i));
        let mut rank = vec![0; members.len()];
        order.iter().enumerate().for_each(|(place, &i)| rank[i] = place);
        // One more than a union holds: it takes the place of one that is left out.
        order.truncate(MOST_MODELS + 1);
        let in_group = |&i: &usize| -> Vec<Sample> {
            let pose = members[i].pose;
            let sample = |s: Sample| Sample {
                position: pose.apply_inverse(s.position),
                normal: pose.rotation.transpose() * s.normal,
                color: s.color,
            };
            points(i).into_iter().map(sample).collect()
        };
        let placed: Vec<Vec<Sample>> = order.par_iter().map(in_group).collect();
        let without = |out: usize| -> Option<Surface> {
            let others: Vec<usize> = (0..order.len()).filter(|&place| place != out).take(MOST_MODELS).collect();
            let best = members[order[*others.first()?]];
            let samples: Vec<Sample> = others.iter().flat_map(|&place| &placed[place]).copied().collect();
            let mut union = Surface::new(&samples, best.surface.levels[FINE].voxel / best.pose.scale);
            union.normals.iter_mut().for_each(|n| *n = n.normalize_or(DVec3::Z));
            Some(union)
        };
        let without = (0..order.len()).into_par_iter().map(without).collect();
        Self { rank, without }
    }

    /// The unions of all points of the members.
    pub(super) fn of_all(members: &[Member<'_>]) -> Self {
        Self::new(members, |i| members[i].surface.levels[FINE].samples())
    }

    /// The union of all objects but the k-th; `None` if there is no other.
    pub(super) fn without(&self, k: usize) -> Option<&Surface> {
        self.without[self.rank[k].min(self.without.len() - 1)].as_ref()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::register::options::RegisterOptions;
    use crate::register::pose::Pose;
    use crate::register::sample::ObjectSurface;
    use instgs_vk::math::rng::Rng;
    use instgs_vk::scene::Gaussians;

    /// An object of so many Gaussians on a sphere of radius 1 about the origin.
    fn ball(id: u32, count: usize) -> ObjectSurface {
        let mut cloud = Gaussians::with_capacity(0, 0);
        let mut rng = Rng::new(u64::from(id));
        for _ in 0..count {
            cloud.means.push(rng.unit_vector().as_vec3().to_array());
            cloud.quats.push([1.0, 0.0, 0.0, 0.0]);
            cloud.log_scales.push([-3.0; 3]);
            cloud.opacity_logits.push(3.0);
            cloud.sh.push([0.3, 0.0, -0.2]);
        }
        let all: Vec<u32> = (0..count as u32).collect();
        ObjectSurface::new(id, &all, &cloud, &[], &RegisterOptions::default()).unwrap()
    }

    /// Objects stand at x = 10, 20, ... in the group's frame: the points of a union show whose they are.
    #[test]
    fn a_union_has_the_best_of_the_others() {
        for count in [1, 2, 8, 9, 12] {
            // The later, the better seen.
            let surfaces: Vec<ObjectSurface> = (0..count).map(|i| ball(i as u32 + 1, 200 + 10 * i)).collect();
            let place = |i: usize| DVec3::X * (10.0 * (i + 1) as f64);
            let member = |(i, surface)| Member { surface, pose: Pose { translation: -place(i), ..Pose::IDENTITY } };
            let members: Vec<Member<'_>> = surfaces.iter().enumerate().map(member).collect();
            let unions = Unions::of_all(&members);
            for k in 0..count {
                let mut want: Vec<usize> = (0..count).rev().filter(|&i| i != k).take(MOST_MODELS).collect();
                want.sort_unstable();
                let mut found: Vec<usize> = unions.without(k).map_or(Vec::new(), |union| {
                    union.positions.iter().map(|p| (p.x / 10.0).round() as usize - 1).collect()
                });
                found.sort_unstable();
                found.dedup();
                assert_eq!(found, want, "without {k} of {count}");
            }
        }
    }
}
