//! Measures whether an id means the same object in every view.

use rayon::prelude::*;

use super::ConsensusOptions;
use super::observe::{Observations, VISIBLE_PART};

/// Ids that agree in at least this part of the cases are kept. Two objects whose ids are swapped at random agree in
/// half of them; ids of a tracker that occasionally loses an object or merges two agree in nine of ten.
pub(super) const AGREEMENT: f64 = 0.8;

/// How often ids agree between views.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Agreement {
    /// Pairs of a mask and another view in which one mask holds most of the mask's points.
    pub(super) cases: u64,
    /// Cases in which that mask has the same id.
    pub(super) same: u64,
}

impl Agreement {
    /// Part of the cases in which ids agree, 0 to 1; 1 without a case.
    pub(super) fn part(&self) -> f64 {
        if self.cases == 0 { 1.0 } else { self.same as f64 / self.cases as f64 }
    }

    /// Counts over all masks with enough points and all other views.
    pub(super) fn measure(observations: &Observations, options: &ConsensusOptions) -> Self {
        let counts = || vec![0u32; observations.masks.len()];
        let of_mask = |counts: &mut Vec<u32>, mask: usize| of_mask(observations, mask, counts, options.min_points);
        let sum = |a: Self, b: Self| Self { cases: a.cases + b.cases, same: a.same + b.same };
        (0..observations.masks.len()).into_par_iter().map_init(counts, of_mask).reduce(Self::default, sum)
    }
}

/// Counts for one mask. `counts`, one per mask, must be zeros and are zeros again on return.
fn of_mask(observations: &Observations, mask: usize, counts: &mut [u32], min_points: usize) -> Agreement {
    let mut out = Agreement::default();
    let points = &observations.points_of_mask[mask];
    if points.len() < min_points {
        return out;
    }
    let key = observations.masks[mask];
    let others = observations.masks_sharing(mask, counts);
    let key_of = |other: &u32| observations.masks[*other as usize];
    for of_view in others.chunk_by(|a, b| key_of(a).view == key_of(b).view) {
        let total: u32 = of_view.iter().map(|&other| counts[other as usize]).sum();
        let is_shown = f64::from(total) >= VISIBLE_PART * points.len() as f64 && total as usize >= min_points;
        if key_of(&of_view[0]).view == key.view || !is_shown {
            continue;
        }
        if let Some(most) = of_view.iter().find(|&&other| 2 * counts[other as usize] > total) {
            out.cases += 1;
            out.same += u64::from(key_of(most).id == key.id);
        }
    }
    others.iter().for_each(|&other| counts[other as usize] = 0);
    out
}

#[cfg(test)]
mod tests {
    use super::super::tests::Table;
    use super::*;

    fn part<const N: usize>(views: &[[u16; N]]) -> f64 {
        Agreement::measure(&Table::new(views).observations(1), &ConsensusOptions::default()).part()
    }

    #[test]
    fn ids_that_agree_are_told_from_ids_that_do_not() {
        assert_eq!(part(&[[1, 2], [1, 2], [1, 2]]), 1.0);
        // Missing in one view: no case. Merged in one view: neither object holds the majority.
        assert_eq!(part(&[[1, 2], [1, 0], [1, 2], [5, 5]]), 8.0 / 14.0);
        assert_eq!(part(&[[1, 2], [2, 1]]), 0.0);
        assert_eq!(part(&[[1, 2], [3, 4]]), 0.0, "an id of its own for every mask");
        assert_eq!(part(&[[1, 0], [0, 2]]), 1.0, "nothing in common, nothing to correct");
        let swapped = part(&[[1, 2], [2, 1], [1, 2], [2, 1], [1, 2]]);
        assert!((0.3..0.6).contains(&swapped), "{swapped}");
    }
}
