//! Nearest neighbours in a set of points, any number of which may coincide.

use std::cmp::Ordering;
use std::collections::BinaryHeap;

/// Ranges of at most this many places are looked through one by one. To find the nearest of 1,000, 2,900 and 16,000
/// points of a surface took 184, 225 and 286 ns, with 16 in a range 192, 233 and 310 (2026-11-25).
const LEAF_PLACES: usize = 8;
/// Ranges of more places are split by two threads.
const SERIAL_PLACES: usize = 4096;

/// A point of the set and its distance from the query.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Neighbour {
    /// Index into the points that the set was made from.
    pub index: u32,
    /// Squared distance from the query, square units of the points.
    pub squared_distance: f64,
}

/// The nearest of the places that have points.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct NearestPlace {
    /// Its point of the lowest index.
    pub neighbour: Neighbour,
    /// No point in another place is nearer than this, units of the points; at least the distance of `neighbour`. Infinite
    /// if there is no other place.
    pub others: f64,
}

/// A set of finite points to search in. Coincident points are stored once, since a tree takes quadratic time for them.
/// The same points give the same answers.
pub struct PointSet {
    tree: Tree,
    /// Point indices, grouped by distinct position, ascending within each.
    points: Vec<u32>,
    /// Distinct position p has the points `points[first[p]..first[p + 1]]`.
    first: Vec<usize>,
}

impl PointSet {
    /// A set of finite positions, fewer than 2^32 of them.
    pub fn new(positions: &[[f32; 3]]) -> Self {
        // Places in order, and the points of a place by index: one integer for both.
        let mut sorted: Vec<u128> = positions.iter().zip(0_u32..).map(|(&p, i)| sort_key(p, i)).collect();
        sorted.sort_unstable();
        let point = |key: u128| key as u32;
        let mut groups: Vec<&[u128]> = sorted.chunk_by(|a, b| a >> 32 == b >> 32).collect();
        groups.sort_unstable_by_key(|group| point(group[0]));
        let (mut points, mut first) = (Vec::with_capacity(sorted.len()), Vec::with_capacity(groups.len() + 1));
        for group in &groups {
            first.push(points.len());
            points.extend(group.iter().map(|&key| point(key)));
        }
        first.push(points.len());
        let at = |group: &[u128]| normal_zeros(positions[point(group[0]) as usize]);
        let places = groups.iter().zip(0..).map(|(group, number)| Place { at: at(group), number }).collect();
        Self { tree: Tree::new(places), points, first }
    }

    /// The `count` points nearest to `position`, nearest first (all points if there are fewer); coincident points by
    /// ascending index.
    pub fn nearest(&self, position: [f32; 3], count: usize) -> Vec<Neighbour> {
        let wanted = count.min(self.points.len());
        if wanted == 0 {
            return Vec::new();
        }
        let mut several =
            Several { wanted, farthest_first: BinaryHeap::with_capacity(wanted.min(self.first.len()) + 1) };
        self.tree.search(position, &mut several);
        let mut out = Vec::with_capacity(wanted);
        for Found { squared, place } in several.farthest_first.into_sorted_vec() {
            let p = place as usize;
            let points = self.points[self.first[p]..self.first[p + 1]].iter();
            let missing = wanted - out.len();
            out.extend(points.take(missing).map(|&index| Neighbour { index, squared_distance: squared }));
        }
        out
    }

    /// The point nearest to `position`, of coincident ones that of the lowest index; `None` if the set is empty. Faster
    /// than [`PointSet::nearest`] with a count of 1.
    pub fn nearest_one(&self, position: [f32; 3]) -> Option<Neighbour> {
        self.nearest_place(position).map(|near| near.neighbour)
    }

