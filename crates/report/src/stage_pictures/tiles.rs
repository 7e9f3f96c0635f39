//! Selects the objects whose poses get a picture.

use super::overlay::{Objects, group_overlay, portraits};
use super::painter::Painter;
use crate::GroupOverlay;
use instgs_objects::pipeline::Prepared;
use instgs_objects::register::{InstanceRegistration, Verdict};
use instgs_objects::template::MIN_INSTANCE_GAUSSIANS;
use instgs_vk::render::RenderError;
use instgs_vk::scene::PosedGroup;

/// Upper bound of the groups shown, largest first, as hardly anyone looks at more.
pub(super) const GROUPS: usize = 6;
/// Upper bound of the objects of a group shown, doubtful ones and worst fits first: three rows of a page.
const TILES: usize = 12;

/// Pictures of the registered groups, and of the objects that are in none.
pub(super) fn overlays(
    painter: &mut Painter,
    objects: &Objects<'_>,
    groups: &[PosedGroup],
    prepared: &Prepared,
) -> Result<Vec<GroupOverlay>, RenderError> {
    let mut order: Vec<&PosedGroup> = groups.iter().collect();
    order.sort_by_key(|group| std::cmp::Reverse(group.instances.len()));
    let mut out = Vec::new();
    for group in order.into_iter().take(GROUPS) {
        let reference = reference(group, objects);
        out.push(group_overlay(painter, objects, group, reference, &shown(group, reference, prepared))?);
    }
    let is_posed = |id: u32| groups.iter().flat_map(|group| &group.instances).any(|instance| instance.id == id);
    let mut alone: Vec<u32> = objects.ids().filter(|&id| !is_posed(id)).collect();
    if !alone.is_empty() {
        let left_out = alone.len().saturating_sub(TILES);
        alone.truncate(TILES);
        let tiles = portraits(painter, objects, &alone)?;
        out.push(GroupOverlay { name: "in no group: they stay in the background".into(), tiles, left_out });
    }
    Ok(out)
}

/// Index of the instance to compare with: the first, or the one with the most Gaussians if it has hardly any.
fn reference(group: &PosedGroup, objects: &Objects<'_>) -> usize {
    let own = |i: usize| objects.len(group.instances[i].id);
    let most = (0..group.instances.len()).max_by_key(|&i| (own(i), std::cmp::Reverse(i))).unwrap_or(0);
    if own(0) >= MIN_INSTANCE_GAUSSIANS { 0 } else { most }
}

/// The reference, then others in the group's order; if there are too many, those that most need a look.
fn shown(group: &PosedGroup, reference: usize, prepared: &Prepared) -> Vec<usize> {
    let mut others: Vec<usize> = (0..group.instances.len()).filter(|&i| i != reference).collect();
    let worth = |i: usize| worth(group.instances[i].id, prepared);
    others.sort_by(|&a, &b| {
        let ((a_doubt, a_error), (b_doubt, b_error)) = (worth(a), worth(b));
        b_doubt.cmp(&a_doubt).then(b_error.total_cmp(&a_error)).then(a.cmp(&b))
    });
    others.truncate(TILES - 1);
    others.sort_unstable();
    [vec![reference], others].concat()
}

/// Whether a pose is in doubt, and how badly it fits: from registration, or from the merge for given poses.
fn worth(id: u32, prepared: &Prepared) -> (bool, f64) {
    let registered = |r: &InstanceRegistration| (r.verdict == Verdict::Ambiguous, r.relative_rmse);
    let merged = || {
        let instance = prepared.groups.iter().flat_map(|g| &g.instances).find(|i| i.id == id);
        (false, instance.and_then(|i| i.match_distance).unwrap_or(0.0))
    };
    prepared.registration.iter().find(|r| r.instance == id).map_or_else(merged, registered)
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::similarity::Similarity;
    use instgs_vk::scene::PosedInstance;

    #[test]
    fn of_many_the_doubtful_and_the_worst_are_shown() {
        let at = |id| PosedInstance { id, world_from_template: Similarity::IDENTITY };
        let group = PosedGroup { template_id: 0, name: None, score: None, instances: (1..=40).map(at).collect() };
        let registration = |id: u32| InstanceRegistration {
            instance: id,
            group: Some(0),
            name: None,
            gaussians: 100,
            inliers: 1.0,
            rmse: 0.0,
            relative_rmse: f64::from(id) / 1000.0,
            photometric: None,
            uncertainty: None,
            slight: false,
            accepted: true,
            verdict: if id == 3 { Verdict::Ambiguous } else { Verdict::Accepted },
            note: String::new(),
        };
        let prepared = Prepared { registration: (1..=40).map(registration).collect(), ..Prepared::default() };
        let ids: Vec<usize> = shown(&group, 6, &prepared).into_iter().map(|i| i + 1).collect();
        assert_eq!(ids, [7, 3, 31, 32, 33, 34, 35, 36, 37, 38, 39, 40]);
        let few = PosedGroup { instances: (1..=3).map(at).collect(), ..group };
        assert_eq!(shown(&few, 1, &Prepared::default()), [1, 0, 2]);
    }
}
