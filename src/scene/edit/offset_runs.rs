//! Runs of offset records: use counts, copies, and removal of unused ones.

use crate::scene::edit::EditReason;
use crate::scene::instanced_scene::InstancedScene;
use crate::scene::offsets::Offsets;

/// For every offset record, the number of instances that use it.
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

/// Reserves memory for more records, so that appending them cannot fail.
///
/// # Errors
/// The text says how many records there would be.
pub(super) fn reserve(scene: &mut InstancedScene, records: u64) -> Result<(), EditReason> {
    let total = scene.offsets.len() as u64 + records;
    let failed = || EditReason::OffsetRecords { total };
    // In files the largest index means "no offsets".
    if total >= u64::from(u32::MAX) {
        return Err(failed());
    }
    let records = usize::try_from(records).map_err(|_| failed())?;
    let rows = rows_per_record(&scene.offsets);
    let mut arrays = scene.offsets.arrays_mut().into_iter().zip(rows);
    arrays.try_for_each(|((_, array), rows)| array.try_reserve_rows(records * rows)).map_err(|_| failed())
}

/// Rows of a record by array.
fn rows_per_record(offsets: &Offsets) -> Vec<usize> {
    offsets.arrays().iter().map(|(parameter, array)| offsets.rows_per_record(*parameter, *array)).collect()
}

/// Appends a run, either a copy of the one at `source` or zeros; returns the index of its first record.
pub(super) fn append(scene: &mut InstancedScene, source: Option<u32>, count: u32) -> u32 {
    let first = scene.offsets.len() as u32;
    let rows = rows_per_record(&scene.offsets);
    for ((_, array), rows) in scene.offsets.arrays_mut().into_iter().zip(rows) {
        array.append_rows(source.map(|first| first as usize * rows), count as usize * rows);
    }
    first
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
