//! Which objects of the blocks are in the joined scene: each place has one.

use glam::DVec3;
use instgs_vk::math::covariance::sigmoid;
use instgs_vk::math::sh::widened;
use instgs_vk::scene::{Gaussians, InstancedScene};

use crate::plan::Plan;

/// Two objects of different blocks whose centres are nearer than this part of the smaller one's radius are one.
const SAME_PLACE: f64 = 0.6;

/// An object of a block, in or near its cell.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct BlockObject {
    /// Index of the block.
    pub block: usize,
    /// Index of the instance in the block's scene.
    pub instance: usize,
    /// Mean of its Gaussians, by opacity; world frame.
    pub centre: DVec3,
    /// Root mean square distance of its Gaussians from the centre, by opacity; scene units.
    pub radius: f64,
    /// How far the centre lies within the block's cell, scene units; negative outside.
    pub depth: f64,
}

/// An object of the joined scene.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct KeptObject {
    /// Index among the candidates.
    pub object: usize,
    /// Blocks that have it, that of `object` included.
    pub blocks: Vec<usize>,
}

/// The objects of all blocks whose centres lie in their block's cell or its margin, by block and instance. Those that may be the
/// same object as one in the cell count, too: without a margin, two blocks may each see the centre of an object on the cut in the
/// other's cell.
pub(super) fn candidates(plan: &Plan, scenes: &[InstancedScene]) -> Vec<BlockObject> {
    let mut out = Vec::new();
    for (block, (scene, planned)) in scenes.iter().zip(&plan.blocks).enumerate() {
        let grown = planned.cell.grown(planned.margin);
        for instance in 0..scene.instances.len() {
            let (centre, radius) = middle(&scene.flatten_one(instance));
            let at = plan.ground.flat(centre);
            let depth = planned.cell.depth(at);
            if grown.owns(at) || depth >= -SAME_PLACE * radius {
                out.push(BlockObject { block, instance, centre, radius, depth });
            }
        }
    }
    out
}

/// Mean of a cloud's means weighted by opacity, and root mean square distance from it.
fn middle(cloud: &Gaussians) -> (DVec3, f64) {
    let weighted = || cloud.means.iter().zip(&cloud.opacity_logits).map(|(&m, &o)| (widened(m), sigmoid(f64::from(o))));
    let total: f64 = weighted().map(|(_, weight)| weight).sum::<f64>().max(f64::MIN_POSITIVE);
    let centre = weighted().map(|(mean, weight)| mean * weight).sum::<DVec3>() / total;
    let squares: f64 = weighted().map(|(mean, weight)| weight * mean.distance_squared(centre)).sum();
    (centre, (squares / total).sqrt())
}

/// One object per place: the one deepest in its block's cell. In the order of blocks and instances.
pub(super) fn each_once(found: &[BlockObject]) -> Vec<KeptObject> {
    let mut order: Vec<usize> = (0..found.len()).collect();
    order.sort_by(|&a, &b| found[b].depth.total_cmp(&found[a].depth).then(a.cmp(&b)));
    let mut kept: Vec<KeptObject> = Vec::new();
    for object in order {
        let same = |other: &KeptObject| {
            let (a, b) = (&found[object], &found[other.object]);
            // A block has found each of its objects once: of two, only one can be the same as another block's.
            !other.blocks.contains(&a.block) && a.centre.distance(b.centre) < SAME_PLACE * a.radius.min(b.radius)
        };
        match kept.iter_mut().find(|other| same(other)) {
            Some(other) => other.blocks.push(found[object].block),
            None => kept.push(KeptObject { object, blocks: vec![found[object].block] }),
        }
    }
    kept.sort_by_key(|one| one.object);
    kept
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Cell;
    use crate::plan::on_level_ground;
    use glam::DMat3;
    use instgs_vk::math::similarity::Similarity;
    use instgs_vk::scene::{Instance, SourceRange};

    fn object(block: usize, instance: usize, x: f64, depth: f64) -> BlockObject {
        BlockObject { block, instance, centre: DVec3::X * x, radius: 1.0, depth }
    }

    #[test]
    fn of_two_at_one_place_the_deeper_one_stays() {
        let found = [
            object(0, 0, 0.0, 5.0),
            object(0, 1, 4.9, 0.1),
            object(1, 0, 5.1, 0.3),
            object(1, 1, 9.0, 4.0),
            // Of one block, however near they are: two objects.
            object(1, 2, 9.2, 4.0),
            // Only this block has it, though it is beyond its cell.
            object(1, 3, 3.0, -0.5),
        ];
        let kept = each_once(&found);
        let objects: Vec<usize> = kept.iter().map(|one| one.object).collect();
        assert_eq!(objects, [0, 2, 3, 4, 5]);
        assert_eq!(kept[1].blocks, [1, 0]);
        assert_eq!(kept[0].blocks, [0]);
    }

    /// Without a margin both blocks see an object on the cut with its centre just beyond their own cell.
    #[test]
    fn an_object_on_a_cut_without_margin_stays_once() {
        let plan = on_level_ground(Cell::default().cut(0, 0.0), [0.0; 2]);
        // Two Gaussians a unit to the left and right of the centre: the radius is 1.
        let scene = |centres: &[f64]| {
            let mut templates = Gaussians::with_capacity(0, 2);
            for x in [-1.0, 1.0] {
                templates.means.push([x, 0.0, 0.0]);
                templates.quats.push([1.0, 0.0, 0.0, 0.0]);
                templates.log_scales.push([-3.0; 3]);
                templates.opacity_logits.push(2.0);
                templates.sh.push([0.0; 3]);
            }
            let instance = |&x: &f64| Instance {
                template: 0,
                world_from_template: Similarity::from_parts(DMat3::IDENTITY, 1.0, DVec3::X * x),
                first_offset: None,
            };
            InstancedScene {
                templates,
                template_ranges: vec![SourceRange { first: 0, count: 2 }],
                instances: centres.iter().map(instance).collect(),
                ..InstancedScene::default()
            }
        };
        let found = candidates(&plan, &[scene(&[0.1, 2.0, -5.0]), scene(&[-0.1, 5.0])]);
        let at: Vec<(usize, usize)> = found.iter().map(|object| (object.block, object.instance)).collect();
        // That at 2 is far beyond the cell of its block.
        assert_eq!(at, [(0, 0), (0, 2), (1, 0), (1, 1)]);
        let kept = each_once(&found);
        let on_the_cut: Vec<&KeptObject> = kept.iter().filter(|one| one.blocks.len() == 2).collect();
        assert_eq!((kept.len(), on_the_cut.len()), (3, 1));
    }

    #[test]
    fn the_middle_is_that_of_what_shows() {
        let mut cloud = Gaussians::with_capacity(0, 3);
        for (x, logit) in [(-1.0, 5.0), (1.0, 5.0), (100.0, -30.0)] {
            cloud.means.push([x, 0.0, 0.0]);
            cloud.opacity_logits.push(logit);
        }
        let (centre, radius) = middle(&cloud);
        assert!(centre.length() < 1e-6 && (radius - 1.0).abs() < 1e-6, "{centre} {radius}");
    }
}
