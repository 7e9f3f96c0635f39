//! How far the instanced scene is above the others, over the seeds of a scene.

use crate::protocol::{Row, SeedResult, names};
use instgs_vk::math::statistics::median;

/// The plain clouds of which the better one is what the instanced scene has to beat.
const PLAIN: [&str; 2] = [names::SAME_TIME, names::AT_ONCE];

/// Median over the seeds of a figure; `None` if a seed lacks it, or without seeds.
pub(crate) fn over_seeds(seeds: &[SeedResult], figure: impl Fn(&SeedResult) -> Option<f64>) -> Option<f64> {
    let values: Option<Vec<f64>> = seeds.iter().map(figure).collect();
    values.filter(|v| !v.is_empty()).map(|v| median(&v))
}

/// PSNR of a row, dB.
pub(crate) fn psnr(row: &Row) -> Option<f64> {
    Some(row.psnr)
}

/// PSNR of a row in the masks, dB.
pub(crate) fn psnr_in_masks(row: &Row) -> Option<f64> {
    row.psnr_in_masks
}

/// Median over the seeds of a figure of row `name` minus that of row `other`; `None` if a seed lacks one of them.
pub(crate) fn gain(seeds: &[SeedResult], name: &str, other: &str, figure: fn(&Row) -> Option<f64>) -> Option<f64> {
    over_seeds(seeds, |seed| Some(figure(seed.row(name)?)? - figure(seed.row(other)?)?))
}

/// Median over the seeds of a figure of the instanced scene minus the larger one of the plain clouds, seed by seed; which
/// clouds these are says [`BestOf`]. The larger one is chosen for each figure by itself, so that no choice is in our favour.
pub(crate) fn gain_over_best(seeds: &[SeedResult], figure: fn(&Row) -> Option<f64>) -> Option<f64> {
    over_seeds(seeds, |seed| {
        let plain = PLAIN.iter().filter_map(|name| figure(seed.row(name)?)).reduce(f64::max)?;
        Some(figure(seed.row(names::OURS)?)? - plain)
    })
}

/// Which plain clouds were measured, so that the better of them could be chosen.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum BestOf {
    /// That of the same time and that in one piece.
    Both,
    /// That of the same time alone.
    SameTime,
    /// That in one piece alone.
    AtOnce,
    /// Both of some scenes, one of the others.
    Mixed,
}

impl BestOf {
    /// What all the seeds have; `None` if none has any.
    pub(crate) fn of<'a>(seeds: impl IntoIterator<Item = &'a SeedResult>) -> Option<Self> {
        let of_seed = |seed: &SeedResult| match PLAIN.map(|name| seed.row(name).is_some()) {
            [true, true] => Some(Self::Both),
            [true, false] => Some(Self::SameTime),
            [false, true] => Some(Self::AtOnce),
            [false, false] => None,
        };
        let together = |a: Self, b: Self| if a == b { a } else { Self::Mixed };
        seeds.into_iter().filter_map(of_seed).reduce(together)
    }

    /// The rival's name in a sentence.
    pub(crate) fn name(self) -> &'static str {
        match self {
            Self::Both => "the better 3DGS, of the same time or at once",
            Self::SameTime => names::SAME_TIME,
            Self::AtOnce => names::AT_ONCE,
            Self::Mixed => "the better 3DGS that was measured, of the same time or at once",
        }
    }

    /// The rival in a cell or a legend.
    pub(crate) fn short(self) -> &'static str {
        match self {
            Self::Both => "both",
            Self::SameTime => "same time",
            Self::AtOnce => "at once",
            Self::Mixed => "what was measured",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Rows of the given names, PSNR and PSNR in the masks.
    fn seed(rows: &[(&str, f64, f64)]) -> SeedResult {
        let row = |&(name, psnr, masks): &(&str, f64, f64)| Row {
            name: name.into(),
            psnr,
            psnr_in_masks: Some(masks),
            ..Row::default()
        };
        SeedResult { rows: rows.iter().map(row).collect(), ..SeedResult::default() }
    }

    /// In one seed the cloud of the same time is better, in the others the one in one piece; in masks it is the other way round.
    #[test]
    fn the_better_plain_cloud_is_chosen_seed_by_seed_and_figure_by_figure() {
        let (ours, time, once) = (names::OURS, names::SAME_TIME, names::AT_ONCE);
        let seeds = [
            seed(&[(time, 29.0, 20.0), (once, 28.0, 21.0), (ours, 30.0, 22.0)]),
            seed(&[(time, 27.0, 20.0), (once, 29.5, 19.0), (ours, 30.0, 22.0)]),
            seed(&[(time, 27.0, 25.0), (once, 29.8, 19.0), (ours, 30.0, 22.0)]),
        ];
        assert_eq!(gain_over_best(&seeds, psnr), Some(0.5));
        assert_eq!(gain_over_best(&seeds, psnr_in_masks), Some(1.0));
        // Against each of them alone the lead would be larger.
        assert_eq!((gain(&seeds, ours, time, psnr), gain(&seeds, ours, once, psnr)), (Some(3.0), Some(0.5)));
        assert_eq!(gain_over_best(&seeds[..1], psnr), Some(1.0));
        assert_eq!((gain_over_best(&[], psnr), BestOf::of(&[])), (None, None));
    }

    #[test]
    fn where_one_cloud_was_measured_the_label_says_which() {
        let (ours, time, once) = (names::OURS, names::SAME_TIME, names::AT_ONCE);
        let of_time = seed(&[(time, 29.0, 20.0), (ours, 30.0, 22.0)]);
        let at_once = seed(&[(once, 28.0, 20.0), (ours, 30.0, 22.0)]);
        let both = seed(&[(time, 29.0, 20.0), (once, 29.5, 20.0), (ours, 30.0, 22.0)]);
        let labelled = |seed: &SeedResult| (BestOf::of([seed]), gain_over_best(std::slice::from_ref(seed), psnr));
        assert_eq!(labelled(&of_time), (Some(BestOf::SameTime), Some(1.0)));
        assert_eq!(labelled(&at_once), (Some(BestOf::AtOnce), Some(2.0)));
        assert_eq!(labelled(&both), (Some(BestOf::Both), Some(0.5)));
        assert_eq!(BestOf::of([&both, &of_time]), Some(BestOf::Mixed));
        assert_eq!(BestOf::of([&both, &seed(&[])]), Some(BestOf::Both), "a scene without them says nothing");
    }
}