    /// The same, and how far all other places are at least.
    pub fn nearest_place(&self, position: [f32; 3]) -> Option<NearestPlace> {
        let mut one = One { found: Found { squared: f64::INFINITY, place: u32::MAX }, others: f64::INFINITY };
        self.tree.search(position, &mut one);
        let One { found: Found { squared, place }, others } = one;
        let index = *self.points.get(*self.first.get(place as usize)?)?;
        Some(NearestPlace { neighbour: Neighbour { index, squared_distance: squared }, others: others.sqrt() })
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

/// Orders finite positions by their coordinates, and points of one place by index.
fn sort_key(position: [f32; 3], index: u32) -> u128 {
    // Bits of numbers ascend with these, but for the sign: negative numbers are inverted and come first.
    let ascending = |bits: u32| if bits >> 31 == 1 { !bits } else { bits | 1 << 31 };
    let [x, y, z] = normal_zeros(position);
    [x.to_bits(), y.to_bits(), z.to_bits()].into_iter().fold(0, |key, bits| key << 32 | u128::from(ascending(bits)))
        << 32
        | u128::from(index)
}

/// The same place for -0 as for 0.
fn normal_zeros(position: [f32; 3]) -> [f32; 3] {
    position.map(|v| v + 0.0)
}

/// Where at least one point is.
#[derive(Clone, Copy)]
struct Place {
    at: [f32; 3],
    number: u32,
}

/// A place and how far it is, ordered by distance and then by number. Distances are no NaN.
#[derive(Clone, Copy, PartialEq)]
struct Found {
    squared: f64,
    place: u32,
}

impl Eq for Found {}

impl Found {
    fn is_before(self, other: Self) -> bool {
        self.squared < other.squared || (self.squared == other.squared && self.place < other.place)
    }
}

impl Ord for Found {
    fn cmp(&self, other: &Self) -> Ordering {
        self.squared.total_cmp(&other.squared).then(self.place.cmp(&other.place))
    }
}

impl PartialOrd for Found {
    fn partial_cmp(&self, other: &Self) -> Option<Ordering> {
        Some(self.cmp(other))
    }
}

/// What a search keeps of the places that it comes across.
trait Nearest {
    /// Places farther than this squared distance are of no use.
    fn reach(&self) -> f64;
    /// Takes a place into account.
    fn offer(&mut self, found: Found);
    /// Takes note that places are left out, none of which is nearer than this squared distance.
    fn leave_out(&mut self, _squared: f64) {}
}

/// The nearest place, and the least squared distance that others may have.
struct One {
    found: Found,
    others: f64,
}

impl Nearest for One {
    fn reach(&self) -> f64 {
        self.found.squared
    }

    fn offer(&mut self, found: Found) {
        if found.is_before(self.found) {
            self.others = self.found.squared;
            self.found = found;
        } else {
            self.others = self.others.min(found.squared);
        }
    }

    fn leave_out(&mut self, squared: f64) {
        self.others = self.others.min(squared);
    }
}

/// The nearest places, as many as are wanted.
struct Several {
    wanted: usize,
    farthest_first: BinaryHeap<Found>,
}

impl Nearest for Several {
    fn reach(&self) -> f64 {
        if self.farthest_first.len() < self.wanted {
            return f64::INFINITY;
        }
        self.farthest_first.peek().map_or(f64::INFINITY, |farthest| farthest.squared)
    }

    fn offer(&mut self, found: Found) {
        if self.farthest_first.len() < self.wanted {
            self.farthest_first.push(found);
        } else if let Some(mut farthest) = self.farthest_first.peek_mut()
            && found.is_before(*farthest)
        {
            *farthest = found;
        }
    }
}

/// A balanced k-d tree without pointers. The middle place of a range splits it: those before have at most its
/// coordinate along the split's axis, those behind at least that. Both halves are ranges of their own.
struct Tree {
    places: Vec<Place>,
    /// Axis of the split by the place of the same number; unused for places that split nothing.
    axes: Vec<u8>,
}

/// A place to search from.
struct Query {
    at: [f64; 3],
}

impl Tree {
    fn new(mut places: Vec<Place>) -> Self {
        let mut axes = vec![0; places.len()];
        split(&mut places, &mut axes);
        Self { places, axes }
    }

    /// Offers `nearest` all places within its reach of `position`, and others.
    fn search(&self, position: [f32; 3], nearest: &mut impl Nearest) {
        let query = Query { at: position.map(f64::from) };
        query.search(&self.places, &self.axes, [0.0; 3], nearest);
    }
}

/// Sorts a range of places into a tree.
fn split(places: &mut [Place], axes: &mut [u8]) {
    if places.len() <= LEAF_PLACES {
        return;
    }
    let axis = widest_axis(places);
    let middle = places.len() / 2;
    places.select_nth_unstable_by(middle, |p, q| p.at[axis].total_cmp(&q.at[axis]).then(p.number.cmp(&q.number)));
    axes[middle] = axis as u8;
    let (before, behind) = places.split_at_mut(middle);
    let (axes_before, axes_behind) = axes.split_at_mut(middle);
    let (behind, axes_behind) = (&mut behind[1..], &mut axes_behind[1..]);
    if before.len() > SERIAL_PLACES {
        rayon::join(|| split(before, axes_before), || split(behind, axes_behind));
    } else {
        split(before, axes_before);
        split(behind, axes_behind);
    }
}

fn widest_axis(places: &[Place]) -> usize {
    let (mut low, mut high) = ([f32::INFINITY; 3], [f32::NEG_INFINITY; 3]);
    for place in places {
        for axis in 0..3 {
            low[axis] = low[axis].min(place.at[axis]);
            high[axis] = high[axis].max(place.at[axis]);
        }
    }
    let width = |axis: usize| f64::from(high[axis]) - f64::from(low[axis]);
    let wider = |best: usize, axis: usize| if width(axis) > width(best) { axis } else { best };
    wider(wider(0, 1), 2)
}

impl Query {
    /// Looks through a range, of which the query is `off` away along each axis.
    fn search(&self, places: &[Place], axes: &[u8], off: [f64; 3], nearest: &mut impl Nearest) {
        if places.len() <= LEAF_PLACES {
            places.iter().for_each(|place| self.offer(place, nearest));
            return;
        }
        let middle = places.len() / 2;
        let (place, axis) = (&places[middle], usize::from(axes[middle]));
        let beyond = self.at[axis] - f64::from(place.at[axis]);
        let halves = [(&places[..middle], &axes[..middle]), (&places[middle + 1..], &axes[middle + 1..])];
        let (near, far) = if beyond < 0.0 { (halves[0], halves[1]) } else { (halves[1], halves[0]) };
        self.search(near.0, near.1, off, nearest);
        let mut off_far = off;
        off_far[axis] = beyond;
        // Rounded like a distance and so never more than that of a place in there. Equal ones may have a lower number.
        let least = squared_length(off_far);
        if least <= nearest.reach() {
            self.offer(place, nearest);
            self.search(far.0, far.1, off_far, nearest);
        } else {
            nearest.leave_out(least);
        }
    }

    fn offer(&self, place: &Place, nearest: &mut impl Nearest) {
        // By hand, since compilers do not inline `map` of an array here, which cost a fourth of the search.
        let ([px, py, pz], [x, y, z]) = (place.at, self.at);
        let from_place = [f64::from(px) - x, f64::from(py) - y, f64::from(pz) - z];
        nearest.offer(Found { squared: squared_length(from_place), place: place.number });
    }
}

fn squared_length([x, y, z]: [f64; 3]) -> f64 {
    x * x + y * y + z * z
}

#[cfg(test)]
mod tests {
    use glam::DVec3;

    use super::*;
    use crate::math::rng::Rng;

    fn squared(p: [f32; 3], q: [f32; 3]) -> f64 {
        (0..3).map(|k| (f64::from(p[k]) - f64::from(q[k])).powi(2)).sum()
    }

    /// All points by distance, then by the lowest index in their place, then by their own: bits of distances and indices.
    fn slow(points: &[[f32; 3]], query: [f32; 3]) -> Vec<(u64, u32)> {
        let first_of = |p: &[f32; 3]| points.iter().position(|q| q == p).unwrap();
        let key = |(p, i): (&[f32; 3], u32)| (squared(*p, query).to_bits(), first_of(p), i);
        let mut all: Vec<_> = points.iter().zip(0..).map(key).collect();
        all.sort_unstable();
        all.into_iter().map(|(squared, _, i)| (squared, i)).collect()
    }

    fn check(points: &[[f32; 3]], query: [f32; 3], counts: &[usize]) {
        let set = PointSet::new(points);
        let bits = |n: &Neighbour| (n.squared_distance.to_bits(), n.index);
        let all = slow(points, query);
        for &count in counts {
            let got: Vec<_> = set.nearest(query, count).iter().map(bits).collect();
            assert_eq!(got, all[..count.min(all.len())]);
        }
        assert_eq!(bits(&set.nearest_one(query).unwrap()), all[0]);
        let NearestPlace { neighbour, others } = set.nearest_place(query).unwrap();
        assert_eq!(bits(&neighbour), all[0]);
        let place = points[all[0].1 as usize];
        let second = all.iter().find(|a| points[a.1 as usize] != place).map_or(f64::INFINITY, |a| f64::from_bits(a.0));
        assert!(neighbour.squared_distance.sqrt() <= others && others <= second.sqrt(), "{others} {second}");
    }

    /// Compared with a linear search, on a grid so coarse that many points coincide and many distances are equal.
    #[test]
    fn finds_what_a_search_of_all_finds_among_equals() {
        let mut rng = Rng::new(1);
        let mut place = || std::array::from_fn(|_| rng.index(5) as f32 - 2.0);
        let points: Vec<[f32; 3]> = (0..200).map(|_| place()).collect();
        for _ in 0..50 {
            check(&points, place(), &[1, 4, 12, 199, 300]);
        }
    }

    /// Against a search of all: round clouds, clouds with a dense middle and far outliers, points of a sphere, of a line.
    #[test]
    fn finds_what_a_search_of_all_finds_in_any_cloud() {
        let mut rng = Rng::new(2);
        for shape in 0..4 {
            let draw = |rng: &mut Rng| {
                let place = match shape {
                    0 => rng.normal_vector(),
                    1 => rng.normal_vector() * (3.0 * rng.normal()).exp(),
                    2 => rng.unit_vector(),
                    _ => rng.normal_vector() * DVec3::X,
                };
                place.as_vec3().to_array()
            };
            let points: Vec<[f32; 3]> = (0..1000).map(|_| draw(&mut rng)).collect();
            for k in 0..30 {
                let query = if k % 2 == 0 { points[k] } else { draw(&mut rng).map(|v| 1.5 * v + 0.1) };
                check(&points, query, &[1, 4, 17, 101]);
            }
        }
    }

    /// More places than one thread sorts, against a search of all.
    #[test]
    fn finds_what_a_search_of_all_finds_in_large_sets() {
        let mut rng = Rng::new(3);
        let points: Vec<[f32; 3]> = (0..20_000).map(|_| rng.normal_vector().as_vec3().to_array()).collect();
        let set = PointSet::new(&points);
        for _ in 0..20 {
            let query = rng.normal_vector().as_vec3().to_array();
            let mut all: Vec<(u64, u32)> =
                points.iter().zip(0..).map(|(&p, i)| (squared(p, query).to_bits(), i)).collect();
            all.sort_unstable();
            let got: Vec<_> = set.nearest(query, 4).iter().map(|n| (n.squared_distance.to_bits(), n.index)).collect();
            assert_eq!(got, all[..4]);
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
