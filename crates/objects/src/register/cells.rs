//! Nearest neighbours among the points of a surface, which are about evenly spread: near the surface a search in the few
//! cells about a place takes less time than one in a tree.

use std::ops::Range;

use instgs_vk::math::nearest::{NearestPlace, Neighbour};

/// Edge of a cell, voxels of the surface. Registering took 1 % longer with 1.5, 6 % with 1.0, and 18 % with trees alone
/// (2026-11-30).
const EDGE_VOXELS: f64 = 2.0;
/// Cells per point at most. A surface has about one; stray points far away would have many.
const MOST_CELLS_PER_POINT: f64 = 32.0;
/// Cells at most, 16 MB: whole scenes have their tree.
const MOST_CELLS: f64 = 4e6;
/// Rounding moves a place across the border of its cell by less than this part of an edge.
const ROUNDING: f64 = 1e-6;
/// Rows of cells along x about that of a place, which is [1, 1]: first those that share a side with it.
const ROWS: [[usize; 2]; 9] = [[1, 1], [0, 1], [1, 0], [1, 2], [2, 1], [0, 0], [0, 2], [2, 0], [2, 2]];

/// A point in its cell.
#[derive(Clone, Copy)]
struct Place {
    at: [f32; 3],
    index: u32,
}

/// The points of a surface, by cubic cells.
pub(super) struct Cells {
    /// Corner of the first cell, units of the points.
    low: [f64; 3],
    /// Edge of a cell, units of the points.
    edge: f64,
    /// One over the edge, since a search is faster with products than with quotients.
    per_edge: f64,
    /// Number of cells along each axis.
    counts: [usize; 3],
    /// The cell c, x first and z last, has the places `first[c]..first[c + 1]`.
    first: Vec<u32>,
    places: Vec<Place>,
}

impl Cells {
    /// Cells for finite `positions` about `voxel` apart; `None` if these are too scattered, or none.
    pub(super) fn new(positions: &[[f32; 3]], voxel: f64) -> Option<Self> {
        let edge = EDGE_VOXELS * voxel;
        let bound = |of: fn(f64, f64) -> f64, start: f64| {
            let wider = |bound: [f64; 3], p: &[f32; 3]| [0, 1, 2].map(|axis| of(bound[axis], f64::from(p[axis])));
            positions.iter().fold([start; 3], wider)
        };
        let (low, high) = (bound(f64::min, f64::INFINITY), bound(f64::max, f64::NEG_INFINITY));
        let wanted = [0, 1, 2].map(|axis| ((high[axis] - low[axis]) / edge).floor() + 1.0);
        let most = MOST_CELLS.min(MOST_CELLS_PER_POINT * positions.len() as f64);
        let few = wanted.iter().product::<f64>() <= most;
        if positions.is_empty() || !few || !(edge > 0.0 && edge.is_finite()) {
            return None;
        }
        let (counts, per_edge) = (wanted.map(|count| count as usize), 1.0 / edge);
        let cell_of = |p: &[f32; 3]| {
            let along = |axis: usize| (((f64::from(p[axis]) - low[axis]) * per_edge) as usize).min(counts[axis] - 1);
            along(0) + counts[0] * (along(1) + counts[1] * along(2))
        };
        // Counts, then ends of the cells, from which places are filled in backwards until these are the beginnings.
        let mut first = vec![0; counts.iter().product::<usize>() + 1];
        positions.iter().for_each(|p| first[cell_of(p)] += 1);
        for cell in 1..first.len() {
            first[cell] += first[cell - 1];
        }
        let mut places = vec![Place { at: [0.0; 3], index: 0 }; positions.len()];
        for (index, at) in positions.iter().enumerate().rev() {
            let slot = &mut first[cell_of(at)];
            *slot -= 1;
            places[*slot as usize] = Place { at: *at, index: index as u32 };
        }
        Some(Self { low, edge, per_edge, counts, first, places })
    }

    /// What the cells about `position` tell of the point nearest to it, of equally near ones that of the lowest index.
    pub(super) fn nearest_place(&self, position: [f32; 3]) -> Near {
        // Loops and casts, since compilers call functions for `map` and `floor` here, which took a third of the search.
        let (mut at, mut cell, mut within) = ([0.0; 3], [0_i64; 3], [0.0; 3]);
        for axis in 0..3 {
            at[axis] = f64::from(position[axis]);
            let along = (at[axis] - self.low[axis]) * self.per_edge + 1.0;
            if !(0.0..self.counts[axis] as f64 + 2.0).contains(&along) {
                return Near::Beyond(0.0);
            }
            cell[axis] = along as i64 - 1;
            // From the faces of its cell, edges: the place lies so far above the lower and below the upper one.
            within[axis] = along - (along as i64) as f64;
        }
        // Squared distances of the three rows and the three layers, never more than those of points in them.
        let squared = |edges: f64| {
            let distance = (edges - ROUNDING).max(0.0) * self.edge;
            distance * distance
        };
        let rows = [squared(within[1]), 0.0, squared(1.0 - within[1])];
        let layers = [squared(within[2]), 0.0, squared(1.0 - within[2])];
        let columns = self.clamped(0, cell[0] - 1)..self.clamped(0, cell[0] + 2);
        let mut found = Found::NONE;
        for [row, layer] in ROWS {
            if rows[row] + layers[layer] < found.others {
                let (row, layer) = (cell[1] + row as i64 - 1, cell[2] + layer as i64 - 1);
                self.places_of(columns.clone(), row, layer).iter().for_each(|place| found.offer(place, at));
            }
        }
        // All points outside these cells are farther away than this.
        let nearest_face = within.iter().fold(1.0_f64, |least, part| least.min(*part).min(1.0 - *part));
        let beyond = (1.0 + nearest_face - ROUNDING) * self.edge;
        if found.nearest.squared_distance < beyond * beyond {
            Near::Place(NearestPlace { neighbour: found.nearest, others: found.others.sqrt().min(beyond) })
        } else {
            Near::Beyond(beyond)
        }
    }

