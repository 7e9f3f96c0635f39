//! Arranging instances relative to each other: aligning, distributing, and mirroring across a plane.

use std::collections::BTreeMap;

use glam::{DMat3, DVec3};

use crate::math::similarity::Similarity;
use crate::scene::edit::membership::{drop_foreign, kept_label, release, run_of, take_template};
use crate::scene::edit::placement::{instance_centres, moved};
use crate::scene::edit::scatter::instance_base;
use crate::scene::edit::{EditOutcome, EditReason, Selector, checked, offset_runs};
use crate::scene::gaussians::Gaussians;
use crate::scene::instanced_scene::{InstancedScene, SourceRange};

/// The SH coefficients whose basis functions change their sign with that of x, of degrees 1 to 3.
const ODD_IN_X: [usize; 6] = [3, 4, 7, 10, 13, 15];

/// The coordinate that aligned instances get.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum AlignTo {
    /// The lowest of their centres.
    Lowest,
    /// The mean of their centres.
    #[default]
    Mean,
    /// The highest of their centres.
    Highest,
    /// The lowest of their lower ends, with their lower ends: they stand on one ground.
    Base,
}

/// A direction as a unit vector.
fn unit(axis: DVec3, what: &str) -> Result<DVec3, EditReason> {
    axis.try_normalize().ok_or_else(|| EditReason::value(format!("the {what} has no direction")))
}

/// Moves instances along an axis, each by its own distance.
fn slide(
    scene: &mut InstancedScene,
    chosen: Vec<usize>,
    axis: DVec3,
    distances: &[f64],
) -> Result<EditOutcome, EditReason> {
    let place = |(&k, &by): (&usize, &f64)| checked(moved(scene.instances[k].world_from_template, by * axis), k);
    let placements = chosen.iter().zip(distances).map(place).collect::<Result<Vec<_>, _>>()?;
    for (&k, placement) in chosen.iter().zip(placements) {
        scene.instances[k].world_from_template = placement;
    }
    Ok(EditOutcome { changed: chosen, ..EditOutcome::default() })
}

pub(super) fn align(
    scene: &mut InstancedScene,
    which: &Selector,
    axis: DVec3,
    to: AlignTo,
) -> Result<EditOutcome, EditReason> {
    let axis = unit(axis, "axis")?;
    let chosen = which.resolve(scene)?;
    if chosen.len() < 2 {
        return Err(EditReason::value("want two or more instances to align"));
    }
    let places: Vec<f64> = match to {
        AlignTo::Base => chosen.iter().map(|&k| instance_base(scene, k, axis)).collect(),
        _ => instance_centres(scene, chosen.iter().copied()).iter().map(|centre| axis.dot(*centre)).collect(),
    };
    let lowest = places.iter().copied().fold(f64::INFINITY, f64::min);
    let target = match to {
        AlignTo::Lowest | AlignTo::Base => lowest,
        AlignTo::Mean => places.iter().sum::<f64>() / places.len() as f64,
        AlignTo::Highest => places.iter().copied().fold(f64::NEG_INFINITY, f64::max),
    };
    let distances: Vec<f64> = places.iter().map(|place| target - place).collect();
    slide(scene, chosen, axis, &distances)
}

pub(super) fn distribute(scene: &mut InstancedScene, which: &Selector, axis: DVec3) -> Result<EditOutcome, EditReason> {
    let axis = unit(axis, "axis")?;
    let mut chosen = which.resolve(scene)?;
    if chosen.len() < 3 {
        return Err(EditReason::value("want three or more instances to distribute"));
    }
    let places: BTreeMap<usize, f64> = chosen
        .iter()
        .zip(instance_centres(scene, chosen.iter().copied()))
        .map(|(&k, centre)| (k, axis.dot(centre)))
        .collect();
    chosen.sort_by(|a, b| places[a].total_cmp(&places[b]));
    let [low, high] = [places[&chosen[0]], places[&chosen[chosen.len() - 1]]];
    let step = (high - low) / (chosen.len() - 1) as f64;
    let distances: Vec<f64> = chosen.iter().enumerate().map(|(i, k)| low + step * i as f64 - places[k]).collect();
    let mut outcome = slide(scene, chosen, axis, &distances)?;
    outcome.changed.sort_unstable();
    Ok(outcome)
}

/// Mirrors instances across a plane. A transform cannot mirror, so their templates get mirrored twins, which are shared and
/// found again: mirrored twice is as before.
pub(super) fn mirror(
    scene: &mut InstancedScene,
    which: &Selector,
    normal: DVec3,
    point: Option<DVec3>,
) -> Result<EditOutcome, EditReason> {
    let normal = unit(normal, "normal")?;
    let chosen = which.resolve(scene)?;
    let centres = instance_centres(scene, chosen.iter().copied());
    let point = point.unwrap_or_else(|| centres.iter().sum::<DVec3>() / centres.len() as f64);
    let across = DMat3::IDENTITY - 2.0 * DMat3::from_cols(normal.x * normal, normal.y * normal, normal.z * normal);
    let in_template = DMat3::from_diagonal(DVec3::new(-1.0, 1.0, 1.0));
    let place = |&k: &usize| {
        let old = scene.instances[k].world_from_template;
        let translation = across * (old.translation() - point) + point;
        checked(Similarity::from_parts(across * old.linear() * in_template, 1.0, translation), k)
    };
    let placements = chosen.iter().map(place).collect::<Result<Vec<_>, _>>()?;
    let mut outcome = EditOutcome::default();
    let twins = twins(scene, &chosen, &mut outcome)?;
    let runs = mirrored_runs(scene, &chosen, &mut outcome)?;
    let own = mirrored_own(scene, &chosen, &mut outcome);
    let mut freed = Vec::new();
    for (&k, placement) in chosen.iter().zip(placements) {
        let old = scene.instances[k].clone();
        freed.extend(run_of(scene, &old));
        let first_offset = old.first_offset.map(|first| runs[&(old.template, first)]);
        let name = kept_label(scene, k).map(|name| format!("{name} mirrored"));
        take_template(scene, k, twins[&old.template], name.as_deref());
        scene.instances[k].first_offset = first_offset;
        scene.instances[k].world_from_template = placement;
        if let Some(range) = own.get(&scene.own_range(k)) {
            scene.own_ranges[k] = *range;
        }
    }
    outcome.changed = chosen;
    release(scene, &freed, &mut outcome);
    Ok(outcome)
}

