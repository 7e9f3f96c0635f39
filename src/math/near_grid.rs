//! The nearest of some points, for places near to them: a grid that is looked through from the place outwards.
//!
//! Registration asks for little else. Of 2,900 points of a surface, about one in a cell, a search took 90 ns and
//! one in a tree 170, for places within half a cell of the surface; to make them took 32 us and 140 (2026-11-25).

use glam::DVec3;

/// Rings of cells that are looked at around the first ones, at most: what is farther a tree finds faster.
const MOST_RINGS: i32 = 2;
/// Cells for each point, at most: of points that are far apart cells are larger than was asked for.
const CELLS_PER_POINT: usize = 16;
/// And so many more.
const FEW_CELLS: usize = 64;
/// Cells along an axis are fewer: there would be too many of them.
const FARTHEST_CELL: f64 = 1e9;
/// Smaller cells have no sound reciprocal, and may be asked for where all points are in one place.
const LEAST_EDGE: f64 = 1e-150;
/// What cells grow by until they are few enough.
const COARSER: f64 = 1.5;

/// The nearest point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Nearest {
    /// Its index.
    pub index: u32,
    /// How far it is.
    pub distance: f64,
    /// No other point is nearer than this, which is at least `distance`.
    pub others: f64,
}

/// The least two of squared distances, and the index of the first.
struct Least {
    squared: f64,
    index: u32,
    second: f64,
}

/// Points by the cell of a grid that they lie in.
pub struct NearGrid {
    low: DVec3,
    edge: f64,
    cells_per_unit: f64,
    /// Cells along x, y, z.
    counts: [i32; 3],
    /// Cell c, x fastest, has `points[first[c]..first[c + 1]]`.
    first: Vec<u32>,
    points: Vec<(DVec3, u32)>,
}

impl NearGrid {
    /// From finite positions, fewer than 2^32 of them, in cells of `edge`; larger ones where these would be too many or too small.
    pub fn new(positions: &[DVec3], edge: f64) -> Self {
        let wider = |(low, high): (DVec3, DVec3), p: &DVec3| (low.min(*p), high.max(*p));
        let (low, high) = positions.iter().fold((DVec3::INFINITY, DVec3::NEG_INFINITY), wider);
        let (low, size) = if positions.is_empty() { (DVec3::ZERO, DVec3::ZERO) } else { (low, high - low) };
        let most = ((CELLS_PER_POINT * positions.len() + FEW_CELLS) as f64).min(FARTHEST_CELL);
        let mut edge = if edge >= LEAST_EDGE { edge } else { 1.0 };
        let cells_along = |edge: f64| (size / edge).floor() + 1.0;
        while cells_along(edge).element_product() > most {
            edge *= COARSER;
        }
        let counts = cells_along(edge).to_array().map(|count| count as i32);
        let cells_per_unit = edge.recip();
        let mut grid = Self {
            low,
            edge,
            cells_per_unit,
            counts,
            first: Vec::new(),
            points: vec![(DVec3::ZERO, 0); positions.len()],
        };
        grid.fill(positions);
        grid
    }

    /// Sorts points into their cells, in the order in which they come.
    fn fill(&mut self, positions: &[DVec3]) {
        let [nx, ny, nz] = self.counts;
        let cell = |p: &DVec3| {
            let at = |axis: usize| (self.cell_of(p[axis] - self.low[axis])).clamp(0, self.counts[axis] - 1);
            ((at(2) * ny + at(1)) * nx + at(0)) as usize
        };
        let cells: Vec<usize> = positions.iter().map(cell).collect();
        let mut first = vec![0_u32; (nx * ny * nz) as usize + 1];
        cells.iter().for_each(|&c| first[c + 1] += 1);
        (1..first.len()).for_each(|c| first[c] += first[c - 1]);
        let mut next = first.clone();
        for ((&c, &position), index) in cells.iter().zip(positions).zip(0..) {
            self.points[next[c] as usize] = (position, index);
            next[c] += 1;
        }
        self.first = first;
    }

    fn cell_of(&self, along: f64) -> i32 {
        // Rounds down, without a call; for what is far outside it is the farthest cell that has a number.
        let cells = along * self.cells_per_unit;
        let towards_zero = (cells.clamp(-FARTHEST_CELL, FARTHEST_CELL)) as i32;
        towards_zero - i32::from(cells < f64::from(towards_zero))
    }

