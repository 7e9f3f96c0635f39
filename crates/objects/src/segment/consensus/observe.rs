//! Finds the mask that each Gaussian lies in, view by view: the input of clustering.

use crate::segment::error::SegmentError;
use crate::segment::sweep::ViewContributions;
use instgs_vk::math::rng::Rng;
use instgs_vk::render::{CONTRIBUTION_ONE, Contribution};
use instgs_vk::scene::{Camera, Gaussians};

use super::ConsensusOptions;

/// Least contribution of a Gaussian to a view, pixels: with less it is hidden or at the border of something.
const MIN_WEIGHT_PX: f64 = 0.5;
/// A Gaussian whose projected standard deviation exceeds this part of the picture's shorter side is haze in front of
/// everything: its diameter of six deviations is more than half of the picture.
const HAZE_PART: f64 = 0.1;
/// A view shows a mask if at least this part of the mask's points lie in masks of that view (MaskClustering).
pub(super) const VISIBLE_PART: f64 = 0.3;
/// Stream of the random draw, derived from the seed.
const SAMPLE_STREAM: u64 = 0x0B5;

/// One mask: an id in a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(super) struct MaskKey {
    /// Index of the view in the sweep.
    pub(super) view: u32,
    /// Id within that view, above 0.
    pub(super) id: u16,
}

/// The points of every mask; points are a sample of the Gaussians.
#[derive(Clone, Debug, Default)]
pub(super) struct Observations {
    /// Index of each point's Gaussian, ascending. Every point lies in at least one mask.
    pub(super) gaussians: Vec<u32>,
    /// All masks, sorted by view, then by id.
    pub(super) masks: Vec<MaskKey>,
    /// Points of each mask, ascending.
    pub(super) points_of_mask: Vec<Vec<u32>>,
    /// Number of views, with or without a mask.
    pub(super) view_count: usize,
    /// View v has the masks `first_of_view[v]..first_of_view[v + 1]`.
    first_of_view: Vec<u32>,
    /// `[point][view]`: 1 + rank of the mask among its view's; 0 = in no mask, or in one with too few points.
    ranks: Vec<u16>,
}

impl Observations {
    /// `ids_of_view` are the ids present in each view, ascending; `sightings` are pairs (point, id) of each view in any
    /// order; `gaussians` has one entry per point. Masks with fewer than `min_points` points keep them, but are
    /// otherwise ignored.
    pub(super) fn new(
        mut gaussians: Vec<u32>,
        ids_of_view: &[Vec<u16>],
        sightings: &[Vec<(u32, u16)>],
        min_points: usize,
    ) -> Self {
        let sightings = renumbered(&mut gaussians, sightings);
        let view_count = ids_of_view.len();
        let mut out = Self { gaussians, view_count, first_of_view: vec![0], ..Self::default() };
        out.ranks = vec![0; out.gaussians.len() * view_count];
        for (view, (ids, sightings)) in ids_of_view.iter().zip(&sightings).enumerate() {
            let first = out.masks.len();
            out.masks.extend(ids.iter().map(|&id| MaskKey { view: view as u32, id }));
            out.points_of_mask.resize(out.masks.len(), Vec::new());
            for &(point, id) in sightings {
                if let Ok(rank) = ids.binary_search(&id) {
                    out.points_of_mask[first + rank].push(point);
                }
            }
            for (rank, points) in out.points_of_mask[first..].iter_mut().enumerate() {
                points.sort_unstable();
                if points.len() >= min_points {
                    points.iter().for_each(|&point| out.ranks[point as usize * view_count + view] = rank as u16 + 1);
                }
            }
            out.first_of_view.push(out.masks.len() as u32);
        }
        out
    }

    /// The masks that a point lies in, ascending, at most one per view, without those of too few points.
    pub(super) fn masks_of_point(&self, point: u32) -> impl Iterator<Item = u32> {
        let row = &self.ranks[point as usize * self.view_count..][..self.view_count];
        let mask = |(rank, first): (&u16, &u32)| (*rank > 0).then(|| first + u32::from(*rank) - 1);
        row.iter().zip(&self.first_of_view).filter_map(mask)
    }

    /// The masks that share points with `mask`, itself included, ascending, without those of too few points. Adds the
    /// number of shared points to `counts`, which has one entry per mask and must be zeros; the caller resets them.
    pub(super) fn masks_sharing(&self, mask: usize, counts: &mut [u32]) -> Vec<u32> {
        let mut sharing = Vec::new();
        for other in self.points_of_mask[mask].iter().flat_map(|&point| self.masks_of_point(point)) {
            if counts[other as usize] == 0 {
                sharing.push(other);
            }
            counts[other as usize] += 1;
        }
        sharing.sort_unstable();
        sharing
    }

    /// Size in memory, bytes.
    pub(super) fn bytes(&self) -> u64 {
        let points: usize = self.points_of_mask.iter().map(Vec::len).sum();
        (points + self.gaussians.len()) as u64 * 4 + self.ranks.len() as u64 * 2
    }
}

/// Drops points without a sighting and renumbers the others in order.
fn renumbered(gaussians: &mut Vec<u32>, sightings: &[Vec<(u32, u16)>]) -> Vec<Vec<(u32, u16)>> {
    let mut is_seen = vec![false; gaussians.len()];
    sightings.iter().flatten().for_each(|&(point, _)| is_seen[point as usize] = true);
    let mut number = Vec::with_capacity(is_seen.len());
    let mut count = 0;
    for &seen in &is_seen {
        number.push(count);
        count += u32::from(seen);
    }
    let mut seen = is_seen.iter();
    gaussians.retain(|_| seen.next() == Some(&true));
    let renumber = |view: &Vec<(u32, u16)>| view.iter().map(|&(point, id)| (number[point as usize], id)).collect();
    sightings.iter().map(renumber).collect()
}