/// By template of the chosen instances, the index of its mirrored twin, which is added unless there is one.
fn twins(
    scene: &mut InstancedScene,
    chosen: &[usize],
    outcome: &mut EditOutcome,
) -> Result<BTreeMap<u32, u32>, EditReason> {
    let mut twins = BTreeMap::new();
    for &k in chosen {
        let template = scene.instances[k].template;
        if twins.contains_key(&template) {
            continue;
        }
        let cloud = mirrored(&scene.templates.range(scene.template_ranges[template as usize]));
        let ranges = scene.template_ranges.iter();
        let known =
            ranges.enumerate().find(|(_, r)| r.count as usize == cloud.len() && scene.templates.range(**r) == cloud);
        let twin = match known {
            Some((twin, _)) => twin as u32,
            None => add_template(scene, &cloud, outcome)?,
        };
        twins.insert(template, twin);
    }
    Ok(twins)
}

/// Appends a template; returns its index.
pub(super) fn add_template(
    scene: &mut InstancedScene,
    cloud: &Gaussians,
    outcome: &mut EditOutcome,
) -> Result<u32, EditReason> {
    let total = scene.templates.len() as u64 + cloud.len() as u64;
    if total > u64::from(u32::MAX) {
        return Err(EditReason::value(format!("{total} template Gaussians are too many")));
    }
    drop_foreign(scene, "template.", outcome);
    let range = SourceRange { first: scene.templates.len() as u32, count: cloud.len() as u32 };
    scene.templates.append(cloud);
    scene.template_ranges.push(range);
    Ok(scene.template_ranges.len() as u32 - 1)
}

/// The cloud mirrored in its plane x = 0.
fn mirrored(cloud: &Gaussians) -> Gaussians {
    let mut out = cloud.clone();
    out.means.iter_mut().for_each(|mean| mean[0] = -mean[0]);
    out.quats.iter_mut().for_each(mirror_quat);
    let coefficients = out.sh_coefficients();
    out.sh.chunks_exact_mut(coefficients).for_each(|sh| mirror_sh(sh, 0));
    out
}

/// The quaternion (w, x, y, z), or an offset of one, of the rotation mirrored in the plane x = 0.
fn mirror_quat(quat: &mut [f32; 4]) {
    quat[2] = -quat[2];
    quat[3] = -quat[3];
}

/// Mirrors the SH coefficients of a Gaussian; `first` is the index of the first of them.
fn mirror_sh(sh: &mut [[f32; 3]], first: usize) {
    for odd in ODD_IN_X.into_iter().filter_map(|odd| odd.checked_sub(first)) {
        if let Some(coefficient) = sh.get_mut(odd) {
            *coefficient = coefficient.map(|v| -v);
        }
    }
}

/// By template and first record of the chosen instances' runs of offsets, the first record of a mirrored copy.
fn mirrored_runs(
    scene: &mut InstancedScene,
    chosen: &[usize],
    outcome: &mut EditOutcome,
) -> Result<BTreeMap<(u32, u32), u32>, EditReason> {
    let mut runs = BTreeMap::new();
    for &k in chosen {
        let instance = &scene.instances[k];
        runs.extend(instance.first_offset.map(|first| ((instance.template, first), 0)));
    }
    let count = |template: u32| scene.template_ranges[template as usize].count;
    let records = runs.keys().map(|(template, _)| u64::from(count(*template))).sum();
    if records > 0 {
        offset_runs::reserve(scene, records)?;
        drop_foreign(scene, "offset.", outcome);
    }
    for (&(template, first), copy) in &mut runs {
        let count = scene.template_ranges[template as usize].count;
        *copy = offset_runs::append(scene, Some(first), count);
        let run = *copy as usize..(*copy + count) as usize;
        let offsets = &mut scene.offsets;
        let rest = offsets.rest_coefficients();
        offsets.means[run.clone()].iter_mut().for_each(|mean| mean[0] = -mean[0]);
        if !offsets.quats.is_empty() {
            offsets.quats[run.clone()].iter_mut().for_each(mirror_quat);
        }
        if rest > 0 {
            let of_run = &mut offsets.sh_rest[rest * run.start..rest * run.end];
            of_run.chunks_exact_mut(rest).for_each(|sh| mirror_sh(sh, 1));
        }
    }
    Ok(runs)
}

/// By range of own Gaussians of the chosen instances, that of a mirrored copy.
fn mirrored_own(
    scene: &mut InstancedScene,
    chosen: &[usize],
    outcome: &mut EditOutcome,
) -> BTreeMap<SourceRange, SourceRange> {
    let mut copies = BTreeMap::new();
    for range in chosen.iter().map(|&k| scene.own_range(k)).filter(|range| range.count > 0).collect::<Vec<_>>() {
        if copies.contains_key(&range) {
            continue;
        }
        drop_foreign(scene, "own.", outcome);
        let copy = SourceRange { first: scene.own.len() as u32, ..range };
        let cloud = mirrored(&scene.own.range(range));
        scene.own.append(&cloud);
        copies.insert(range, copy);
    }
    copies
}
