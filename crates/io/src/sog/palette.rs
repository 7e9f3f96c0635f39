//! Palettes: up to 65536 rows of numbers that stand for many, by k-means in two levels.
//!
//! One k-means with all entries would compare every row with every entry: minutes for a million rows. So the rows are cut into
//! groups of similar ones first, about twice the square root of the number of entries, and each group gets entries in
//! proportion to its different rows. Equal rows count as one, with a weight in means: otherwise a group of equal rows would get as
//! many equal entries, and take most of the time. The same rows give the same palette.

use std::collections::HashMap;

use rayon::prelude::*;

use instgs_vk::math::rng::Rng;

/// Numbers of a row are padded with zeros to a multiple of that: one vector register of sums.
const LANES: usize = 8;
/// Steps of k-means for the groups, and for the entries of a group.
const GROUP_STEPS: usize = 6;
const ENTRY_STEPS: usize = 5;
/// Rows from which the groups are made.
const SAMPLE: usize = 1 << 16;
/// Seed of the choice of those rows.
const SEED: u64 = 0x50A1;
/// Rows per task when rows are compared with entries.
const TASK_ROWS: usize = 256;

/// Rows of equally many numbers.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Rows {
    values: Vec<f32>,
    stride: usize,
}

impl Rows {
    /// No rows, of at least one number each.
    pub(super) fn new(width: usize) -> Self {
        Self { values: Vec::new(), stride: width.max(1).next_multiple_of(LANES) }
    }

    /// Appends a row, which is cut or padded with zeros to the width.
    pub(super) fn push(&mut self, row: &[f32]) {
        let end = self.values.len() + self.stride;
        self.values.extend(row.iter().take(self.stride));
        self.values.resize(end, 0.0);
    }

    pub(super) fn len(&self) -> usize {
        self.values.len() / self.stride
    }

    /// The numbers of a row, with its padding.
    pub(super) fn row(&self, i: usize) -> &[f32] {
        &self.values[i * self.stride..][..self.stride]
    }

    /// Some of the rows.
    fn chosen(&self, rows: impl Iterator<Item = usize>) -> Self {
        let mut out = Self { values: Vec::new(), stride: self.stride };
        rows.for_each(|i| out.values.extend_from_slice(self.row(i)));
        out
    }

    /// Index of the row that is nearest to another one.
    fn nearest(&self, row: &[f32]) -> usize {
        let mut best = (0, f32::INFINITY);
        for (i, candidate) in self.values.chunks_exact(self.stride).enumerate() {
            let distance = squared_distance(candidate, row);
            if distance < best.1 {
                best = (i, distance);
            }
        }
        best.0
    }
}

/// The squared distance, in sums that a processor adds up side by side.
fn squared_distance(a: &[f32], b: &[f32]) -> f32 {
    let mut sums = [0f32; LANES];
    for (a, b) in a.as_chunks::<LANES>().0.iter().zip(b.as_chunks::<LANES>().0) {
        // By index: chains of iterators are not always inlined, and this is all that palettes take time for.
        for lane in 0..LANES {
            let difference = a[lane] - b[lane];
            sums[lane] += difference * difference;
        }
    }
    sums.iter().sum()
}

/// Entries of a palette, and the entry of every row.
pub(super) struct Palette {
    pub(super) entries: Rows,
    pub(super) labels: Vec<u16>,
}

/// A palette of at most `most` entries, up to 65536. As many rows or fewer are its entries themselves.
pub(super) fn palette(rows: &Rows, most: usize) -> Palette {
    if rows.len() <= most {
        return Palette { entries: rows.clone(), labels: (0..rows.len()).map(|i| i as u16).collect() };
    }
    let distinct = Distinct::of(rows);
    let Palette { entries, labels } = palette_of_distinct(&distinct, most);
    Palette { entries, labels: distinct.index.iter().map(|&i| labels[i as usize]).collect() }
}

/// Rows that differ from each other.
struct Distinct {
    rows: Rows,
    /// How many equal ones each stands for.
    weights: Vec<u32>,
    /// By original row, its place among these.
    index: Vec<u32>,
}

impl Distinct {
    fn of(rows: &Rows) -> Self {
        let mut places: HashMap<&[u8], u32> = HashMap::new();
        let mut out = Self { rows: rows.chosen(std::iter::empty()), weights: Vec::new(), index: Vec::new() };
        for i in 0..rows.len() {
            let place = *places.entry(bytemuck::cast_slice(rows.row(i))).or_insert(out.weights.len() as u32);
            if place as usize == out.weights.len() {
                out.rows.values.extend_from_slice(rows.row(i));
                out.weights.push(0);
            }
            out.weights[place as usize] += 1;
            out.index.push(place);
        }
        out
    }
}

fn palette_of_distinct(distinct: &Distinct, most: usize) -> Palette {
    let rows = &distinct.rows;
    if rows.len() <= most {
        return Palette { entries: rows.clone(), labels: (0..rows.len()).map(|i| i as u16).collect() };
    }
    let groups = groups(distinct, most);
    let used = groups.iter().filter(|group| !group.is_empty()).count();
    let spare = most.saturating_sub(used);
    let cut = |group: &Vec<usize>| {
        let count = (1 + spare * group.len() / rows.len()).min(group.len());
        let first = rows.chosen((0..count).map(|k| group[k * group.len() / count]));
        if count == group.len() { (first, (0..count).collect()) } else { k_means(distinct, group, first, ENTRY_STEPS) }
    };
    let parts: Vec<(Rows, Vec<usize>)> = groups.par_iter().map(cut).collect();
    let mut out = Palette { entries: rows.chosen(std::iter::empty()), labels: vec![0; rows.len()] };
    for (group, (entries, labels)) in groups.iter().zip(parts) {
        let first = out.entries.len();
        group.iter().zip(labels).for_each(|(&i, label)| out.labels[i] = (first + label) as u16);
        out.entries.values.extend_from_slice(&entries.values);
    }
    out
}