/// Sweeps once over the views; `progress` receives the number of views done.
///
/// # Errors
/// Those of [`ViewContributions::for_each`]; no mask with an object; errors of `progress`.
pub(super) fn observe<E: From<SegmentError>>(
    views: &mut ViewContributions<'_, E>,
    cloud: &Gaussians,
    options: &ConsensusOptions,
    mut progress: impl FnMut(usize) -> Result<(), E>,
) -> Result<Observations, E> {
    let gaussians = sample(cloud, options);
    let mut point_of_gaussian = vec![u32::MAX; cloud.len()];
    (0..).zip(&gaussians).for_each(|(point, &i)| point_of_gaussian[i as usize] = point);
    let (mut ids_of_view, mut sightings) = (Vec::new(), Vec::new());
    views.for_each(|entries| {
        let sighting = |of_gaussian: &[Contribution]| {
            let i = of_gaussian[0].gaussian as usize;
            let id = id_of_gaussian(of_gaussian)?;
            let is_point = point_of_gaussian[i] != u32::MAX && !is_haze(cloud, i, entries.camera);
            is_point.then(|| (point_of_gaussian[i], id))
        };
        let by_gaussian = entries.contributions.chunk_by(|a, b| a.gaussian == b.gaussian);
        sightings.push(by_gaussian.filter_map(sighting).collect::<Vec<(u32, u16)>>());
        ids_of_view.push(entries.ids.to_vec());
        progress(entries.view + 1)
    })?;
    if ids_of_view.iter().all(Vec::is_empty) {
        return Err(SegmentError::NoMasks.into());
    }
    Ok(Observations::new(gaussians, &ids_of_view, &sightings, options.min_points))
}

/// At most `max_points` Gaussians with finite means, drawn at random; ascending.
fn sample(cloud: &Gaussians, options: &ConsensusOptions) -> Vec<u32> {
    let is_finite = |i: &u32| cloud.means[*i as usize].iter().all(|v| v.is_finite());
    let mut out: Vec<u32> = (0..cloud.len() as u32).filter(is_finite).collect();
    if out.len() > options.max_points {
        Rng::new(options.seed).fork(SAMPLE_STREAM).shuffle(&mut out);
        out.truncate(options.max_points);
        out.sort_unstable();
    }
    out
}

/// The mask with more than half of a Gaussian's contribution to a view; `None` outside of masks, or if the contribution
/// is too small.
fn id_of_gaussian(of_gaussian: &[Contribution]) -> Option<u16> {
    let total: u64 = of_gaussian.iter().map(|c| c.weight).sum();
    let most = of_gaussian.iter().max_by_key(|c| c.weight)?;
    let is_enough = total as f64 > MIN_WEIGHT_PX * f64::from(CONTRIBUTION_ONE);
    (most.id != 0 && 2 * most.weight > total && is_enough).then_some(most.id)
}

/// Whether a Gaussian is too large in the picture to belong to one object.
fn is_haze(cloud: &Gaussians, i: usize, camera: &Camera) -> bool {
    let [x, y, z] = cloud.means[i].map(f64::from);
    let row = camera.view_from_world[2];
    let depth = row[0] * x + row[1] * y + row[2] * z + row[3];
    let deviation = cloud.log_scales[i].iter().fold(f64::NEG_INFINITY, |most, &v| most.max(f64::from(v))).exp();
    let side = f64::from(camera.width.min(camera.height));
    deviation * camera.fx.max(camera.fy) > HAZE_PART * side * depth
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn points_and_masks_are_found_both_ways() {
        let ids = [vec![3, 9], vec![], vec![5]];
        let sightings = [vec![(4, 9), (0, 3), (2, 9), (1, 7)], vec![], vec![(2, 5)]];
        let all = Observations::new((10..16).collect(), &ids, &sightings, 1);
        // Of six points the fourth and the last have no sighting; an id without a mask is ignored.
        assert_eq!(all.gaussians, [10, 11, 12, 14]);
        let key = |view, id| MaskKey { view, id };
        assert_eq!(all.masks, [key(0, 3), key(0, 9), key(2, 5)]);
        assert_eq!(all.points_of_mask, [vec![0], vec![2, 3], vec![2]]);
        let masks = |observations: &Observations, point| observations.masks_of_point(point).collect::<Vec<_>>();
        assert_eq!([0, 1, 2, 3].map(|p| masks(&all, p)), [vec![0], vec![], vec![1, 2], vec![1]]);
        let mut counts = vec![0; 3];
        assert_eq!(all.masks_sharing(1, &mut counts), [1, 2]);
        assert_eq!(counts, [0, 2, 1]);
        let large = Observations::new((10..16).collect(), &ids, &sightings, 2);
        assert_eq!([0, 1, 2, 3].map(|p| masks(&large, p)), [vec![], vec![], vec![1], vec![1]]);
        assert_eq!(large.points_of_mask, all.points_of_mask, "masks of too few points keep them");
    }

    #[test]
    fn a_gaussian_lies_where_most_of_it_is() {
        let one = u64::from(CONTRIBUTION_ONE);
        let of = |weights: &[(u16, u64)]| {
            let entry = |&(id, weight): &(u16, u64)| Contribution { gaussian: 1, id, weight };
            id_of_gaussian(&weights.iter().map(entry).collect::<Vec<_>>())
        };
        assert_eq!(of(&[(0, one), (4, 2 * one), (9, one / 2)]), Some(4));
        assert_eq!(of(&[(0, one), (4, one)]), None, "at a border");
        assert_eq!(of(&[(0, 2 * one), (4, one)]), None, "in no mask");
        assert_eq!(of(&[(4, one / 2)]), None, "hardly seen");
    }
}
