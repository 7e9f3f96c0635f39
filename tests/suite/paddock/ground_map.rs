//! A map of the ground: a value per cell.

use glam::DVec2;

/// A grid over the ground with a value per cell, 0 = nothing.
pub(crate) struct GroundMap {
    half_size: DVec2,
    columns: usize,
    rows: usize,
    values: Vec<f32>,
}

impl GroundMap {
    /// Side of a cell, metres.
    const CELL: f64 = 0.08;

    /// An empty map of |x| <= half_size.x, |y| <= half_size.y.
    pub(crate) fn new(half_size: DVec2) -> Self {
        let count = |half: f64| (2.0 * half / Self::CELL).ceil() as usize;
        let (columns, rows) = (count(half_size.x), count(half_size.y));
        Self { half_size, columns, rows, values: vec![0.0; columns * rows] }
    }

    /// The map of a function.
    pub(crate) fn of(half_size: DVec2, value: impl Fn(DVec2) -> f64) -> Self {
        let mut out = Self::new(half_size);
        for k in 0..out.values.len() {
            let cell = DVec2::new((k % out.columns) as f64 + 0.5, (k / out.columns) as f64 + 0.5);
            out.values[k] = value(cell * Self::CELL - half_size) as f32;
        }
        out
    }

    /// The largest map below this one that nowhere grows faster than `slope` per metre, by two chamfer sweeps.
    pub(crate) fn graded(mut self, slope: f64) -> Self {
        let (columns, rows) = (self.columns as isize, self.rows as isize);
        let straight = (slope * Self::CELL) as f32;
        let diagonal = straight * std::f32::consts::SQRT_2;
        let behind = [(-1, 0, straight), (0, -1, straight), (-1, -1, diagonal), (1, -1, diagonal)];
        let cells = columns * rows;
        for sweep in [1, -1] {
            for step in 0..cells {
                let k = if sweep == 1 { step } else { cells - 1 - step };
                let (i, j) = (k % columns, k / columns);
                for (di, dj, growth) in behind {
                    let (x, y) = (i + sweep * di, j + sweep * dj);
                    if (0..columns).contains(&x) && (0..rows).contains(&y) {
                        let limit = self.values[(y * columns + x) as usize] + growth;
                        let value = &mut self.values[k as usize];
                        *value = value.min(limit);
                    }
                }
            }
        }
        self
    }

    /// Covers a disc; overlapping discs do not add up.
    pub(crate) fn cover(&mut self, centre: DVec2, radius: f64, strength: f32) {
        let low = (centre - radius + self.half_size) / Self::CELL;
        let high = (centre + radius + self.half_size) / Self::CELL;
        let clamp = |v: f64, count: usize| v.clamp(0.0, count as f64) as usize;
        for j in clamp(low.y, self.rows)..clamp(high.y.ceil(), self.rows) {
            for i in clamp(low.x, self.columns)..clamp(high.x.ceil(), self.columns) {
                let cell = DVec2::new(i as f64 + 0.5, j as f64 + 0.5) * Self::CELL - self.half_size;
                if (cell - centre).length() <= radius {
                    let value = &mut self.values[j * self.columns + i];
                    *value = value.max(strength);
                }
            }
        }
    }

    /// The map blurred with three box filters whose standard deviation together is `deviation` metres.
    pub(crate) fn blurred(mut self, deviation: f64) -> Self {
        // A box of half width h cells has variance h (h + 1) / 3; three of them have h (h + 1).
        let cells = deviation / Self::CELL;
        let half = ((cells * cells + 0.25).sqrt() - 0.5).round() as usize;
        for _ in 0..3 {
            self.values = box_filter(&self.values, self.columns, half);
            self.values = transposed(&self.values, self.columns);
            self.values = box_filter(&self.values, self.rows, half);
            self.values = transposed(&self.values, self.rows);
        }
        self
    }

    /// The value at a point, bilinear; 0 outside.
    pub(crate) fn at(&self, p: DVec2) -> f64 {
        let q = (p + self.half_size) / Self::CELL - 0.5;
        let (base, f) = (q.floor(), q - q.floor());
        let cell = |i: f64, j: f64| {
            let inside = i >= 0.0 && j >= 0.0 && i < self.columns as f64 && j < self.rows as f64;
            if inside { f64::from(self.values[j as usize * self.columns + i as usize]) } else { 0.0 }
        };
        let lower = cell(base.x, base.y) * (1.0 - f.x) + cell(base.x + 1.0, base.y) * f.x;
        let upper = cell(base.x, base.y + 1.0) * (1.0 - f.x) + cell(base.x + 1.0, base.y + 1.0) * f.x;
        lower * (1.0 - f.y) + upper * f.y
    }
}

/// Mean over 2 half + 1 neighbours in every row; beyond the ends counts as 0.
fn box_filter(values: &[f32], columns: usize, half: usize) -> Vec<f32> {
    let weight = 1.0 / (2 * half + 1) as f32;
    let mut out = Vec::with_capacity(values.len());
    for row in values.chunks(columns) {
        for i in 0..columns {
            let window = &row[i.saturating_sub(half)..(i + half + 1).min(columns)];
            out.push(window.iter().sum::<f32>() * weight);
        }
    }
    out
}

fn transposed(values: &[f32], columns: usize) -> Vec<f32> {
    let rows = values.len() / columns;
    (0..values.len()).map(|k| values[(k % rows) * columns + k / rows]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn grading_limits_the_slope_and_keeps_the_low_places() {
        let step = |p: DVec2| if p.x < 0.0 { 0.1 } else { 0.5 };
        let map = GroundMap::of(DVec2::splat(2.0), step).graded(0.2);
        assert!((map.at(DVec2::new(-1.0, 0.0)) - 0.1).abs() < 1e-6);
        assert!((map.at(DVec2::new(1.0, 0.5)) - 0.3).abs() < 0.02, "{}", map.at(DVec2::new(1.0, 0.5)));
    }

    #[test]
    fn a_blurred_disc_keeps_its_mass_and_fades() {
        let mut map = GroundMap::new(DVec2::splat(5.0));
        map.cover(DVec2::ZERO, 1.0, 1.0);
        let before: f32 = map.values.iter().sum();
        let map = map.blurred(0.4);
        let after: f32 = map.values.iter().sum();
        assert!((before - after).abs() < 0.01 * before);
        let (middle, edge, far) = (map.at(DVec2::ZERO), map.at(DVec2::X), map.at(DVec2::X * 3.0));
        assert!(middle > 0.8 && (0.3..0.6).contains(&edge) && far < 1e-3 && map.at(DVec2::X * 9.0) == 0.0);
    }
}
