//! Adding and removing instances and swapping their template, with all that belongs to them: offsets, mask ids, unknown
//! tensors.

use glam::DVec3;

use crate::scene::edit::placement::{mapped_about, moved, rotation_of, template_centres};
use crate::scene::edit::{EditOutcome, EditReason, Selector, Turn, checked, existing_template, offset_runs, own};
use crate::scene::instanced_scene::{Group, Instance, InstancedScene, SAME_COLOR, SourceRange};
use crate::scene::labels::{free_id, insert_id, remove_id};

/// Upper limit on instances of a scene after an edit: their indices have 32 bits in files and on the device.
pub(super) const MOST_INSTANCES: u64 = u32::MAX as u64;

pub(super) fn duplicate(
    scene: &mut InstancedScene,
    which: &Selector,
    by: DVec3,
    turn: Option<Turn>,
) -> Result<EditOutcome, EditReason> {
    let originals = which.resolve(scene)?;
    let rotation = turn.map(rotation_of).transpose()?;
    let centres = template_centres(scene);
    let copy = |&k: &usize| {
        let original = &scene.instances[k];
        let centre = centres[original.template as usize];
        let turned =
            rotation.map_or(original.world_from_template, |r| mapped_about(original.world_from_template, centre, r));
        Ok(Instance { world_from_template: checked(moved(turned, by), k)?, ..original.clone() })
    };
    let copies = originals.iter().map(copy).collect::<Result<Vec<_>, EditReason>>()?;
    let mut outcome = EditOutcome::default();
    add(scene, copies, &mut outcome);
    originals.iter().zip(&outcome.added).for_each(|(&from, to)| copy_look(scene, from, std::slice::from_ref(to)));
    Ok(outcome)
}

/// Gives instances the colour matrix of instance `from`, if the scene has matrices, and its own Gaussians, shared with it.
pub(super) fn copy_look(scene: &mut InstancedScene, from: usize, to: &[usize]) {
    if let Some(&range) = scene.own_ranges.get(from) {
        to.iter().for_each(|&k| scene.own_ranges[k] = range);
    }
    if let Some(&matrix) = scene.color_from_template.get(from) {
        to.iter().for_each(|&k| scene.color_from_template[k] = matrix);
    }
}

/// Appends instances, each with a mask id if its template has a group.
pub(super) fn add(scene: &mut InstancedScene, instances: Vec<Instance>, outcome: &mut EditOutcome) {
    drop_foreign(scene, "instance.", outcome);
    let mut count_of_template = vec![0; scene.template_ranges.len()];
    scene.instances.iter().for_each(|i| count_of_template[i.template as usize] += 1);
    let mut next_id = free_id(&scene.groups, None);
    for instance in instances {
        let rank = &mut count_of_template[instance.template as usize];
        if let Some(id) = next_id.filter(|&id| insert_id(&mut scene.groups, instance.template, *rank, id)) {
            next_id = id.checked_add(1);
        }
        *rank += 1;
        outcome.added.push(scene.instances.len());
        scene.instances.push(instance);
    }
    if !scene.color_from_template.is_empty() {
        scene.color_from_template.resize(scene.instances.len(), SAME_COLOR);
    }
    if !scene.own_ranges.is_empty() {
        scene.own_ranges.resize(scene.instances.len(), SourceRange::default());
    }
}

pub(super) fn delete(scene: &mut InstancedScene, which: &Selector) -> Result<EditOutcome, EditReason> {
    let mut outcome = EditOutcome { removed: which.resolve(scene)?, ..EditOutcome::default() };
    drop_foreign(scene, "instance.", &mut outcome);
    let mut freed = Vec::new();
    let ranks = ranks(scene);
    // From the end, so that the ranks of the remaining ones stay valid.
    for &k in outcome.removed.iter().rev() {
        remove_id(&mut scene.groups, scene.instances[k].template, ranks[k]);
        freed.extend(run_of(scene, &scene.instances[k]));
    }
    retain(&mut scene.instances, &outcome.removed);
    retain(&mut scene.color_from_template, &outcome.removed);
    retain(&mut scene.own_ranges, &outcome.removed);
    release(scene, &freed, &mut outcome);
    Ok(outcome)
}

/// Removes the entries of `removed` (ascending).
fn retain<T>(entries: &mut Vec<T>, removed: &[usize]) {
    let mut left = (0..).map(|k| removed.binary_search(&k).is_err());
    entries.retain(|_| left.next().unwrap_or(true));
}

