//! Boxes of a view overlap, but a mask has one id per pixel. So its ids number the *sets* of boxes that pixels lie in,
//! and one sweep over the view gives the exact contribution of a Gaussian to each box.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::segment::error::SegmentError;
use instgs_io::masks::Mask;
use instgs_vk::render::Contribution;

use super::placed::PlacedBox;

/// The set of boxes that each pixel of a view lies in.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct BoxSets {
    width: u32,
    /// Bands of identical rows, from the top.
    bands: Vec<Band>,
    /// By set: object ids, ascending; set 0 is empty.
    objects_of_set: Vec<Vec<u16>>,
}

/// A run of identical pixel rows.
#[derive(Clone, Debug, PartialEq)]
struct Band {
    rows: u32,
    /// From the left: number of columns, and the set that their pixels lie in.
    runs: Vec<(u32, u16)>,
}

/// Object id, and the columns and rows of its box.
type Area = (u16, [Range<u32>; 2]);

impl BoxSets {
    /// The sets of a picture of the given size, pixels; boxes without an object are ignored.
    ///
    /// # Errors
    /// More sets than 16-bit ids.
    pub(super) fn new(view: &str, [width, height]: [u32; 2], boxes: &[PlacedBox]) -> Result<Self, SegmentError> {
        let area = |b: &PlacedBox| {
            let [left, top, right, bottom] = b.bounds_px;
            (b.object, [pixels_between(left, right, width), pixels_between(top, bottom, height)])
        };
        let areas: Vec<Area> = boxes.iter().filter(|b| b.object != 0).map(area).collect();
        let (columns, rows) = (edges(&areas, 0, width), edges(&areas, 1, height));
        let mut number_of_set: BTreeMap<Vec<u16>, u16> = BTreeMap::from([(Vec::new(), 0)]);
        let mut bands = Vec::with_capacity(rows.len());
        for row in rows.windows(2) {
            let mut runs = Vec::with_capacity(columns.len());
            for column in columns.windows(2) {
                let set = objects_at(&areas, [column[0], row[0]]);
                let next = number_of_set.len();
                let number = match number_of_set.get(&set) {
                    Some(&number) => number,
                    None => u16::try_from(next).map_err(|_| SegmentError::TooManyBoxes { view: view.into() })?,
                };
                number_of_set.insert(set, number);
                runs.push((column[1] - column[0], number));
            }
            bands.push(Band { rows: row[1] - row[0], runs });
        }
        let mut objects_of_set = vec![Vec::new(); number_of_set.len()];
        number_of_set.into_iter().for_each(|(set, number)| objects_of_set[usize::from(number)] = set);
        Ok(Self { width, bands, objects_of_set })
    }

    /// By pixel: number of the set of boxes that contain its centre; 0 = none.
    pub(super) fn mask(&self) -> Mask {
        let mut ids = Vec::new();
        for band in &self.bands {
            let row: Vec<u16> =
                band.runs.iter().flat_map(|&(columns, set)| std::iter::repeat_n(set, columns as usize)).collect();
            (0..band.rows).for_each(|_| ids.extend_from_slice(&row));
        }
        Mask { width: self.width, height: self.bands.iter().map(|band| band.rows).sum(), ids }
    }

    /// Converts contributions to this view's sets, sorted by Gaussian, to contributions to objects, sorted by Gaussian
    /// and object. A pixel in several boxes counts for each; one in none is dropped.
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

/// Where boxes begin and end along an axis, with both ends of the picture; ascending, without repeats.
fn edges(areas: &[Area], axis: usize, count: u32) -> Vec<u32> {
    let mut out: Vec<u32> = areas.iter().flat_map(|(_, range)| [range[axis].start, range[axis].end]).collect();
    out.extend([0, count]);
    out.sort_unstable();
    out.dedup();
    out
}

/// Objects whose boxes contain a pixel, ascending.
fn objects_at(areas: &[Area], pixel: [u32; 2]) -> Vec<u16> {
    let has = |(_, ranges): &&Area| ranges.iter().zip(&pixel).all(|(range, at)| range.contains(at));
    let mut out: Vec<u16> = areas.iter().filter(has).map(|(object, _)| *object).collect();
    out.sort_unstable();
    out.dedup();
    out
}

/// The pixels of `0..count` whose centres lie between two coordinates, inclusive.
fn pixels_between(low: f64, high: f64, count: u32) -> Range<u32> {
    // Both are within the picture, so the casts are exact.
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
        let mask = sets.mask();
        assert_eq!((mask.width, mask.height, mask.ids.len()), (5, 3, 15));
        for (i, &set) in mask.ids.iter().enumerate() {
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
        let number = |x: usize, y: usize| mask.ids[y * 5 + x];
        let (alone, both) = (number(0, 0), number(2, 1));
        let found = sets.by_object(&[entry(1, 0, 5), entry(1, alone, 3), entry(1, both, 4), entry(3, both, 1)]);
        assert_eq!(found, [entry(1, 4, 4), entry(1, 9, 7), entry(3, 4, 1), entry(3, 9, 1)]);
    }
}
