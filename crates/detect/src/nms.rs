//! Suppression of boxes that repeat each other.

use super::boxes::Detection;

/// Left, top, right, bottom in pixels.
pub type BoxPx = [f64; 4];

/// Area of the intersection of both boxes over that of their union, 0..=1; 0 if neither has an area.
pub fn intersection_over_union(a: &BoxPx, b: &BoxPx) -> f64 {
    let area = |[left, top, right, bottom]: &BoxPx| (right - left).max(0.0) * (bottom - top).max(0.0);
    let both = area(&[a[0].max(b[0]), a[1].max(b[1]), a[2].min(b[2]), a[3].min(b[3])]);
    let any = area(a) + area(b) - both;
    if any > 0.0 { both / any } else { 0.0 }
}

/// Drops each box that overlaps an earlier kept one with the same phrase by more than `overlap`; returns how many.
/// Boxes must be sorted by falling score.
pub fn drop_repeated(boxes: &mut Vec<Detection>, overlap: f64) -> usize {
    let before = boxes.len();
    let mut kept: Vec<Detection> = Vec::with_capacity(before);
    for found in boxes.drain(..) {
        let repeats =
            |k: &Detection| k.phrase == found.phrase && intersection_over_union(&k.box_px, &found.box_px) > overlap;
        if !kept.iter().any(repeats) {
            kept.push(found);
        }
    }
    *boxes = kept;
    before - boxes.len()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn overlaps_are_shares_of_the_union() {
        let unit = [0.0, 0.0, 1.0, 1.0];
        assert_eq!(intersection_over_union(&unit, &unit), 1.0);
        assert_eq!(intersection_over_union(&unit, &[0.5, 0.0, 1.5, 1.0]), 1.0 / 3.0);
        assert_eq!(intersection_over_union(&unit, &[2.0, 0.0, 3.0, 1.0]), 0.0);
        assert_eq!(intersection_over_union(&[0.0; 4], &[0.0; 4]), 0.0);
        assert_eq!(intersection_over_union(&unit, &[1.0, 1.0, 0.0, 0.0]), 0.0);
    }

    #[test]
    fn only_kept_boxes_drop_others() {
        let at = |left: f64, phrase| Detection { phrase, score: 0.5, box_px: [left, 0.0, left + 10.0, 10.0] };
        // The second overlaps the first and the third by 2/3 each, and those two overlap by 1/2.
        let mut boxes = vec![at(0.0, 0), at(2.0, 0), at(3.3, 0), at(0.0, 1)];
        assert_eq!(drop_repeated(&mut boxes, 0.6), 1);
        assert_eq!(boxes, [at(0.0, 0), at(3.3, 0), at(0.0, 1)]);
        assert_eq!(drop_repeated(&mut boxes, 0.6), 0);
    }
}
