//! Removing Gaussians from a template: all its instances lose them, with the offsets that belong to them; and from what these
//! instances have of their own.
//!
//! The template's means decide, in its frame: offsets, which differ between instances, are ignored.

use glam::DVec3;

use crate::math::sh::widened;
use crate::scene::edit::membership::drop_foreign;
use crate::scene::edit::{EditOutcome, EditReason, existing_template, own};
use crate::scene::instanced_scene::InstancedScene;

/// Which side of a box remains after a crop.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Keep {
    /// Gaussians in the box, its faces included.
    #[default]
    Inside,
    /// Gaussians outside the box.
    Outside,
}

pub(super) fn crop(
    scene: &mut InstancedScene,
    template: u32,
    [min, max]: [DVec3; 2],
    keep: Keep,
) -> Result<EditOutcome, EditReason> {
    // This rejects NaN, too.
    if !min.cmple(max).all() {
        return Err(EditReason::value(format!("no box reaches from {min} to {max}: want the lower corner first")));
    }
    let inside = |mean: DVec3| mean.cmpge(min).all() && mean.cmple(max).all();
    thin(scene, template, |mean| inside(mean) == (keep == Keep::Inside))
}

pub(super) fn erase(
    scene: &mut InstancedScene,
    template: u32,
    centres: &[DVec3],
    radius: f64,
) -> Result<EditOutcome, EditReason> {
    if !(radius.is_finite() && radius > 0.0) {
        return Err(EditReason::value(format!("{radius} is not a radius: want a number above 0")));
    }
    if centres.is_empty() || !centres.iter().all(|centre| centre.is_finite()) {
        return Err(EditReason::value("want one or more points of finite numbers"));
    }
    let touched = |mean: DVec3| centres.iter().any(|centre| centre.distance_squared(mean) <= radius * radius);
    thin(scene, template, |mean| !touched(mean))
}

/// Keeps the Gaussians of a template whose mean, in its frame, satisfies a condition.
fn thin(scene: &mut InstancedScene, template: u32, stays: impl Fn(DVec3) -> bool) -> Result<EditOutcome, EditReason> {
    existing_template(scene, template)?;
    check_alone(scene, template)?;
    let range = scene.template_ranges[template as usize];
    let run = range.first as usize..(range.first + range.count) as usize;
    let mut keep = vec![true; scene.templates.len()];
    for i in run.clone() {
        keep[i] = stays(widened(scene.templates.means[i]));
    }
    let kept = keep[run.clone()].iter().filter(|&&kept| kept).count();
    let mut outcome = EditOutcome::default();
    let own = own_to_remove(scene, template, &stays);
    if kept == run.len() && !own.contains(&true) {
        outcome.warnings.push(format!("no Gaussian of template {template} is in the region to remove"));
        return Ok(outcome);
    }
    if kept == 0 && !run.is_empty() {
        return Err(EditReason::EmptyTemplate { template, count: run.len() });
    }
    if kept < run.len() {
        drop_foreign(scene, "template.", &mut outcome);
        if !scene.offsets.is_empty() {
            drop_foreign(scene, "offset.", &mut outcome);
        }
        scene.compact_templates(&keep);
    }
    if scene.keep_own(|_, i| !own[i]) > 0 {
        drop_foreign(scene, "own.", &mut outcome);
    }
    outcome.changed = (0..scene.instances.len()).filter(|&k| scene.instances[k].template == template).collect();
    if outcome.changed.is_empty() {
        let removed = run.len() - kept;
        outcome.warnings.push(format!("template {template} lost {removed} Gaussians, and no instance shows it"));
    }
    Ok(outcome)
}

/// By own Gaussian, whether only instances of the template have it and its mean does not satisfy the condition.
fn own_to_remove(scene: &InstancedScene, template: u32, stays: impl Fn(DVec3) -> bool) -> Vec<bool> {
    let of_template = own::used_by(scene, |k| scene.instances[k].template == template);
    let of_others = own::used_by(scene, |k| scene.instances[k].template != template);
    let goes = |i: usize| of_template[i] && !of_others[i] && !stays(widened(scene.own.means[i]));
    (0..scene.own.len()).map(goes).collect()
}

/// Checks that no other template shares Gaussians with this one: it would lose them too.
fn check_alone(scene: &InstancedScene, template: u32) -> Result<(), EditReason> {
    let range = scene.template_ranges[template as usize];
    let shares = |(other, r): (usize, &crate::scene::SourceRange)| other != template as usize && r.overlaps(range);
    match scene.template_ranges.iter().enumerate().position(shares) {
        Some(other) => Err(EditReason::SharedTemplate { template, other }),
        None => Ok(()),
    }
}
