//! For each mask: the views that show it, the masks that contain it, and whether it shows two objects at once.

use rayon::prelude::*;

use super::ConsensusOptions;
use super::bits::Bits;
use super::observe::{Observations, VISIBLE_PART};

/// A mask contains what a view shows of another if it holds more than this part of it (MaskClustering).
const CONTAINED_PART: f64 = 0.8;

/// Relations between all masks.
#[derive(Clone, Debug, Default)]
pub(super) struct Relations {
    /// By mask: the views that show it in one mask.
    pub(super) visible: Vec<Bits>,
    /// By mask: the masks that contain it, itself included, at most one per view; ascending, without undersegmented
    /// ones.
    pub(super) containers: Vec<Vec<u32>>,
    /// By mask: whether it has enough points and is not undersegmented.
    pub(super) is_node: Vec<bool>,
    /// By mask: whether too many views see it in pieces.
    pub(super) is_undersegmented: Vec<bool>,
}

/// Relations of one mask to the views.
struct Seen {
    visible: Bits,
    containers: Vec<u32>,
    is_undersegmented: bool,
}

impl Relations {
    /// Computes the relations of all masks.
    pub(super) fn new(observations: &Observations, options: &ConsensusOptions) -> Self {
        let has_points = |mask: u32| observations.points_of_mask[mask as usize].len() >= options.min_points;
        let counts = || vec![0u32; observations.masks.len()];
        let of_mask = |counts: &mut Vec<u32>, mask: u32| {
            has_points(mask).then(|| seen(observations, mask, counts, options.undersegmented_part))
        };
        let masks = 0..observations.masks.len() as u32;
        let seen: Vec<Option<Seen>> = masks.into_par_iter().map_init(counts, of_mask).collect();
        let mut out = Self {
            is_node: seen.iter().map(|s| s.as_ref().is_some_and(|s| !s.is_undersegmented)).collect(),
            is_undersegmented: seen.iter().map(|s| s.as_ref().is_some_and(|s| s.is_undersegmented)).collect(),
            ..Self::default()
        };
        for seen in seen {
            let none = || Seen { visible: Bits::default(), containers: Vec::new(), is_undersegmented: false };
            let Seen { mut visible, mut containers, .. } = seen.unwrap_or_else(none);
            // A mask of two objects is no evidence that two masks show the same one.
            containers.retain(|&container| {
                let is_witness = !out.is_undersegmented[container as usize];
                if !is_witness {
                    visible.remove(observations.masks[container as usize].view as usize);
                }
                is_witness
            });
            out.visible.push(visible);
            out.containers.push(containers);
        }
        out
    }
}

/// Relations of one mask. `counts`, one per mask, must be zeros and are zeros again on return.
fn seen(observations: &Observations, mask: u32, counts: &mut [u32], undersegmented_part: f64) -> Seen {
    let points = &observations.points_of_mask[mask as usize];
    let touched = observations.masks_sharing(mask as usize, counts);
    let view_of = |mask: &u32| observations.masks[*mask as usize].view;
    let mut out = Seen { visible: Bits::new(observations.view_count), containers: Vec::new(), is_undersegmented: true };
    let (mut shown, mut split) = (0, 0);
    for of_view in touched.chunk_by(|a, b| view_of(a) == view_of(b)) {
        let total: u32 = of_view.iter().map(|&other| counts[other as usize]).sum();
        if f64::from(total) < VISIBLE_PART * points.len() as f64 {
            continue;
        }
        shown += 1;
        let most = of_view.iter().find(|&&other| f64::from(counts[other as usize]) > CONTAINED_PART * f64::from(total));
        match most {
            Some(&container) => {
                out.visible.insert(view_of(&container) as usize);
                out.containers.push(container);
            }
            None => split += 1,
        }
    }
    touched.iter().for_each(|&other| counts[other as usize] = 0);
    out.is_undersegmented = shown == 0 || f64::from(split) > undersegmented_part * f64::from(shown);
    out
}

#[cfg(test)]
mod tests {
    use super::super::tests::Table;
    use super::*;

    /// Two objects in four views; one mask of the second view has both.
    #[test]
    fn a_mask_of_two_objects_is_told_and_bears_no_witness() {
        let table = Table::new(&[[1, 2], [7, 7], [1, 2], [2, 1]]);
        let relations = Relations::new(&table.observations(1), &ConsensusOptions::default());
        // Masks 0 and 1 are in the first view, 2 in the second, and two in each of the others.
        let bad: Vec<usize> = (0..7).filter(|&mask| relations.is_undersegmented[mask]).collect();
        assert_eq!(bad, [2]);
        assert_eq!(relations.containers[0], [0, 3, 6]);
        let mut views = Bits::new(4);
        [0, 2, 3].iter().for_each(|&view| views.insert(view));
        assert_eq!(relations.visible[0], views);
        assert_eq!(relations.is_node, [true, true, false, true, true, true, true]);
        let lenient = ConsensusOptions { undersegmented_part: 1.0, ..ConsensusOptions::default() };
        let relations = Relations::new(&table.observations(1), &lenient);
        assert_eq!(relations.containers[0], [0, 2, 3, 6], "without the filter it is a witness");
    }
}
