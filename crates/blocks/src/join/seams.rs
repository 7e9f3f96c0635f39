//! The background of the joined scene: each block's where it owns the ground, without what shows an object that another block
//! has and this one does not know.

use glam::DVec3;
use instgs_vk::math::nearest::PointSet;
use instgs_vk::math::sh::widened;
use instgs_vk::scene::{Gaussians, InstancedScene};
use rayon::prelude::*;

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
    // By block, once it is needed.
    let mut boxes: Vec<Option<Vec<Reach>>> = vec![None; scenes.len()];
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
        let scene = &scenes[object.block];
        let boxes = boxes[object.block].get_or_insert_with(|| Reach::of_instances(scene));
        let rivals = Rivals::new(&shown, &around(scene, object.instance, boxes));
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

/// Means of what a block's scene has around its instance `k`: its background, and its other instances. `boxes` are those of all
/// instances.
fn around(scene: &InstancedScene, k: usize, boxes: &[Reach]) -> Vec<[f32; 3]> {
    let wide = boxes[k].wider();
    let is_near = |mean: &[f32; 3]| wide.holds(widened(*mean));
    let mut near: Vec<[f32; 3]> = scene.background.means.iter().copied().filter(is_near).collect();
    for other in (0..boxes.len()).filter(|&other| other != k && boxes[other].meets(&wide)) {
        near.extend(scene.flatten_one(other).means.into_iter().filter(is_near));
    }
    near
}

/// The bounding box of an object's means, world frame.
#[derive(Clone, Copy)]
struct Reach {
    low: DVec3,
    high: DVec3,
}

impl Reach {
    fn of(shown: &Gaussians) -> Self {
        let means = || shown.means.iter().map(|&mean| widened(mean));
        Self { low: means().fold(DVec3::INFINITY, DVec3::min), high: means().fold(DVec3::NEG_INFINITY, DVec3::max) }
    }

    /// By instance of a scene.
    fn of_instances(scene: &InstancedScene) -> Vec<Self> {
        (0..scene.instances.len()).into_par_iter().map(|k| Self::of(&scene.flatten_one(k))).collect()
    }

    /// The box with a quarter of its size more on every side.
    fn wider(&self) -> Self {
        let size = self.high - self.low;
        Self { low: self.low - 0.25 * size, high: self.high + 0.25 * size }
    }

    fn meets(&self, other: &Self) -> bool {
        self.low.cmple(other.high).all() && other.low.cmple(self.high).all()
    }

    fn holds(&self, at: DVec3) -> bool {
        at.cmpge(self.low).all() && at.cmple(self.high).all()
    }

    fn holds_any(&self, cloud: &Gaussians, stays: &[bool]) -> bool {
        cloud.means.iter().zip(stays).any(|(&mean, &stays)| stays && self.holds(widened(mean)))
    }
}

/// An object's Gaussians and what is around it, in the block that knows the object: whichever is nearer to a Gaussian of another
/// block says what that one shows.
struct Rivals {
    object: PointSet,
    around: PointSet,
}

impl Rivals {
    fn new(shown: &Gaussians, around: &[[f32; 3]]) -> Self {
        Self { object: PointSet::new(&shown.means), around: PointSet::new(around) }
    }

    fn is_object(&self, mean: [f32; 3]) -> bool {
        self.object.distance(mean) < self.around.distance(mean)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cell::Cell;
    use crate::plan::on_level_ground;
    use glam::DMat3;
    use instgs_vk::math::similarity::Similarity;
    use instgs_vk::scene::{Instance, SourceRange};

    fn cloud(means: Vec<[f32; 3]>) -> Gaussians {
        let count = means.len();
        Gaussians {
            sh_degree: 0,
            means,
            quats: vec![[1.0, 0.0, 0.0, 0.0]; count],
            log_scales: vec![[-3.0; 3]; count],
            opacity_logits: vec![2.0; count],
            sh: vec![[0.0; 3]; count],
        }
    }

    /// Two objects of block 0 stand close to each other on the cut: an arch, and a post below it. Block 1 has both in its
    /// background. What shows the post is none of the arch's, although the arch's box holds it.
    #[test]
    fn a_neighbour_of_the_same_block_is_a_rival() {
        let plan = on_level_ground(Cell::default().cut(0, 0.0), [3.0, 0.0]);
        let arch = [[-1.0, 0.0, 0.0], [-1.0, 0.0, 1.0], [0.0, 0.0, 2.0], [1.0, 0.0, 1.0], [1.0, 0.0, 0.0]];
        let post = [[0.3, 0.0, 0.2], [0.3, 0.0, 0.5]];
        let instance = |template| Instance {
            template,
            world_from_template: Similarity::from_parts(DMat3::IDENTITY, 1.0, DVec3::ZERO),
            first_offset: None,
        };
        let first = InstancedScene {
            templates: cloud([&arch[..], &post[..]].concat()),
            template_ranges: vec![SourceRange { first: 0, count: 5 }, SourceRange { first: 5, count: 2 }],
            instances: vec![instance(0), instance(1)],
            ..InstancedScene::default()
        };
        let copies = [&arch[..], &post[..]].concat().into_iter().map(|[x, y, z]| [x - 0.02, y, z]).collect();
        let scenes = [first, InstancedScene::from_cloud(cloud(copies))];
        let object = BlockObject { block: 0, instance: 0, centre: DVec3::ZERO, radius: 1.0, depth: 0.0 };
        let kept = [KeptObject { object: 0, blocks: vec![0] }];
        let of_blocks = background(&plan, &scenes, &[object], &kept);
        // On the ground of block 1 are two Gaussians of the arch and both of the post.
        let left: Vec<f32> = of_blocks[1].gaussians.means.iter().map(|mean| mean[2]).collect();
        assert_eq!((left, of_blocks[1].covered), (vec![0.2, 0.5], 2));
    }
}