    /// The places in some columns of a row.
    fn places_of(&self, columns: Range<usize>, row: i64, layer: i64) -> &[Place] {
        let is_there = |at: i64, axis: usize| (0..self.counts[axis] as i64).contains(&at);
        if !is_there(row, 1) || !is_there(layer, 2) {
            return &[];
        }
        let first = self.counts[0] * (row as usize + self.counts[1] * layer as usize);
        &self.places[self.first[first + columns.start] as usize..self.first[first + columns.end] as usize]
    }

    /// A number of cells along an axis, where there are so many.
    fn clamped(&self, axis: usize, cell: i64) -> usize {
        cell.clamp(0, self.counts[axis] as i64) as usize
    }
}

/// What is known about the point nearest to a place.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Near {
    /// The nearest point, and how far all others are at least.
    Place(NearestPlace),
    /// None is nearer than this, units of the points.
    Beyond(f64),
}

/// What a search has found.
struct Found {
    nearest: Neighbour,
    /// Squared distance of the second nearest.
    others: f64,
}

impl Found {
    const NONE: Self =
        Self { nearest: Neighbour { index: u32::MAX, squared_distance: f64::INFINITY }, others: f64::INFINITY };

    fn offer(&mut self, place: &Place, [x, y, z]: [f64; 3]) {
        let ([px, py, pz], index) = (place.at, place.index);
        let (dx, dy, dz) = (f64::from(px) - x, f64::from(py) - y, f64::from(pz) - z);
        // Summed as in a `PointSet`, so that distances have the same bits.
        let squared_distance = dx * dx + dy * dy + dz * dz;
        let before = self.nearest;
        if squared_distance < before.squared_distance
            || (squared_distance == before.squared_distance && index < before.index)
        {
            self.others = before.squared_distance;
            self.nearest = Neighbour { index, squared_distance };
        } else {
            self.others = self.others.min(squared_distance);
        }
    }
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use instgs_vk::math::nearest::PointSet;
    use instgs_vk::math::rng::Rng;

    /// Compared with a tree: points of a sphere and of a grid, where many distances are equal, from near and far.
    #[test]
    fn finds_what_a_tree_finds() {
        let mut rng = Rng::new(7);
        for is_grid in [false, true] {
            let place = |rng: &mut Rng| {
                let p = 5.0 * rng.unit_vector();
                (if is_grid { p.round() } else { p }).as_vec3().to_array()
            };
            let points: Vec<[f32; 3]> = (0..1500).map(|_| place(&mut rng)).collect();
            let (cells, tree) = (Cells::new(&points, 0.5).unwrap(), PointSet::new(&points));
            let (mut places, mut beyond) = (0, 0);
            for k in 0..4000 {
                let off = rng.normal_vector() * [0.0, 0.3, 2.0, 9.0][k % 4];
                let at = (DVec3::from_array(place(&mut rng).map(f64::from)) + off).as_vec3().to_array();
                let want = tree.nearest(at, points.len().min(2))[..].to_vec();
                match cells.nearest_place(at) {
                    Near::Place(near) => {
                        assert_eq!((near.neighbour.index, near.neighbour.squared_distance), {
                            (want[0].index, want[0].squared_distance)
                        });
                        assert!(near.others <= want[1].squared_distance.sqrt());
                        assert!(near.others >= near.neighbour.squared_distance.sqrt());
                        places += 1;
                    }
                    Near::Beyond(least) => {
                        assert!(want[0].squared_distance.sqrt() >= least, "{want:?} {least}");
                        beyond += 1;
                    }
                }
            }
            assert!(places > 1500 && beyond > 1000, "{places} {beyond}");
        }
    }

    /// A stray point far away would take millions of cells; without points, or a size, there are none.
    #[test]
    fn scattered_points_have_no_cells() {
        let near: Vec<[f32; 3]> = (0..100).map(|i| [i as f32, 0.0, 0.0]).collect();
        assert!(Cells::new(&near, 1.0).is_some());
        let far: Vec<[f32; 3]> = near.iter().copied().chain([[0.0, 1e6, 1e6]]).collect();
        assert!(Cells::new(&far, 1.0).is_none() && Cells::new(&[], 1.0).is_none());
        assert!(Cells::new(&near, 0.0).is_none() && Cells::new(&near, f64::NAN).is_none());
    }
}
