//! Twin of `emit_work_items` and `compact_visible`: ordered compaction.

/// Indices of the elements whose flag is set, in ascending order.
pub fn compact(wanted: &[bool]) -> Vec<u32> {
    (0..wanted.len() as u32).filter(|&i| wanted[i as usize]).collect()
}
