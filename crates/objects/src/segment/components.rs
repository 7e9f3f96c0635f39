//! Connected components of points: the graph joins points that are at most a given distance (the reach) apart.

use std::collections::HashMap;

use rayon::prelude::*;

use instgs_vk::math::nearest::PointSet;

/// A partition of `0..len` (union-find).
#[derive(Clone, Debug)]
pub(super) struct Partition {
    /// A smaller member of the same part, or the element itself.
    parent: Vec<u32>,
}

impl Partition {
    /// Every element in a part of its own.
    pub(super) fn new(len: usize) -> Self {
        Self { parent: (0..len as u32).collect() }
    }

    /// The smallest member of an element's part.
    pub(super) fn root(&mut self, element: usize) -> usize {
        let mut i = element;
        while self.parent[i] as usize != i {
            self.parent[i] = self.parent[self.parent[i] as usize];
            i = self.parent[i] as usize;
        }
        i
    }

    /// Merges the parts of two elements.
    pub(super) fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.parent[a.max(b)] = a.min(b) as u32;
    }

    /// The parts in order of their smallest member, with members ascending.
    pub(super) fn parts(mut self) -> Vec<Vec<u32>> {
        let mut rank_of_root = vec![u32::MAX; self.parent.len()];
        let mut out: Vec<Vec<u32>> = Vec::new();
        for i in 0..self.parent.len() {
            let root = self.root(i);
            if root == i {
                rank_of_root[i] = out.len() as u32;
                out.push(Vec::new());
            }
            out[rank_of_root[root] as usize].push(i as u32);
        }
        out
    }
}

/// Rank of the neighbour whose distance is a point's spacing. The nearest one would not do: densification leaves pairs
/// and small clusters of Gaussians in nearly one place.
const NEIGHBOURS: usize = 6;
/// The reach, in median distances to that neighbour. On even surfaces it is five times the distance to the nearest
/// neighbour, which keeps trained objects in one piece.
const REACH: f64 = 2.0;

/// The reach for finite points, in their units: [`REACH`] times the median distance to the sixth neighbour in another
/// place. `None` if all points coincide.
pub(super) fn usual_reach(positions: &[[f32; 3]]) -> Option<f64> {
    let mut places = positions.to_vec();
    places.iter_mut().flatten().for_each(|v| *v += 0.0);
    places.sort_unstable_by(|a, b| a[0].total_cmp(&b[0]).then(a[1].total_cmp(&b[1])).then(a[2].total_cmp(&b[2])));
    places.dedup();
    if places.len() < 2 {
        return None;
    }
    let set = PointSet::new(&places);
    let farthest = |&place: &[f32; 3]| set.nearest(place, NEIGHBOURS + 1).last().map_or(0.0, |n| n.squared_distance);
    let mut squares: Vec<f64> = places.par_iter().map(farthest).collect();
    squares.sort_unstable_by(f64::total_cmp);
    Some(REACH * squares[squares.len() / 2].sqrt())
}

/// Edge of a grid cell as a part of the reach: below 1/sqrt(3), so that all points of a cell are within reach of each
/// other.
const CELL: f64 = 0.577;
/// Cells to each side that may hold points within reach.
const AROUND: i64 = 2;

