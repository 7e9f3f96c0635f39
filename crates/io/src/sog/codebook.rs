//! Codebooks: 256 values that stand for many, by k-means in one dimension.

use rayon::prelude::*;

use crate::sog::meta::CODEBOOK_LEN;

/// Runs of equally many values whose widths give the first guess.
const RUNS: usize = 4096;
/// Steps of k-means; the first guess is near the optimum already.
const STEPS: usize = 60;
/// Values are most useful where their density is high, but sparse ones must not be far off: the optimal density of a
/// codebook is the cube root of that of the values (Panter and Dite 1951), which gives a run of width w the share w^(2/3).
const SHARE_EXPONENT: f64 = 2.0 / 3.0;

/// 256 ascending values.
pub(super) struct Codebook {
    values: Vec<f32>,
}

impl Codebook {
    /// The codebook of some values, which must be finite; the same ones give the same codebook. Up to 256 different values
    /// are kept as they are.
    pub(super) fn of(values: &[f32]) -> Self {
        let mut sorted = values.to_vec();
        sorted.par_sort_unstable_by(f32::total_cmp);
        let mut values: Vec<f32> = Vec::new();
        for &value in &sorted {
            if values.last().is_none_or(|last| *last < value) {
                values.push(value);
            }
            if values.len() > CODEBOOK_LEN {
                values = k_means(&sorted);
                break;
            }
        }
        let last = values.last().copied().unwrap_or(0.0);
        values.resize(CODEBOOK_LEN, last);
        Self { values }
    }

    /// All values.
    pub(super) fn values(&self) -> &[f32] {
        &self.values
    }

    /// Index of the nearest value.
    pub(super) fn index(&self, value: f32) -> u8 {
        let above = self.values.partition_point(|&v| v < value).min(CODEBOOK_LEN - 1);
        let below = above.saturating_sub(1);
        let distance = |i: usize| (f64::from(self.values[i]) - f64::from(value)).abs();
        (if distance(below) < distance(above) { below } else { above }) as u8
    }
}

/// Values that share the nearest centre.
struct Cell {
    mean: f64,
    deviation: f64,
    /// Sum of squared distances from the mean.
    error: f64,
}

/// Up to 256 ascending values for ascending values, of which there are more.
fn k_means(sorted: &[f32]) -> Vec<f32> {
    // Sums of the first values and of their squares.
    let mut sums = vec![[0.0; 2]];
    let mut sum = [0.0; 2];
    sums.extend(sorted.iter().map(|&v| {
        let v = f64::from(v);
        sum = [sum[0] + v, sum[1] + v * v];
        sum
    }));
    let mut centres = first_guess(sorted);
    for _ in 0..STEPS {
        centres = next_centres(&cells(sorted, &sums, &centres));
    }
    centres.into_iter().map(|centre| centre as f32).collect()
}

/// The cells of ascending centres that are not empty.
fn cells(sorted: &[f32], sums: &[[f64; 2]], centres: &[f64]) -> Vec<Cell> {
    let bounds = centres.windows(2).map(|pair| 0.5 * (pair[0] + pair[1]));
    let ends = bounds.map(|bound| sorted.partition_point(|&v| f64::from(v) <= bound)).chain([sorted.len()]);
    let mut begin = 0;
    let mut out = Vec::with_capacity(centres.len());
    for end in ends {
        if begin < end {
            let count = (end - begin) as f64;
            let [first, second] = [0, 1].map(|k| (sums[end][k] - sums[begin][k]) / count);
            let variance = (second - first * first).max(0.0);
            out.push(Cell { mean: first, deviation: variance.sqrt(), error: variance * count });
        }
        begin = begin.max(end);
    }
    out
}

/// The means of the cells. Centres that had no values split the cells of the largest errors.
fn next_centres(cells: &[Cell]) -> Vec<f64> {
    let mut by_error: Vec<usize> = (0..cells.len()).collect();
    by_error.sort_by(|&a, &b| cells[b].error.total_cmp(&cells[a].error));
    let mut centres: Vec<f64> = cells.iter().map(|cell| cell.mean).collect();
    for &i in by_error.iter().take(CODEBOOK_LEN - cells.len()) {
        centres[i] -= cells[i].deviation;
        centres.push(cells[i].mean + cells[i].deviation);
    }
    centres.sort_by(f64::total_cmp);
    centres
}

/// 256 ascending values that share the range as the density of the values suggests.
fn first_guess(sorted: &[f32]) -> Vec<f64> {
    let quantile = |run: usize| f64::from(sorted[run * (sorted.len() - 1) / RUNS]);
    let mut shares = vec![0.0];
    for run in 0..RUNS {
        shares.push(shares[run] + (quantile(run + 1) - quantile(run)).powf(SHARE_EXPONENT));
    }
    let total = shares[RUNS];
    let place = |i: usize| {
        let share = total * (i as f64 + 0.5) / CODEBOOK_LEN as f64;
        let run = shares.partition_point(|&s| s <= share).clamp(1, RUNS) - 1;
        let along = (share - shares[run]) / (shares[run + 1] - shares[run]).max(f64::MIN_POSITIVE);
        let (low, high) = (quantile(run), quantile(run + 1));
        low + (high - low) * along.clamp(0.0, 1.0)
    };
    (0..CODEBOOK_LEN).map(place).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;

    fn worst(values: &[f32], codebook: &Codebook) -> f32 {
        let error = |&v: &f32| (codebook.values()[usize::from(codebook.index(v))] - v).abs();
        values.iter().map(error).fold(0.0, f32::max)
    }

    #[test]
    fn few_values_are_exact() {
        for values in [vec![], vec![3.0], vec![-2.0; 9], (0..256).map(|i| (i * 37 % 256) as f32).collect()] {
            let codebook = Codebook::of(&values);
            assert_eq!(codebook.values().len(), 256);
            assert_eq!(worst(&values, &codebook), 0.0);
        }
    }

    /// A uniform distribution of width 1 is cut into cells of 1/256.
    #[test]
    fn many_values_share_the_range() {
        let mut rng = Rng::new(5);
        let values: Vec<f32> = (0..20_000).map(|_| rng.uniform() as f32).collect();
        let codebook = Codebook::of(&values);
        assert!(codebook.values().windows(2).all(|pair| pair[0] <= pair[1]));
        assert!(worst(&values, &codebook) < 0.006, "{}", worst(&values, &codebook));
    }

    /// The root mean square error of a normal distribution with 256 values is at least 0.0064 of its deviation, and single
    /// values far outside are not drawn in.
    #[test]
    fn dense_and_sparse_values_are_both_near() {
        let mut rng = Rng::new(6);
        let mut values: Vec<f32> = (0..50_000).map(|_| rng.normal() as f32).collect();
        values.extend([-40.0, 35.0, 90.0]);
        let codebook = Codebook::of(&values);
        let error = |v: f32| f64::from(codebook.values()[usize::from(codebook.index(v))] - v);
        let squares: f64 = values.iter().map(|&v| error(v).powi(2)).sum();
        let rms = (squares / values.len() as f64).sqrt();
        assert!(rms < 0.009, "{rms}");
        assert!(worst(&values, &codebook) < 1.0, "{}", worst(&values, &codebook));
    }
}
