//! Compares found repetitions with the true ones.

use glam::DVec3;

use super::Found;
use instgs_vk::scene::{ObjectBox, PosedGroup};

/// Precision and recall of found repetitions. The selected object counts in neither.
#[derive(Clone, Debug, PartialEq, serde::Serialize)]
pub struct Against {
    /// Id of the selected object in the true groups.
    pub instance: u32,
    /// Name of its true group.
    pub name: Option<String>,
    /// Number of objects that were found.
    pub found: usize,
    /// How many of them are right: within half of the selected box's smaller level edge of a true position that no
    /// better one took.
    pub right: usize,
    /// Number of true repetitions.
    pub all: usize,
    /// right / found; 1 if there is nothing to find and nothing was found.
    pub precision: f64,
    /// right / all; 1 if there is nothing to find.
    pub recall: f64,
}

impl Found {
    /// Compares with the true group that has the instance nearest to the centre of the selected box. `None` if there
    /// are no instances.
    pub fn against(&self, selected: &ObjectBox, groups: &[PosedGroup]) -> Option<Against> {
        let all = groups.iter().flat_map(|group| group.instances.iter().map(move |instance| (group, instance)));
        let off = |place: DVec3| place.distance(selected.center);
        let place_of = |(_, i): &(&PosedGroup, &instgs_vk::scene::PosedInstance)| i.world_from_template.translation();
        let (group, own) = all.min_by(|a, b| off(place_of(a)).total_cmp(&off(place_of(b))))?;
        let others = group.instances.iter().filter(|instance| instance.id != own.id);
        let mut open: Vec<DVec3> = others.map(|instance| instance.world_from_template.translation()).collect();
        let all = open.len();
        let limit = 0.5 * super::decide::smaller_level_edge(selected, self.up);
        let mut right = 0;
        for object in &self.objects {
            // The image of the selected object's true position, which need not be the centre of its box.
            let place = object.world_from_selected.transform_point(own.world_from_template.translation());
            if let Some(k) = (0..open.len()).find(|&k| open[k].distance(place) <= limit) {
                open.swap_remove(k);
                right += 1;
            }
        }
        let found = self.objects.len();
        let part = |of: usize| if of > 0 { right as f64 / of as f64 } else { 1.0 };
        let precision = if found == 0 && all > 0 { 0.0 } else { part(found) };
        Some(Against { instance: own.id, name: group.name.clone(), found, right, all, precision, recall: part(all) })
    }
}
