//! Which views show what a mask shows, which masks there contain it, and which masks are of two objects at once.

use rayon::prelude::*;

use super::ConsensusOptions;
use super::bits::Bits;
use super::observe::{Observations, VISIBLE_PART};

/// A mask contains what a view shows of another if it has more than this part of it (MaskClustering).
const CONTAINED_PART: f64 = 0.8;

/// What is known of the masks.
#[derive(Clone, Debug, Default)]
pub(super) struct Relations {
    /// By mask: views that show it in one mask.
    pub(super) visible: Vec<Bits>,
    /// By mask: the masks that contain it, at most one per view, its own among them; ascending. Undersegmented ones
    /// left out.
    pub(super) containers: Vec<Vec<u32>>,
    /// By mask: it has enough points, and the views that show it agree that these are of one object.
    pub(super) is_node: Vec<bool>,
    /// By mask: views see it in pieces.
    pub(super) is_undersegmented: Vec<bool>,
}

/// What the views say of one mask.
struct Seen {
    visible: Bits,
    containers: Vec<u32>,
    is_undersegmented: bool,
}

impl Relations {
    /// Of all masks.
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
            // A mask of two objects is no witness that two masks are of one.
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

/// `counts` are zeros by mask, and are left so.
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

    /// Two objects in four views; in the second one mask has both.
    #[test]
    fn a_mask_of_two_objects_is_told_and_bears_no_witness() {
        let table = Table::new(&[[1, 2], [7, 7], [1, 2], [2, 1]]);
        let relations = Relations::new(&table.observations(1), &ConsensusOptions::default());
        // Masks 0 and 1 are the first view's, 2 the second's, then two a view.
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
