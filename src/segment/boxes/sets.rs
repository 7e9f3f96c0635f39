//! Boxes of a view overlap, and a mask has one id per pixel. So the ids are numbers of *sets* of boxes: one sweep over the
//! view then gives what a Gaussian adds to each box, exactly.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::io::masks::Mask;
use crate::render::Contribution;
use crate::segment::error::SegmentError;

use super::placed::PlacedBox;

/// The boxes that each pixel of a view lies in.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct BoxSets {
    /// By pixel: number of the set of the boxes that its centre lies in; 0 = in none.
    pub(super) mask: Mask,
    /// By set: objects, ascending.
    objects_of_set: Vec<Vec<u16>>,
}

impl BoxSets {
    /// Of a picture of the given size; boxes without an object are left out.
    ///
    /// # Errors
    /// More sets than ids.
    pub(super) fn new(view: &str, [width, height]: [u32; 2], boxes: &[PlacedBox]) -> Result<Self, SegmentError> {
        let known: Vec<(u16, Range<u32>, Range<u32>)> = boxes
            .iter()
            .filter(|b| b.object != 0)
            .map(|b| {
                let [left, top, right, bottom] = b.bounds_px;
                (b.object, pixels_between(left, right, width), pixels_between(top, bottom, height))
            })
            .collect();
        let mut edges: Vec<u32> = known.iter().flat_map(|(_, columns, _)| [columns.start, columns.end]).collect();
        edges.extend([0, width]);
        edges.sort_unstable();
        edges.dedup();
        let mut number_of_set: BTreeMap<Vec<u16>, u16> = BTreeMap::from([(Vec::new(), 0)]);
        let mut ids = Vec::with_capacity(width as usize * height as usize);
        for row in 0..height {
            for run in edges.windows(2) {
                let is_in = |(_, columns, rows): &&(u16, Range<u32>, Range<u32>)| {
                    columns.contains(&run[0]) && rows.contains(&row)
                };
                let mut set: Vec<u16> = known.iter().filter(is_in).map(|(object, ..)| *object).collect();
                set.sort_unstable();
                set.dedup();
                let next = u16::try_from(number_of_set.len());
                let number = match number_of_set.get(&set) {
                    Some(&number) => number,
                    None => *number_of_set
                        .entry(set)
                        .or_insert(next.map_err(|_| SegmentError::TooManyBoxes { view: view.into() })?),
                };
                ids.resize(ids.len() + (run[1] - run[0]) as usize, number);
            }
        }
        let mut objects_of_set = vec![Vec::new(); number_of_set.len()];
        number_of_set.into_iter().for_each(|(set, number)| objects_of_set[usize::from(number)] = set);
        Ok(Self { mask: Mask { width, height, ids }, objects_of_set })
    }

    /// Contributions to this view's sets, by Gaussian, as contributions to the boxes of objects, by Gaussian, then by
    /// object. What is in several boxes counts for each; what is in none is left out.
    pub(super) fn by_object(&self, contributions: &[Contribution]) -> Vec<Contribution> {
        let mut out: Vec<Contribution> = Vec::new();
        for of_gaussian in contributions.chunk_by(|a, b| a.gaussian == b.gaussian) {
            let mut weights: BTreeMap<u16, u64> = BTreeMap::new();
            for c in of_gaussian {
                for &object in self.objects_of_set.get(usize::from(c.id)).into_iter().flatten() {
                    *weights.entry(object).or_default() += c.weight;
                }
            }
            let gaussian = of_gaussian[0].gaussian;
            out.extend(weights.into_iter().map(|(id, weight)| Contribution { gaussian, id, weight }));
        }
        out
    }
}

/// The pixels of `0..count` whose centres lie between two places, edges included.
fn pixels_between(low: f64, high: f64, count: u32) -> Range<u32> {
    // Saturating casts: places are within the picture.
    let first = (low - 0.5).ceil().max(0.0) as u32;
    let end = ((high - 0.5).floor() + 1.0).max(0.0) as u32;
    first.min(count)..end.min(count).max(first.min(count))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn placed(object: u16, bounds_px: [f64; 4]) -> PlacedBox {
        PlacedBox { object, category: None, bounds_px }
    }

    #[test]
    fn every_pixel_has_the_boxes_that_its_centre_lies_in() {
        let boxes = [
            placed(9, [0.0, 0.0, 3.0, 2.0]),
            placed(4, [1.6, 0.5, 5.0, 3.0]),
            placed(0, [0.0, 0.0, 5.0, 3.0]),
            placed(2, [1.6, 0.6, 1.9, 0.9]),
        ];
        let sets = BoxSets::new("a", [5, 3], &boxes).unwrap();
        for (i, &set) in sets.mask.ids.iter().enumerate() {
            let (x, y) = ((i % 5) as f64 + 0.5, (i / 5) as f64 + 0.5);
            let is_in = |b: &&PlacedBox| {
                let [left, top, right, bottom] = b.bounds_px;
                b.object != 0 && left <= x && x <= right && top <= y && y <= bottom
            };
            let mut want: Vec<u16> = boxes.iter().filter(is_in).map(|b| b.object).collect();
            want.sort_unstable();
            assert_eq!(sets.objects_of_set[usize::from(set)], want, "pixel {x} {y}");
        }
        assert_eq!(sets.objects_of_set[0], [0u16; 0]);
        let entry = |gaussian, id, weight| Contribution { gaussian, id, weight };
        let number = |x: usize, y: usize| sets.mask.ids[y * 5 + x];
        let (alone, both) = (number(0, 0), number(2, 1));
        let found = sets.by_object(&[entry(1, 0, 5), entry(1, alone, 3), entry(1, both, 4), entry(3, both, 1)]);
        assert_eq!(found, [entry(1, 4, 4), entry(1, 9, 7), entry(3, 4, 1), entry(3, 9, 1)]);
    }
}
