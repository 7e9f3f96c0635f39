//! Twin of pass `scan`: exclusive prefix sum of u32 counts that saturates instead of wrapping, so that an overflow
//! shows as u32::MAX and never as a small number.

/// `out[i]` = sum of `counts[..i]`, and the total; both saturate at u32::MAX.
pub fn exclusive_scan(counts: &[u32]) -> (Vec<u32>, u32) {
    let mut sum = 0u32;
    let mut out = Vec::with_capacity(counts.len());
    for &count in counts {
        out.push(sum);
        sum = sum.saturating_add(count);
    }
    (out, sum)
}

#[cfg(test)]
mod tests {
    use super::exclusive_scan;

    #[test]
    fn small_empty_and_saturating() {
        assert_eq!(exclusive_scan(&[]), (vec![], 0));
        assert_eq!(exclusive_scan(&[3, 0, 2]), (vec![0, 3, 3], 5));
        let max = u32::MAX;
        assert_eq!(exclusive_scan(&[max - 1, 1, 1, 7]), (vec![0, max - 1, max, max], max));
    }
}
