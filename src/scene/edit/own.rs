//! Gaussians that instances have of their own, when instances come, go or change: like offsets they are copied on write, and
//! unused ones are removed.

use std::collections::BTreeSet;

use crate::scene::edit::EditOutcome;
use crate::scene::edit::membership::drop_foreign;
use crate::scene::instanced_scene::{InstancedScene, SourceRange};

/// Removes own Gaussians that no instance uses.
pub(super) fn release(scene: &mut InstancedScene, outcome: &mut EditOutcome) {
    let used = used_by(scene, |_| true);
    if scene.keep_own(|_, i| used[i]) > 0 {
        drop_foreign(scene, "own.", outcome);
    }
}

/// Gives the chosen instances (ascending) own Gaussians that no other instance uses; those that share some go on sharing them.
/// Returns their ranges, each once.
pub(super) fn unshare(
    scene: &mut InstancedScene,
    chosen: &[usize],
    outcome: &mut EditOutcome,
) -> BTreeSet<SourceRange> {
    let elsewhere = used_by(scene, |k| chosen.binary_search(&k).is_err());
    let own = |range: &SourceRange| range.count > 0;
    let ranges: BTreeSet<SourceRange> = chosen.iter().map(|&k| scene.own_range(k)).filter(own).collect();
    let is_shared = |range: &SourceRange| elsewhere[range.indices()].iter().any(|&used| used);
    let mut out = BTreeSet::new();
    for range in ranges {
        if !is_shared(&range) {
            out.insert(range);
            continue;
        }
        drop_foreign(scene, "own.", outcome);
        let copy = SourceRange { first: scene.own.len() as u32, ..range };
        let copies = scene.own.range(range);
        scene.own.append(&copies);
        for &k in chosen {
            if scene.own_ranges[k] == range {
                scene.own_ranges[k] = copy;
            }
        }
        out.insert(copy);
    }
    out
}

/// By own Gaussian, whether an instance that satisfies a condition has it.
pub(super) fn used_by(scene: &InstancedScene, counts: impl Fn(usize) -> bool) -> Vec<bool> {
    let mut used = vec![false; scene.own.len()];
    let ranges = scene.own_ranges.iter().enumerate().filter(|(k, _)| counts(*k));
    ranges.for_each(|(_, range)| used[range.indices()].fill(true));
    used
}
