//! Twin of passes `radix_sort_*`: a stable sort of (key, value) pairs by u32 key.

/// Maps positive depths to u32 keys of the same order: the bits of the f32. Depths are > near >= 0 here; negative
/// numbers would sort in reverse and are not valid.
pub fn depth_key(depth: f32) -> u32 {
    depth.to_bits()
}

/// Keys and values in ascending key order; equal keys keep their input order.
pub fn sort_pairs(keys: &[u32], values: &[u32]) -> (Vec<u32>, Vec<u32>) {
    assert_eq!(keys.len(), values.len(), "one value per key");
    let mut order: Vec<usize> = (0..keys.len()).collect();
    order.sort_by_key(|&i| keys[i]);
    (order.iter().map(|&i| keys[i]).collect(), order.iter().map(|&i| values[i]).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_keys_keep_their_order() {
        let (keys, values) = sort_pairs(&[5, 1, 5, u32::MAX, 0, 1], &[0, 1, 2, 3, 4, 5]);
        assert_eq!((keys, values), (vec![0, 1, 1, 5, 5, u32::MAX], vec![4, 1, 5, 0, 2, 3]));
    }

    #[test]
    fn depth_keys_order_as_depths() {
        let depths = [f32::MIN_POSITIVE, 1e-3, 0.2, 0.200_000_02, 1.0, 7.5, 1e30, f32::INFINITY];
        assert!(depths.windows(2).all(|w| depth_key(w[0]) < depth_key(w[1])));
    }
}
