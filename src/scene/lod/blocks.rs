//! The background cut into blocks of neighbouring Gaussians.

use crate::scene::{Gaussians, SourceRange};

/// Upper limit on Gaussians in a block: two chunks, so that a level saves at least one chunk; and few enough for blocks
/// to be small compared with their viewing distance.
pub(super) const MOST: usize = 512;
/// Cuts are at multiples of this, so that the renderer's work-groups (this size, or a smaller power of two) are full.
pub(super) const CHUNK: usize = 256;

/// A new order of a cloud's Gaussians, and the blocks as ranges of that order: recursive halves, cut near the median of
/// the longest side.
pub(super) fn block_order(cloud: &Gaussians) -> (Vec<u32>, Vec<SourceRange>) {
    let mut order: Vec<u32> = (0..cloud.len() as u32).collect();
    let mut blocks = Vec::new();
    cut(cloud, &mut order, 0, &mut blocks);
    (order, blocks)
}

fn cut(cloud: &Gaussians, part: &mut [u32], first: u32, blocks: &mut Vec<SourceRange>) {
    if part.is_empty() {
        return;
    }
    if part.len() <= MOST {
        // The cloud's own order, so that equal depths are blended in the same order.
        part.sort_unstable();
        blocks.push(SourceRange { first, count: part.len() as u32 });
        return;
    }
    let axis = longest_side(cloud, part);
    let middle = (part.len() / 2).next_multiple_of(CHUNK);
    // The index breaks ties, so that blocks are the same on every machine.
    let at = |i: u32| cloud.means[i as usize][axis];
    part.select_nth_unstable_by(middle, |&a, &b| at(a).total_cmp(&at(b)).then(a.cmp(&b)));
    let (low, high) = part.split_at_mut(middle);
    cut(cloud, low, first, blocks);
    cut(cloud, high, first + middle as u32, blocks);
}

/// Axis of the longest side of the box around the means.
fn longest_side(cloud: &Gaussians, part: &[u32]) -> usize {
    let side = |axis: usize| {
        let values = || part.iter().map(|&i| cloud.means[i as usize][axis]);
        values().fold(f32::NEG_INFINITY, f32::max) - values().fold(f32::INFINITY, f32::min)
    };
    let sides = [0, 1, 2].map(side);
    (0..3).fold(0, |best, axis| if sides[axis] > sides[best] { axis } else { best })
}
