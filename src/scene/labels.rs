//! The group and mask id of an instance: `groups` looked up per instance, and updated when instances are added or
//! removed.

use crate::scene::instanced_scene::{Group, InstancedScene};

/// The group and mask id of one instance.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct InstanceLabel {
    /// Index into `InstancedScene::groups`, if it has a group.
    pub group: Option<usize>,
    /// Mask id, if it has one.
    pub id: Option<u32>,
}

impl InstancedScene {
    /// The label of an instance, as [`InstancedScene::instance_labels`] has it.
    ///
    /// # Panics
    /// If there is no such instance.
    pub fn instance_label(&self, k: usize) -> InstanceLabel {
        let template = self.instances[k].template;
        if template as usize >= self.template_ranges.len() {
            return InstanceLabel::default();
        }
        label_at(&self.groups, template, self.instances[..k].iter().filter(|i| i.template == template).count())
    }

    /// The label of every instance. The j-th instance of a template has the j-th id of the template's groups,
    /// concatenated; instances beyond the last id belong to the last group, without an id.
    pub fn instance_labels(&self) -> Vec<InstanceLabel> {
        let mut rank_of_template = vec![0; self.template_ranges.len()];
        let mut labels = Vec::with_capacity(self.instances.len());
        for instance in &self.instances {
            let Some(rank) = rank_of_template.get_mut(instance.template as usize) else {
                labels.push(InstanceLabel::default());
                continue;
            };
            labels.push(label_at(&self.groups, instance.template, *rank));
            *rank += 1;
        }
        labels
    }
}

/// The label of the instance with `rank` earlier instances of its template.
fn label_at(groups: &[Group], template: u32, rank: usize) -> InstanceLabel {
    let mut ids_before = 0;
    let mut label = InstanceLabel::default();
    for (g, group) in of_template(groups, template) {
        label.group = Some(g);
        if let Some(&id) = group.instance_ids.get(rank - ids_before) {
            label.id = Some(id);
            return label;
        }
        ids_before += group.instance_ids.len();
    }
    label
}

fn of_template(groups: &[Group], template: u32) -> impl Iterator<Item = (usize, &Group)> {
    groups.iter().enumerate().filter(move |(_, group)| group.template_id == template)
}

/// Removes the mask id of the instance with that rank among its template's, if it has one.
pub(crate) fn remove_id(groups: &mut [Group], template: u32, rank: usize) -> Option<u32> {
    let mut rank = rank;
    for group in groups.iter_mut().filter(|group| group.template_id == template) {
        if rank < group.instance_ids.len() {
            return Some(group.instance_ids.remove(rank));
        }
        rank -= group.instance_ids.len();
    }
    None
}

/// An unused mask id: the wanted one if it is free, otherwise one more than the largest; `None` if there is none.
pub(crate) fn free_id(groups: &[Group], wanted: Option<u32>) -> Option<u32> {
    let ids = || groups.iter().flat_map(|group| &group.instance_ids);
    match wanted.filter(|wanted| ids().all(|id| id != wanted)) {
        Some(wanted) => Some(wanted),
        None => ids().max().map_or(Some(1), |largest| largest.checked_add(1)),
    }
}

/// Gives a mask id to the instance with that rank among its template's. False if the template has no group, or if
/// earlier instances have no id: the new id would become theirs.
pub(crate) fn insert_id(groups: &mut [Group], template: u32, rank: usize, id: u32) -> bool {
    let Some((last, _)) = of_template(groups, template).last() else { return false };
    let mut rank = rank;
    for (g, group) in groups.iter_mut().enumerate().filter(|(_, group)| group.template_id == template) {
        let count = group.instance_ids.len();
        // The end of a full group is the start of the next one, which takes the id.
        if rank < count || g == last && rank == count {
            group.instance_ids.insert(rank, id);
            return true;
        }
        rank -= count;
    }
    false
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::similarity::Similarity;
    use crate::scene::instanced_scene::{Instance, SourceRange};

    fn group(template_id: u32, instance_ids: &[u32]) -> Group {
        Group { template_id, name: None, instance_ids: instance_ids.into() }
    }

    #[test]
    fn ids_follow_the_instances_of_their_template() {
        let instance = |template| Instance { template, world_from_template: Similarity::IDENTITY, first_offset: None };
        let mut scene = InstancedScene {
            template_ranges: vec![SourceRange { first: 0, count: 0 }; 3],
            instances: [0, 1, 0, 0, 1, 2, 0].map(instance).into(),
            groups: vec![group(0, &[5, 6]), group(1, &[9]), group(0, &[7])],
            ..InstancedScene::default()
        };
        let labels = |scene: &InstancedScene| -> Vec<(Option<usize>, Option<u32>)> {
            let all = scene.instance_labels();
            assert!((0..all.len()).all(|k| scene.instance_label(k) == all[k]));
            all.iter().map(|l| (l.group, l.id)).collect()
        };
        let g = Some;
        let want = [
            (g(0), Some(5)),
            (g(1), Some(9)),
            (g(0), Some(6)),
            (g(2), Some(7)),
            (g(1), None),
            (None, None),
            (g(2), None),
        ];
        assert_eq!(labels(&scene), want);
        // The third instance of template 0 is removed with its id.
        assert_eq!(remove_id(&mut scene.groups, 0, 2), Some(7));
        scene.instances.remove(3);
        assert_eq!(labels(&scene)[2..], [(g(0), Some(6)), (g(1), None), (None, None), (g(2), None)]);
        assert_eq!((remove_id(&mut scene.groups, 1, 1), remove_id(&mut scene.groups, 2, 0)), (None, None));
    }

    #[test]
    fn new_ids_are_free_and_never_move_to_another_instance() {
        let mut groups = vec![group(0, &[5, 6]), group(1, &[9])];
        assert_eq!(
            (free_id(&groups, None), free_id(&groups, Some(5)), free_id(&groups, Some(7))),
            (Some(10), Some(10), Some(7))
        );
        assert!(
            insert_id(&mut groups, 0, 2, 10) && insert_id(&mut groups, 0, 0, 11) && insert_id(&mut groups, 1, 0, 77)
        );
        // An id for a fourth instance of template 1 would become the third's, since only two have ids; template 2 has
        // no group.
        assert!(!insert_id(&mut groups, 1, 3, 78) && !insert_id(&mut groups, 2, 0, 78));
        let ids: Vec<_> = groups.iter().map(|g| g.instance_ids.as_slice()).collect();
        assert_eq!(ids, [[11, 5, 6, 10].as_slice(), [77, 9].as_slice()]);
        groups[0].instance_ids.push(u32::MAX);
        assert_eq!((free_id(&groups, None), free_id(&[], None)), (None, Some(1)));
    }
}
