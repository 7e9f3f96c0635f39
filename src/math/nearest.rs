//! Nearest neighbours in a set of points, any number of which may coincide.

use std::num::NonZero;

use kiddo::SquaredEuclidean;
use kiddo::immutable::float::kdtree::ImmutableKdTree;

/// Points in a leaf of the tree. Measured on 1,000 to 16,000 points of a surface: 8 takes 60 to 75 % of the time of the
/// library's default, 32.
const LEAF_POINTS: usize = 8;

/// A point of the set and its distance from the query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// Index into the points that the set was made from.
    pub index: u32,
    /// Squared distance from the query, square units of the points.
    pub squared_distance: f64,
}

/// A set of finite points to search in. Coincident points are stored once, since a tree takes quadratic time for them.
/// The same points give the same answers.
pub struct PointSet {
    /// Tree over the distinct positions.
    tree: ImmutableKdTree<f64, u64, 3, LEAF_POINTS>,
    /// Point indices, grouped by distinct position, ascending within each.
    points: Vec<u32>,
    /// Distinct position p has the points `points[first[p]..first[p + 1]]`.
    first: Vec<usize>,
}

impl PointSet {
    /// A set of finite positions, fewer than 2^32 of them.
    pub fn new(positions: &[[f32; 3]]) -> Self {
        // Adding 0 turns -0 into 0, so that both are the same position.
        let wide = |i: u32| positions[i as usize].map(|v| f64::from(v) + 0.0);
        let mut points: Vec<u32> = (0..positions.len() as u32).collect();
        points.sort_unstable_by(|&a, &b| {
            let (p, q) = (wide(a), wide(b));
            p[0].total_cmp(&q[0]).then(p[1].total_cmp(&q[1])).then(p[2].total_cmp(&q[2])).then(a.cmp(&b))
        });
        let (mut places, mut first) = (Vec::new(), Vec::new());
        for (rank, &i) in points.iter().enumerate() {
            if places.last() != Some(&wide(i)) {
                places.push(wide(i));
                first.push(rank);
            }
        }
        first.push(points.len());
        Self { tree: ImmutableKdTree::new_from_slice(&places), points, first }
    }

    /// The `count` points nearest to `position`, nearest first (all points if there are fewer); coincident points by
    /// ascending index.
    pub fn nearest(&self, position: [f32; 3], count: usize) -> Vec<Neighbour> {
        let mut out = Vec::with_capacity(count);
        let Some(wanted) = NonZero::new(count.min(self.points.len())) else { return out };
        for place in self.tree.nearest_n::<SquaredEuclidean>(&position.map(f64::from), wanted) {
            let p = place.item as usize;
            let points = &self.points[self.first[p]..self.first[p + 1]];
            let missing = wanted.get() - out.len();
            out.extend(points.iter().take(missing).map(|&index| Neighbour { index, squared_distance: place.distance }));
        }
        out
    }

    /// The point nearest to `position`, of coincident ones that of the lowest index; `None` if the set is empty. Faster
    /// than [`PointSet::nearest`] with a count of 1.
    pub fn nearest_one(&self, position: [f32; 3]) -> Option<Neighbour> {
        if self.points.is_empty() {
            return None;
        }
        let place = self.tree.nearest_one::<SquaredEuclidean>(&position.map(f64::from));
        let index = self.points[self.first[place.item as usize]];
        Some(Neighbour { index, squared_distance: place.distance })
    }

    /// Distance from `position` to the nearest point; infinite if the set is empty.
    pub fn distance(&self, position: [f32; 3]) -> f64 {
        self.nearest_one(position).map_or(f64::INFINITY, |n| n.squared_distance.sqrt())
    }

    /// Mean of the squared distances from a member of the set at `position` to its `count` nearest other members (all
    /// others if there are fewer); 0 if it is the only member.
    pub fn mean_squared_distance_to_others(&self, position: [f32; 3], count: usize) -> f64 {
        // The member itself is among the nearest, at distance 0.
        let nearest = self.nearest(position, count + 1);
        let others = nearest.len().saturating_sub(1);
        nearest.iter().map(|n| n.squared_distance).sum::<f64>() / others.max(1) as f64
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;

    /// Compared with a linear search, on a grid so coarse that many points coincide and many distances are equal.
    #[test]
    fn finds_what_a_search_of_all_finds() {
        let mut rng = Rng::new(1);
        let mut place = || std::array::from_fn(|_| rng.index(5) as f32 - 2.0);
        let points: Vec<[f32; 3]> = (0..200).map(|_| place()).collect();
        let set = PointSet::new(&points);
        let squared = |p: [f32; 3], q: [f32; 3]| (0..3).map(|k| f64::from(p[k] - q[k]).powi(2)).sum::<f64>();
        for _ in 0..50 {
            let query = place();
            let mut all: Vec<f64> = points.iter().map(|&p| squared(p, query)).collect();
            all.sort_unstable_by(f64::total_cmp);
            let got = set.nearest(query, 12);
            assert_eq!(set.nearest_one(query).map(|n| n.squared_distance), Some(all[0]));
            assert!(got.iter().all(|n| n.squared_distance == squared(points[n.index as usize], query)));
            assert_eq!(got.iter().map(|n| n.squared_distance).collect::<Vec<_>>(), all[..12]);
            let mut indices: Vec<u32> = got.iter().map(|n| n.index).collect();
            indices.sort_unstable();
            indices.dedup();
            assert_eq!(indices.len(), 12);
        }
    }

    #[test]
    fn small_and_coincident_sets() {
        assert!(PointSet::new(&[]).nearest([0.0; 3], 4).is_empty());
        assert_eq!(PointSet::new(&[]).distance([0.0; 3]), f64::INFINITY);
        let one = PointSet::new(&[[1.0, 0.0, 0.0]]);
        assert_eq!((one.nearest([0.0; 3], 4).len(), one.distance([3.0, 0.0, 0.0])), (1, 2.0));
        assert_eq!(one.mean_squared_distance_to_others([1.0, 0.0, 0.0], 3), 0.0);
        let many = PointSet::new(&[[0.0, -0.0, 0.0]; 50_000]);
        let nearest = many.nearest([0.0, 3.0, 0.0], 3);
        assert_eq!(
            nearest.iter().map(|n| (n.index, n.squared_distance)).collect::<Vec<_>>(),
            [(0, 9.0), (1, 9.0), (2, 9.0)]
        );
        let pair = PointSet::new(&[[0.0; 3], [0.0; 3], [2.0, 0.0, 0.0]]);
        assert_eq!(pair.mean_squared_distance_to_others([0.0; 3], 3), 2.0);
        assert_eq!(pair.mean_squared_distance_to_others([2.0, 0.0, 0.0], 1), 4.0);
    }
}