/// Indices of similar rows, in ascending order.
fn groups(distinct: &Distinct, entries: usize) -> Vec<Vec<usize>> {
    let rows = &distinct.rows;
    let count = (2 * entries.isqrt()).clamp(1, entries.max(1));
    let mut sample: Vec<usize> = (0..rows.len()).collect();
    Rng::new(SEED).shuffle(&mut sample);
    sample.truncate(SAMPLE);
    let first = rows.chosen(sample.iter().copied().take(count));
    let (centres, _) = k_means(distinct, &sample, first, GROUP_STEPS);
    let all: Vec<usize> = (0..rows.len()).collect();
    let mut out = vec![Vec::new(); centres.len()];
    for (i, group) in nearest_of(rows, &all, &centres).into_iter().enumerate() {
        out[group].push(i);
    }
    out
}

/// By chosen row, the index of its nearest centre.
fn nearest_of(rows: &Rows, chosen: &[usize], centres: &Rows) -> Vec<usize> {
    chosen.par_iter().with_min_len(TASK_ROWS).map(|&i| centres.nearest(rows.row(i))).collect()
}

/// Centres of the chosen rows and each row's centre, from first centres. A centre without rows stays where it is.
fn k_means(distinct: &Distinct, chosen: &[usize], first: Rows, steps: usize) -> (Rows, Vec<usize>) {
    let rows = &distinct.rows;
    let mut centres = first;
    for _ in 0..steps {
        let nearest = nearest_of(rows, chosen, &centres);
        let mut sums = vec![0f64; centres.values.len()];
        let mut counts = vec![0u32; centres.len()];
        for (&i, &centre) in chosen.iter().zip(&nearest) {
            let weight = distinct.weights[i];
            counts[centre] += weight;
            let sum = &mut sums[centre * rows.stride..][..rows.stride];
            sum.iter_mut().zip(rows.row(i)).for_each(|(sum, &v)| *sum += f64::from(weight) * f64::from(v));
        }
        let of_centres = centres.values.chunks_exact_mut(rows.stride).zip(sums.chunks_exact(rows.stride));
        for ((centre, sum), count) in of_centres.zip(counts).filter(|(_, count)| *count > 0) {
            centre.iter_mut().zip(sum).for_each(|(v, &sum)| *v = (sum / f64::from(count)) as f32);
        }
    }
    let nearest = nearest_of(rows, chosen, &centres);
    (centres, nearest)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// `count` rows of 9 numbers around 20 points, whose spread is a hundredth of their distance.
    fn clustered(count: usize) -> Rows {
        let mut rng = Rng::new(3);
        let centres: Vec<Vec<f64>> = (0..20).map(|_| (0..9).map(|_| rng.normal()).collect()).collect();
        let mut rows = Rows::new(9);
        for i in 0..count {
            let row: Vec<f32> = centres[i * 7 % 20].iter().map(|v| (v + 0.01 * rng.normal()) as f32).collect();
            rows.push(&row);
        }
        rows
    }

    fn rms(rows: &Rows, palette: &Palette) -> f32 {
        let error = |(i, &label): (usize, &u16)| squared_distance(rows.row(i), palette.entries.row(usize::from(label)));
        (palette.labels.iter().enumerate().map(error).sum::<f32>() / rows.len() as f32).sqrt()
    }

    #[test]
    fn few_rows_are_their_own_entries() {
        let rows = clustered(50);
        let palette = palette(&rows, 50);
        assert_eq!((&palette.entries, palette.labels.len()), (&rows, 50));
        assert_eq!(rms(&rows, &palette), 0.0);
    }

    #[test]
    fn entries_lie_in_the_clusters() {
        let rows = clustered(3000);
        let palette = palette(&rows, 256);
        assert!(palette.entries.len() <= 256 && palette.entries.len() > 128, "{}", palette.entries.len());
        assert!(palette.labels.iter().all(|&label| usize::from(label) < palette.entries.len()));
        // Nine deviations of 0.01 if each cluster had one entry.
        let error = rms(&rows, &palette);
        assert!(error < 0.03, "{error}");
        let again = super::palette(&rows, 256);
        assert!(again.entries == palette.entries && again.labels == palette.labels);
    }

    #[test]
    fn equal_rows_and_padding_do_no_harm() {
        let mut rows = Rows::new(45);
        (0..3000).for_each(|_| rows.push(&[0.25; 45]));
        assert_eq!((rows.len(), rows.row(0).len()), (3000, 48));
        assert_eq!(rms(&rows, &palette(&rows, 1024)), 0.0);
        // 3,000 more that differ, for 1,024 entries: the equal ones keep an entry of their own.
        let mut rng = Rng::new(6);
        (0..3000).for_each(|_| rows.push(&std::array::from_fn::<f32, 45, _>(|_| 4.0 + rng.normal() as f32)));
        let palette = palette(&rows, 1024);
        assert!(palette.labels[..3000].iter().all(|&label| label == palette.labels[0]));
        assert_eq!(palette.entries.row(palette.labels[0].into()), rows.row(0));
        assert!(palette.entries.len() > 512, "{}", palette.entries.len());
    }
}