    /// The point nearest to `place`; `None` if none is near: farther than two cells for certain.
    pub fn nearest(&self, place: DVec3) -> Option<Nearest> {
        let from_low = place - self.low;
        // The cells of the nearer sides: all that is within half an edge.
        let mut low = from_low.to_array().map(|along| self.cell_of(along - 0.5 * self.edge));
        let mut high = low.map(|cell| cell + 1);
        let mut best = Least { squared: f64::INFINITY, index: u32::MAX, second: f64::INFINITY };
        for ring in 0..=MOST_RINGS {
            self.look(place, low, high, ring > 0, &mut best);
            let reach = self.reach(from_low, low, high);
            if best.squared <= reach * reach.abs() {
                let Least { squared, index, second } = best;
                let near = Nearest { index, distance: squared.sqrt(), others: second.sqrt().min(reach) };
                return (index != u32::MAX).then_some(near);
            }
            (low, high) = (low.map(|cell| cell - 1), high.map(|cell| cell + 1));
        }
        None
    }

    /// No point outside of the cells is nearer than this; infinite if there is none.
    fn reach(&self, from_low: DVec3, low: [i32; 3], high: [i32; 3]) -> f64 {
        let mut least = f64::INFINITY;
        for axis in 0..3 {
            if low[axis] > 0 {
                least = least.min(from_low[axis] - f64::from(low[axis]) * self.edge);
            }
            if high[axis] < self.counts[axis] - 1 {
                least = least.min(f64::from(high[axis] + 1) * self.edge - from_low[axis]);
            }
        }
        least
    }

    /// Looks at the points of cells from `low` to `high`; only of the outermost if the others have been looked at.
    fn look(&self, place: DVec3, low: [i32; 3], high: [i32; 3], outer: bool, best: &mut Least) {
        let [nx, ny, nz] = self.counts;
        let inside = |axis: usize, count: i32| low[axis].max(0)..=high[axis].min(count - 1);
        let (left, right) = (low[0].max(0), high[0].min(nx - 1));
        for z in inside(2, nz) {
            for y in inside(1, ny) {
                let row = (z * ny + y) * nx;
                let whole = !outer || z == low[2] || z == high[2] || y == low[1] || y == high[1];
                if whole {
                    if left <= right {
                        self.look_at(place, row + left, row + right, best);
                    }
                    continue;
                }
                for x in [low[0], high[0]] {
                    if (0..nx).contains(&x) {
                        self.look_at(place, row + x, row + x, best);
                    }
                }
            }
        }
    }

    /// Looks at the points of cells that follow each other, in memory too.
    fn look_at(&self, place: DVec3, from: i32, to: i32, best: &mut Least) {
        for &(point, index) in &self.points[self.first[from as usize] as usize..self.first[to as usize + 1] as usize] {
            let squared = point.distance_squared(place);
            if squared < best.squared {
                *best = Least { squared, index, second: best.squared };
            } else if squared < best.second {
                best.second = squared;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;

    /// Against a search of all: near ones are found, and none that is nearer than two cells is given up.
    #[test]
    fn finds_what_a_search_of_all_finds() {
        let mut rng = Rng::new(3);
        for (count, edge) in [(1, 1.0), (7, 0.3), (400, 0.1), (400, 0.5), (400, 5.0), (400, 1e-9)] {
            let mut points: Vec<DVec3> = (0..count).map(|_| rng.normal_vector()).collect();
            // One far from all others makes the cells larger; two are in one place.
            points.push(DVec3::new(40.0, 0.0, 0.0));
            points.push(points[0]);
            let grid = NearGrid::new(&points, edge);
            assert!(grid.first.len() <= CELLS_PER_POINT * points.len() + FEW_CELLS + 1);
            let mut found = 0;
            for k in 0..2000 {
                let place = rng.normal_vector() * [0.5, 2.0, 30.0, 1e12][k % 4];
                let mut all: Vec<(f64, u32)> = points.iter().map(|p| p.distance(place)).zip(0..).collect();
                all.sort_by(|a, b| a.0.total_cmp(&b.0));
                let (distance, index) = all[0];
                match grid.nearest(place) {
                    Some(near) => {
                        let off = (near.distance - distance).abs();
                        assert!(near.index == index && off <= 1e-12 * distance, "{near:?} {index}");
                        assert!((near.distance..=all[1].0 * (1.0 + 1e-12)).contains(&near.others), "{near:?} {all:?}");
                        found += 1;
                    }
                    None => assert!(distance > 2.0 * grid.edge, "{distance} {}", grid.edge),
                }
            }
            assert!(found > 0);
        }
        for edge in [0.0, 1e-310, f64::NAN] {
            let [there, here] = [DVec3::ONE, DVec3::ONE + 1e-9 * DVec3::X];
            assert_eq!(NearGrid::new(&[there; 2], edge).nearest(DVec3::ONE).map(|n| n.distance), Some(0.0));
            assert_eq!(NearGrid::new(&[there, here], edge).nearest(here).map(|n| n.index), Some(1));
        }
        assert_eq!(NearGrid::new(&[], 1.0).nearest(DVec3::ZERO), None);
        assert_eq!(NearGrid::new(&[DVec3::ZERO; 3], 1.0).nearest(DVec3::X).map(|n| n.index), Some(0));
    }
}
