//! The background of the joined scene: each block's where it owns the ground, without what shows an object that another block
//! has and this one does not know.

use glam::DVec3;
use instgs_vk::math::nearest::PointSet;
use instgs_vk::math::sh::widened;
use instgs_vk::scene::{Gaussians, InstancedScene};

use super::objects::{BlockObject, KeptObject};
use crate::plan::Plan;

/// What is kept of one block's background.
pub(super) struct BlockBackground {
    /// The Gaussians.
    pub gaussians: Gaussians,
    /// Number of Gaussians outside of the cell.
    pub outside: usize,
    /// Number of Gaussians in the cell that show another block's object.
    pub covered: usize,
}

/// By block, its background in the joined scene.
pub(super) fn background(
    plan: &Plan,
    scenes: &[InstancedScene],
    found: &[BlockObject],
    kept: &[KeptObject],
) -> Vec<BlockBackground> {
    let mut stays: Vec<Vec<bool>> = Vec::new();
    for (scene, block) in scenes.iter().zip(&plan.blocks) {
        stays.push(scene.background.means.iter().map(|&m| block.cell.owns(plan.ground.flat(widened(m)))).collect());
    }
    let owned: Vec<usize> = stays.iter().map(|of| of.iter().filter(|&&s| s).count()).collect();
    for one in kept {
        let object = &found[one.object];
        let others: Vec<usize> = (0..scenes.len()).filter(|b| !one.blocks.contains(b)).collect();
        let shown = scenes[object.block].flatten_one(object.instance);
        let is_within = |b: &usize| {
            let cell = plan.blocks[*b].cell;
            shown.means.iter().all(|&mean| cell.owns(plan.ground.flat(widened(mean))))
        };
        // Most objects: the ground below them is all of blocks that know them.
        if one.blocks.iter().any(is_within) {
            continue;
        }
        let reach = Reach::of(&shown);
        let touched: Vec<usize> =
            others.into_iter().filter(|&b| reach.holds_any(&scenes[b].background, &stays[b])).collect();
        if touched.is_empty() {
            continue;
        }
        let rivals = Rivals::new(&shown, &scenes[object.block].background, &reach);
        for b in touched {
            for (stays, &mean) in stays[b].iter_mut().zip(&scenes[b].background.means) {
                if *stays && reach.holds(widened(mean)) && rivals.is_object(mean) {
                    *stays = false;
                }
            }
        }
    }
    let of_block = |((scene, stays), owned): ((&InstancedScene, &Vec<bool>), usize)| {
        let gaussians = scene.background.filtered(|i| stays[i]);
        BlockBackground { outside: scene.background.len() - owned, covered: owned - gaussians.len(), gaussians }
    };
    scenes.iter().zip(&stays).zip(owned).map(of_block).collect()
}

/// The bounding box of an object's means, world frame.
struct Reach {
    low: DVec3,
    high: DVec3,
}

impl Reach {
    fn of(shown: &Gaussians) -> Self {
        let means = || shown.means.iter().map(|&mean| widened(mean));
        Self { low: means().fold(DVec3::INFINITY, DVec3::min), high: means().fold(DVec3::NEG_INFINITY, DVec3::max) }
    }

    fn holds(&self, at: DVec3) -> bool {
        at.cmpge(self.low).all() && at.cmple(self.high).all()
    }

    fn holds_any(&self, cloud: &Gaussians, stays: &[bool]) -> bool {
        cloud.means.iter().zip(stays).any(|(&mean, &stays)| stays && self.holds(widened(mean)))
    }
}

/// An object's Gaussians and those of the background around it, in the block that knows the object: whichever is nearer to a
/// Gaussian of another block says what that one shows.
struct Rivals {
    object: PointSet,
    around: PointSet,
}

impl Rivals {
    fn new(shown: &Gaussians, background: &Gaussians, reach: &Reach) -> Self {
        let size = reach.high - reach.low;
        let wide = Reach { low: reach.low - 0.25 * size, high: reach.high + 0.25 * size };
        let near: Vec<[f32; 3]> = background.means.iter().copied().filter(|&m| wide.holds(widened(m))).collect();
        Self { object: PointSet::new(&shown.means), around: PointSet::new(&near) }
    }

    fn is_object(&self, mean: [f32; 3]) -> bool {
        self.object.distance(mean) < self.around.distance(mean)
    }
}
