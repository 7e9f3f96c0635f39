//! Instances and their template apart: an instance becomes a template of its own, or loses what sets it apart.

use std::collections::BTreeSet;

use crate::scene::edit::arrange::add_template;
use crate::scene::edit::membership::{kept_label, release, run_of, take_template};
use crate::scene::edit::{EditOutcome, EditReason, Selector};
use crate::scene::flatten::Local;
use crate::scene::gaussians::Gaussians;
use crate::scene::instanced_scene::{InstancedScene, SAME_COLOR, SourceRange};

/// What an instance can have beside its template's.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Extra {
    /// Offsets, own Gaussians and the colour matrix.
    #[default]
    All,
    /// Its offsets.
    Offsets,
    /// Its own Gaussians.
    Own,
    /// Its colour matrix.
    Colours,
}

/// Makes each instance the only one of a new template, which has its offsets, colours and own Gaussians as its own. An instance
/// that is so already stays as it is.
pub(super) fn make_unique(scene: &mut InstancedScene, which: &Selector) -> Result<EditOutcome, EditReason> {
    let chosen = which.resolve(scene)?;
    let mut outcome = EditOutcome::default();
    let mut freed = Vec::new();
    for k in chosen {
        let instance = scene.instances[k].clone();
        let others = scene.instances.iter().filter(|other| other.template == instance.template).count() > 1;
        let matrix = scene.color_matrix(k).copied().filter(|matrix| *matrix != SAME_COLOR);
        let own = scene.own_range(k);
        if !others && instance.first_offset.is_none() && matrix.is_none() && own.count == 0 {
            outcome.warnings.push(format!("instance {k} is the only one of its template already"));
            continue;
        }
        let count = scene.template_ranges[instance.template as usize].count;
        let mut cloud = Gaussians::with_capacity(scene.templates.sh_degree, (count + own.count) as usize);
        let plain = instance.first_offset.is_none() && matrix.is_none();
        if plain {
            cloud.append(&scene.templates.range(scene.template_ranges[instance.template as usize]));
        } else {
            let shown = (0..count).filter(|&local| !scene.hides(&instance, local));
            let shown = shown.map(|local| Local::shown(scene, &instance, matrix.as_ref(), local as usize));
            shown.for_each(|local| local.push_to(&mut cloud));
        }
        cloud.append(&scene.own.range(own));
        let template = add_template(scene, &cloud, &mut outcome)?;
        freed.extend(run_of(scene, &instance));
        let name = kept_label(scene, k).map(|name| unused_name(scene, &name));
        take_template(scene, k, template, name.as_deref());
        forget(scene, k, Extra::All);
        outcome.changed.push(k);
    }
    release(scene, &freed, &mut outcome);
    Ok(outcome)
}

/// The first of "NAME 2", "NAME 3" and so on that no group has.
fn unused_name(scene: &InstancedScene, name: &str) -> String {
    let taken: BTreeSet<&str> = scene.groups.iter().filter_map(|group| group.name.as_deref()).collect();
    // A number that an earlier call gave is counted up instead of followed by another.
    let stem = name.rsplit_once(' ').filter(|(_, n)| n.parse::<u32>().is_ok()).map_or(name, |(stem, _)| stem);
    let mut names = (2u64..).map(|n| format!("{stem} {n}"));
    names.find(|name| !taken.contains(name.as_str())).unwrap_or_else(|| name.to_owned())
}

/// Removes what sets instances apart from their template.
pub(super) fn reset(scene: &mut InstancedScene, which: &Selector, what: Extra) -> Result<EditOutcome, EditReason> {
    let chosen = which.resolve(scene)?;
    let mut outcome = EditOutcome::default();
    let mut freed = Vec::new();
    for k in chosen {
        let run = run_of(scene, &scene.instances[k]);
        if forget(scene, k, what) {
            outcome.changed.push(k);
            freed.extend(run);
        }
    }
    if outcome.changed.is_empty() {
        outcome.warnings.push("the instances are like their template already".into());
    }
    release(scene, &freed, &mut outcome);
    Ok(outcome)
}

/// Forgets offsets, own Gaussians or colours of instance `k`; true if it had any.
fn forget(scene: &mut InstancedScene, k: usize, what: Extra) -> bool {
    let is = |kind| what == Extra::All || what == kind;
    let mut had = is(Extra::Offsets) && scene.instances[k].first_offset.take().is_some();
    if let Some(range) = scene.own_ranges.get_mut(k).filter(|_| is(Extra::Own)) {
        had |= std::mem::take(range) != SourceRange::default();
    }
    if let Some(matrix) = scene.color_from_template.get_mut(k).filter(|_| is(Extra::Colours)) {
        had |= std::mem::replace(matrix, SAME_COLOR) != SAME_COLOR;
    }
    had
}
