//! Runs of offset records: who uses them, copies, and removal of those that nobody uses.

use crate::scene::edit::EditReason;
use crate::scene::instanced_scene::InstancedScene;
use crate::scene::offsets::Offsets;

/// For every offset record, how many instances use it.
pub(super) fn users_of_records(scene: &InstancedScene) -> Vec<usize> {
    let mut steps = vec![0isize; scene.offsets.len() + 1];
    for instance in &scene.instances {
        if let Some(first) = instance.first_offset {
            let count = scene.template_ranges[instance.template as usize].count;
            steps[first as usize] += 1;
            steps[first as usize + count as usize] -= 1;
        }
    }
    let mut users = 0;
    steps.pop();
    steps.iter().map(|step| (users += step, users as usize).1).collect()
}

/// Makes room for more records, so that appending them cannot fail; the error says how many there would be.
pub(super) fn reserve(scene: &mut InstancedScene, records: u64) -> Result<(), EditReason> {
    let total = scene.offsets.len() as u64 + records;
    let failed = || EditReason::OffsetRecords { total };
    // The largest index says "no offsets" in files.
    if total >= u64::from(u32::MAX) {
        return Err(failed());
    }
    let records = usize::try_from(records).map_err(|_| failed())?;
    let rest = scene.templates.sh_coefficients() - 1;
    let Offsets { means, sh_dc, opacity_logits, sh_rest, log_scales, quats } = &mut scene.offsets;
    let optional = |present: bool, count: usize| if present { count } else { 0 };
    let reserved = means
        .try_reserve(records)
        .and_then(|()| sh_dc.try_reserve(records))
        .and_then(|()| opacity_logits.try_reserve(records))
        .and_then(|()| sh_rest.try_reserve(optional(!sh_rest.is_empty(), records * rest)))
        .and_then(|()| log_scales.try_reserve(optional(!log_scales.is_empty(), records)))
        .and_then(|()| quats.try_reserve(optional(!quats.is_empty(), records)));
    reserved.map_err(|_| failed())
}

/// Appends a run: a copy of the one at `source`, or zeros; returns its first record.
pub(super) fn append(scene: &mut InstancedScene, source: Option<u32>, count: u32) -> u32 {
    let rest = scene.templates.sh_coefficients() - 1;
    let (source, count) = (source.map(|first| first as usize), count as usize);
    let offsets = &mut scene.offsets;
    let first = offsets.len() as u32;
    extend(&mut offsets.means, source, count, 1);
    extend(&mut offsets.sh_dc, source, count, 1);
    extend(&mut offsets.opacity_logits, source, count, 1);
    if !offsets.sh_rest.is_empty() {
        extend(&mut offsets.sh_rest, source, count, rest);
    }
    if !offsets.log_scales.is_empty() {
        extend(&mut offsets.log_scales, source, count, 1);
    }
    if !offsets.quats.is_empty() {
        extend(&mut offsets.quats, source, count, 1);
    }
    first
}

fn extend<T: Copy + Default>(values: &mut Vec<T>, source: Option<usize>, count: usize, per_record: usize) {
    match source {
        Some(first) => values.extend_from_within(first * per_record..(first + count) * per_record),
        None => values.resize(values.len() + count * per_record, T::default()),
    }
}

/// Removes the records of `freed` runs (first, count) that no instance uses.
pub(super) fn release(scene: &mut InstancedScene, freed: &[(u32, u32)]) {
    let users = users_of_records(scene);
    let mut keep = vec![true; users.len()];
    for &(first, count) in freed {
        let run = first as usize..(first + count) as usize;
        keep[run.clone()].iter_mut().zip(&users[run]).for_each(|(keep, &users)| *keep = users > 0);
    }
    if keep.iter().all(|&k| k) {
        return;
    }
    let mut kept = Offsets::default();
    (0..keep.len()).filter(|&m| keep[m]).for_each(|m| kept.push_from(&scene.offsets, m));
    scene.offsets = kept;
    let mut kept_before = vec![0u32];
    keep.iter().fold(0, |count, &k| {
        kept_before.push(count + u32::from(k));
        count + u32::from(k)
    });
    for first in scene.instances.iter_mut().filter_map(|i| i.first_offset.as_mut()) {
        *first = kept_before[*first as usize];
    }
}