/// The connected components of finite points, where points at most `reach` > 0 apart are connected. The largest comes
/// first, and of equal sizes the one with the smallest member; members are ascending.
pub(super) fn components(positions: &[[f32; 3]], reach: f64) -> Vec<Vec<u32>> {
    let cell_of = |p: [f32; 3]| p.map(|v| (f64::from(v) / (CELL * reach)).floor() as i64);
    let mut by_cell: Vec<([i64; 3], u32)> = (0..).zip(positions).map(|(i, &p)| (cell_of(p), i)).collect();
    by_cell.sort_unstable();
    let cells: Vec<&[([i64; 3], u32)]> = by_cell.chunk_by(|a, b| a.0 == b.0).collect();
    // The map is only looked up, never iterated: its order does not matter.
    let index_of: HashMap<[i64; 3], usize> = cells.iter().enumerate().map(|(i, cell)| (cell[0].0, i)).collect();
    let square = reach * reach;
    let near = |a: u32, b: u32| {
        let (p, q) = (positions[a as usize], positions[b as usize]);
        (0..3).map(|k| (f64::from(p[k]) - f64::from(q[k])).powi(2)).sum::<f64>() <= square
    };
    let mut partition = Partition::new(cells.len());
    for (i, cell) in cells.iter().enumerate() {
        for step in steps() {
            let other = [0, 1, 2].map(|k| cell[0].0[k].saturating_add(step[k]));
            let Some(&j) = index_of.get(&other) else { continue };
            if partition.root(i) != partition.root(j) && cell.iter().any(|a| cells[j].iter().any(|b| near(a.1, b.1))) {
                partition.join(i, j);
            }
        }
    }
    let members = |part: &Vec<u32>| {
        let mut out: Vec<u32> =
            part.iter().flat_map(|&cell| cells[cell as usize].iter().map(|entry| entry.1)).collect();
        out.sort_unstable();
        out
    };
    let mut out: Vec<Vec<u32>> = partition.parts().iter().map(members).collect();
    out.sort_by_key(|part| (std::cmp::Reverse(part.len()), part[0]));
    out
}

/// One of each pair of opposite steps to the cells around.
fn steps() -> impl Iterator<Item = [i64; 3]> {
    let side = || -AROUND..=AROUND;
    let all = side().flat_map(move |x| side().flat_map(move |y| side().map(move |z| [x, y, z])));
    all.filter(|step| *step > [0; 3])
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;

    /// Compared with joining every pair within reach.
    #[test]
    fn finds_what_all_pairs_find() {
        for seed in 0..20 {
            let mut rng = Rng::new(seed);
            let positions: Vec<[f32; 3]> =
                (0..120).map(|_| std::array::from_fn(|_| rng.range(-2.0, 2.0) as f32)).collect();
            let reach = rng.range(0.1, 0.9);
            let mut all = Partition::new(positions.len());
            for (i, p) in positions.iter().enumerate() {
                for (j, q) in positions.iter().enumerate() {
                    let square: f64 = (0..3).map(|k| (f64::from(p[k]) - f64::from(q[k])).powi(2)).sum();
                    if square <= reach * reach {
                        all.join(i, j);
                    }
                }
            }
            let mut want = all.parts();
            want.sort_by_key(|part| (std::cmp::Reverse(part.len()), part[0]));
            assert_eq!(components(&positions, reach), want, "seed {seed}");
        }
    }

    #[test]
    fn points_in_one_place_and_no_points() {
        assert!(components(&[], 1.0).is_empty());
        assert_eq!(components(&[[0.0, -0.0, 0.0]; 3], 1.0), [[0, 1, 2]]);
        assert_eq!((usual_reach(&[]), usual_reach(&[[1.0; 3]; 9])), (None, None));
        let line: Vec<[f32; 3]> = [0.0, 0.0, 1.0, 2.0, 3.0, 9.0].map(|x| [x, 0.0, 0.0]).into();
        assert_eq!(components(&line, 1.0), [vec![0, 1, 2, 3, 4], vec![5]]);
        assert_eq!(usual_reach(&line), Some(16.0), "the farthest of the few there are: 9, 8, 7, 6 and 9");
        // Pairs on a long line, ten apart: the sixth neighbour belongs to the third pair.
        let pairs: Vec<[f32; 3]> =
            (0..100).map(|i| [(10 * (i / 2)) as f32 + (i % 2) as f32 / 64.0, 0.0, 0.0]).collect();
        let reach = usual_reach(&pairs).unwrap();
        assert!((39.0..41.0).contains(&reach), "{reach}");
        // Cell indices beyond the range of integers: no overflow.
        assert_eq!(components(&[[-3e38; 3], [3e38; 3]], 1e-9).len(), 2);
    }
}
