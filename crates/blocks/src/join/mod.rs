//! One scene of the scenes of trained blocks.

mod assemble;
mod kinds;
mod objects;
mod runs;
mod seams;
#[cfg(test)]
mod tests;

use std::sync::Arc;

use instgs_vk::gpu::Gpu;
use instgs_vk::scene::{Camera, InstancedScene};
use serde::Serialize;

pub use runs::{BlockRuns, read_runs};

use crate::error::BlocksError;
use crate::plan::Plan;

/// What is joined.
#[derive(Clone, Copy)]
pub struct JoinInput<'a> {
    /// The plan of the blocks.
    pub plan: &'a Plan,
    /// By block of the plan, its trained scene.
    pub scenes: &'a [InstancedScene],
    /// Training views of the whole data set: they give the up axis, and pictures to compare templates in.
    pub cameras: &'a [Camera],
    /// Device for these pictures; without one, near ties of poses are decided by shape and colour alone.
    pub gpu: Option<&'a Arc<Gpu>>,
}

/// A joined scene.
pub struct Joined {
    /// The scene: templates in the order of the blocks that they come from.
    pub scene: InstancedScene,
    /// What became of the blocks.
    pub report: JoinReport,
}

/// What became of the blocks.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct JoinReport {
    /// One per block of the plan.
    pub blocks: Vec<BlockReport>,
    /// One per template of the scene.
    pub templates: Vec<KindReport>,
    /// Objects that several blocks had, beyond the one that was kept of each.
    pub duplicates: usize,
    /// Warnings, one line each.
    pub warnings: Vec<String>,
}

/// What became of one block.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct BlockReport {
    /// Name of the block.
    pub name: String,
    /// Number of its objects in the joined scene.
    pub instances: usize,
    /// Number of its objects too far beyond its cell, which were left out.
    pub beyond: usize,
    /// Number of its background Gaussians in the joined scene.
    pub background: usize,
    /// Number of its background Gaussians outside of its cell, which were left out.
    pub outside: usize,
    /// Number of its background Gaussians that show an object of another block, which were left out.
    pub covered: usize,
}

/// A template of the joined scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct KindReport {
    /// Name of the kind of object, if it is known.
    pub name: Option<String>,
    /// Name of the block whose template it is.
    pub block: String,
    /// Number of blocks' templates that it stands for, itself included.
    pub templates: usize,
    /// Number of its instances.
    pub instances: usize,
    /// Number of its Gaussians.
    pub gaussians: usize,
}

/// Joins the scenes of all blocks of a plan.
///
/// A Gaussian of the background stays if its block owns the ground below it. An object stays if its centre lies in the cell of
/// the block that has it, or near enough beyond; of several at one place the one that lies deepest in its block's cell.
/// Templates that registration finds alike become one: that of the block with most of the objects. Its instances stay as they
/// are, those of the others get offsets to it anew, by matching.
///
/// # Errors
/// The number of scenes is not that of the blocks, they do not fit each other, or a device fails.
pub fn join(input: &JoinInput<'_>) -> Result<Joined, BlocksError> {
    runs::check_alike(input.plan, input.scenes)?;
    let found = objects::candidates(input.plan, input.scenes);
    let kept = objects::each_once(&found);
    let kinds = kinds::match_kinds(input, &found, &kept)?;
    let background = seams::background(input.plan, input.scenes, &found, &kept);
    assemble::assemble(input, assemble::Parts { found: &found, kept: &kept, kinds: &kinds, background })
}
