//! Shifting base colours: in the template if all of its instances are selected, so that what is made of it later has the colour as
//! well; otherwise in the colour matrices of instances if the scene has them, else in offsets; and in instances' own Gaussians.

use std::collections::{BTreeMap, BTreeSet};

use crate::math::sh::SH_C0;
use crate::scene::edit::membership::drop_foreign;
use crate::scene::edit::{EditOutcome, EditReason, Selector, offset_runs, own};
use crate::scene::instanced_scene::{InstancedScene, SourceRange};

/// Upper limit on a shift, in units of colour: far beyond any picture.
const LARGEST_SHIFT: f32 = 1e6;

pub(super) fn recolour(scene: &mut InstancedScene, which: &Selector, rgb: [f32; 3]) -> Result<EditOutcome, EditReason> {
    if !rgb.iter().all(|v| v.abs() <= LARGEST_SHIFT) {
        return Err(EditReason::value(format!(
            "{rgb:?} is not a colour shift: want three numbers, 1 being the difference of black and white"
        )));
    }
    let mut outcome = EditOutcome { changed: which.resolve(scene)?, ..EditOutcome::default() };
    // Colour is SH_C0 times the coefficient plus a constant.
    let d_sh_dc = rgb.map(|v| (f64::from(v) / SH_C0) as f32);
    let whole = if which.is_collective() { whole_templates(scene, &outcome.changed) } else { BTreeSet::new() };
    let has_matrices = !scene.color_from_template.is_empty();
    if has_matrices {
        // Coefficients and offsets are before the matrix, which changes the shift of a template, too.
        let shifted = |&k: &usize| {
            let in_template = if whole.contains(&scene.instances[k].template) { rgb } else { [0.0; 3] };
            let mut matrix = scene.color_from_template[k];
            for (row, by) in matrix.iter_mut().zip(rgb) {
                let of_template: f32 = (0..3).map(|c| row[c] * in_template[c]).sum();
                row[3] += by - of_template;
            }
            matrix.as_flattened().iter().all(|v| v.is_finite()).then_some(matrix)
        };
        let Some(matrices) = outcome.changed.iter().map(shifted).collect::<Option<Vec<_>>>() else {
            return Err(EditReason::value(format!("{rgb:?} is too large for the colour matrices of these instances")));
        };
        outcome.changed.iter().zip(matrices).for_each(|(&k, matrix)| scene.color_from_template[k] = matrix);
    }
    let mut members_of_run: BTreeMap<(u32, Option<u32>), Vec<usize>> = BTreeMap::new();
    for &k in &outcome.changed {
        let instance = &scene.instances[k];
        if !has_matrices && !whole.contains(&instance.template) {
            members_of_run.entry((instance.template, instance.first_offset)).or_default().push(k);
        }
    }
    own_runs(scene, &mut members_of_run, &mut outcome)?;
    shift_own(scene, d_sh_dc, &mut outcome);
    for &template in &whole {
        let range = scene.template_ranges[template as usize];
        let coefficients = scene.templates.sh_coefficients();
        let first = range.first as usize * coefficients;
        let rows = scene.templates.sh[first..].iter_mut().step_by(coefficients).take(range.count as usize);
        rows.for_each(|sh_dc| shift(sh_dc, d_sh_dc));
    }
    for (template, run) in members_of_run.into_keys() {
        let Some(first) = run else { continue };
        let run = first as usize..first as usize + scene.template_ranges[template as usize].count as usize;
        scene.offsets.sh_dc[run].iter_mut().for_each(|sh_dc| shift(sh_dc, d_sh_dc));
    }
    Ok(outcome)
}

/// Shifts the instances' own Gaussians, which no matrix or offset reaches.
fn shift_own(scene: &mut InstancedScene, d_sh_dc: [f32; 3], outcome: &mut EditOutcome) {
    let chosen = outcome.changed.clone();
    let mut own: Vec<usize> =
        own::unshare(scene, &chosen, outcome).into_iter().flat_map(SourceRange::indices).collect();
    own.sort_unstable();
    own.dedup();
    let coefficients = scene.own.sh_coefficients();
    own.into_iter().for_each(|i| shift(&mut scene.own.sh[i * coefficients], d_sh_dc));
}

fn shift(sh_dc: &mut [f32; 3], by: [f32; 3]) {
    sh_dc.iter_mut().zip(by).for_each(|(value, by)| *value += by);
}

/// Templates that have all their instances among `chosen` and share no Gaussians with another template in use.
fn whole_templates(scene: &InstancedScene, chosen: &[usize]) -> BTreeSet<u32> {
    let mut left = vec![0; scene.template_ranges.len()];
    scene.instances.iter().for_each(|i| left[i.template as usize] += 1);
    let used: Vec<bool> = left.iter().map(|&count| count > 0).collect();
    chosen.iter().for_each(|&k| left[scene.instances[k].template as usize] -= 1);
    let alone = |template: usize| {
        let range = scene.template_ranges[template];
        scene
            .template_ranges
            .iter()
            .enumerate()
            .all(|(other, &r)| other == template || !used[other] || !r.overlaps(range))
    };
    (0..left.len()).filter(|&t| used[t] && left[t] == 0 && alone(t)).map(|t| t as u32).collect()
}

/// Makes the runs of the members unshared with other instances: keeps their own run, copies a shared one, or appends
/// zeros; the keys then name the new run. Members of the same run continue to share it.
fn own_runs(
    scene: &mut InstancedScene,
    members_of_run: &mut BTreeMap<(u32, Option<u32>), Vec<usize>>,
    outcome: &mut EditOutcome,
) -> Result<(), EditReason> {
    let users = offset_runs::users_of_records(scene);
    let count_of = |template: u32| scene.template_ranges[template as usize].count;
    let shared = |&(template, first): &(u32, Option<u32>), members: usize| match first {
        Some(first) => users[first as usize..(first + count_of(template)) as usize].iter().any(|&u| u != members),
        None => true,
    };
    let to_copy: Vec<_> =
        members_of_run.iter().filter(|(key, members)| shared(key, members.len())).map(|(key, _)| *key).collect();
    let records = to_copy.iter().map(|&(template, _)| u64::from(count_of(template))).sum();
    if records > 0 {
        offset_runs::reserve(scene, records)?;
        drop_foreign(scene, "offset.", outcome);
    }
    for (template, source) in to_copy {
        let count = scene.template_ranges[template as usize].count;
        let first = offset_runs::append(scene, source, count);
        let members = members_of_run.remove(&(template, source)).unwrap_or_default();
        members.iter().for_each(|&k| scene.instances[k].first_offset = Some(first));
        members_of_run.insert((template, Some(first)), members);
    }
    Ok(())
}