pub(super) fn swap(scene: &mut InstancedScene, which: &Selector, template: u32) -> Result<EditOutcome, EditReason> {
    existing_template(scene, template)?;
    let mut outcome = EditOutcome::default();
    let chosen = which.resolve(scene)?;
    outcome.changed = chosen.into_iter().filter(|&k| scene.instances[k].template != template).collect();
    let (mut freed, mut own_dropped, mut matrices_dropped) = (Vec::new(), 0, 0);
    for &k in &outcome.changed {
        let old = scene.instances[k].clone();
        let rank = rank_of(scene, k);
        let id = remove_id(&mut scene.groups, old.template, rank);
        scene.instances[k] = Instance { template, first_offset: None, ..old };
        // Like offsets, a matrix is fitted to its template.
        if let Some(matrix) = scene.color_from_template.get_mut(k) {
            matrices_dropped += usize::from(*matrix != SAME_COLOR);
            *matrix = SAME_COLOR;
        }
        if let Some(range) = scene.own_ranges.get_mut(k) {
            own_dropped += usize::from(range.count > 0);
            *range = SourceRange::default();
        }
        let rank = rank_of(scene, k);
        if let Some(id) = free_id(&scene.groups, id) {
            insert_id(&mut scene.groups, template, rank, id);
        }
        freed.extend(run_of(scene, &old));
    }
    let dropped = [("offsets", freed.len()), ("colour matrices", matrices_dropped), ("own Gaussians", own_dropped)];
    for (what, count) in dropped.into_iter().filter(|&(_, count)| count > 0) {
        let text = format!("the {what} of {count} instances were dropped: they are for another template");
        outcome.warnings.push(text);
    }
    release(scene, &freed, &mut outcome);
    Ok(outcome)
}

/// For every instance, the number of earlier instances of the same template.
fn ranks(scene: &InstancedScene) -> Vec<usize> {
    let mut count_of_template = vec![0; scene.template_ranges.len()];
    let rank = |instance: &Instance| {
        let count = &mut count_of_template[instance.template as usize];
        *count += 1;
        *count - 1
    };
    scene.instances.iter().map(rank).collect()
}

/// Number of instances of the same template before instance `k`, when the template of earlier ones may have just
/// changed.
fn rank_of(scene: &InstancedScene, k: usize) -> usize {
    let template = scene.instances[k].template;
    scene.instances[..k].iter().filter(|i| i.template == template).count()
}

/// The name of an instance's group.
pub(super) fn kept_label(scene: &InstancedScene, k: usize) -> Option<String> {
    let group = scene.instance_label(k).group?;
    scene.groups[group].name.clone()
}

/// Gives instance `k` another template with its mask id; offsets and own Gaussians are the caller's. A template without a group
/// gets one of this name.
pub(super) fn take_template(scene: &mut InstancedScene, k: usize, template: u32, name: Option<&str>) {
    let rank = rank_of(scene, k);
    let id = remove_id(&mut scene.groups, scene.instances[k].template, rank);
    scene.instances[k].template = template;
    let has_group = scene.groups.iter().any(|group| group.template_id == template);
    if let Some(name) = name.filter(|_| !has_group) {
        scene.groups.push(Group { template_id: template, name: Some(name.to_owned()), instance_ids: Vec::new() });
    }
    let rank = rank_of(scene, k);
    if let Some(id) = free_id(&scene.groups, id) {
        insert_id(&mut scene.groups, template, rank, id);
    }
}

/// Names the group of a template, which gets one if it has none.
pub(super) fn rename(scene: &mut InstancedScene, template: u32, name: &str) -> Result<EditOutcome, EditReason> {
    existing_template(scene, template)?;
    let name = name.trim();
    if name.is_empty() || name.chars().any(char::is_control) {
        return Err(EditReason::value(format!("{name:?} is not a name: want letters, digits or signs")));
    }
    let mut named = false;
    for group in scene.groups.iter_mut().filter(|group| group.template_id == template) {
        group.name = Some(name.to_owned());
        named = true;
    }
    if !named {
        scene.groups.push(Group { template_id: template, name: Some(name.to_owned()), instance_ids: Vec::new() });
    }
    let changed = (0..scene.instances.len()).filter(|&k| scene.instances[k].template == template).collect();
    Ok(EditOutcome { changed, ..EditOutcome::default() })
}

/// First record and length of an instance's run of offsets.
pub(super) fn run_of(scene: &InstancedScene, instance: &Instance) -> Option<(u32, u32)> {
    Some((instance.first_offset?, scene.template_ranges[instance.template as usize].count))
}

/// Removes freed runs of offsets, and own Gaussians, that no instance uses any more.
pub(super) fn release(scene: &mut InstancedScene, freed: &[(u32, u32)], outcome: &mut EditOutcome) {
    let before = scene.offsets.len();
    offset_runs::release(scene, freed);
    if scene.offsets.len() != before {
        drop_foreign(scene, "offset.", outcome);
    }
    own::release(scene, outcome);
}

/// Drops unknown tensors that are parallel to an array whose length changes: they would no longer be aligned with it.
pub(super) fn drop_foreign(scene: &mut InstancedScene, prefix: &str, outcome: &mut EditOutcome) {
    scene.foreign_tensors.retain(|name, _| {
        let follows = name.starts_with(prefix);
        if follows {
            outcome.warnings.push(format!("tensor {name} was dropped: this version does not know how to change it"));
        }
        !follows
    });
}
