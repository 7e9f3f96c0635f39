//! Twin of `plan_slab`: selects the splats of the next depth slab.

/// Given the tile counts of all splats in depth order and the start of the slab, returns its end (exclusive) and its
/// number of intersections: the longest run of at most `max_splats` splats whose counts sum to at most `capacity`.
pub fn plan_slab(tile_counts: &[u32], begin: usize, capacity: u32, max_splats: usize) -> (usize, u32) {
    let (mut end, mut sum) = (begin, 0u64);
    while end < tile_counts.len() && end - begin < max_splats {
        let next = sum + u64::from(tile_counts[end]);
        if next > u64::from(capacity) {
            break;
        }
        (end, sum) = (end + 1, next);
    }
    (end, sum as u32)
}
