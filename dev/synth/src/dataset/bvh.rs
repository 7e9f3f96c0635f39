//! A bounding volume hierarchy with four children per node, so that one vector instruction tests four boxes. Built with
//! the binned surface-area heuristic and walked near child first. Used for the triangles of a mesh and for the meshes
//! of a world.

use glam::{Vec3, Vec4};

/// Bins per split: more bring no measurable gain.
const BINS: usize = 12;
/// Children of a node, one per lane of a vector.
pub const LANES: usize = 4;
/// Pending children of a walk: three for each of 21 levels, which are 42 levels of the binary tree that is built first.
const STACK: usize = 64;
/// From this level on lists are split in the middle: 22 levels below hold 2^22 leaves.
const MAX_DEPTH: usize = 20;

/// An axis-aligned bounding box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Bounds {
    /// Smallest coordinates.
    pub low: Vec3,
    /// Largest coordinates.
    pub high: Vec3,
}

impl Bounds {
    /// The empty box, neutral in [`Self::union`].
    pub const EMPTY: Self = Self { low: Vec3::INFINITY, high: Vec3::NEG_INFINITY };

    /// The box extended to contain the point `p`.
    pub fn with(self, p: Vec3) -> Self {
        Self { low: self.low.min(p), high: self.high.max(p) }
    }

    /// The smallest box that contains both.
    pub fn union(self, other: Self) -> Self {
        Self { low: self.low.min(other.low), high: self.high.max(other.high) }
    }

    /// Centre of the bounding box.
    pub fn centre(&self) -> Vec3 {
        0.5 * (self.low + self.high)
    }

    /// Length of the diagonal.
    pub fn diagonal(&self) -> f32 {
        (self.high - self.low).length()
    }

    /// The eight corners, x varying fastest.
    pub fn corners(&self) -> [Vec3; 8] {
        let pick = |bit: usize, k: usize| if bit == 1 { self.high[k] } else { self.low[k] };
        std::array::from_fn(|i| Vec3::new(pick(i & 1, 0), pick(i >> 1 & 1, 1), pick(i >> 2, 2)))
    }

    fn area(&self) -> f32 {
        let d = self.high - self.low;
        d.x * d.y + d.y * d.z + d.z * d.x
    }
}

/// A half line. `direction` need not be a unit vector: distances are multiples of its length.
#[derive(Clone, Copy, Debug)]
pub struct Ray {
    /// Start of the half line.
    pub origin: Vec3,
    /// Direction of the ray, of any length but 0.
    pub direction: Vec3,
    inverse: Vec3,
}

impl Ray {
    /// The ray from `origin` along `direction`.
    pub fn new(origin: Vec3, direction: Vec3) -> Self {
        Self { origin, direction, inverse: direction.recip() }
    }

    /// The point at the ray parameter `t`.
    pub fn at(&self, t: f32) -> Vec3 {
        self.origin + self.direction * t
    }

    /// The ray parameter at which the ray enters each child's box before `t_max`, and a bit per box that it hits. NaN
    /// (0 times infinity, for a ray within a face) gives either result; [`Bvh::build`] widens boxes, so that this has
    /// measure zero.
    fn enters(&self, node: &Node, t_max: f32) -> ([f32; LANES], u32) {
        let (mut near, mut far) = (Vec4::ZERO, Vec4::splat(t_max));
        for axis in 0..3 {
            let (origin, inverse) = (Vec4::splat(self.origin[axis]), Vec4::splat(self.inverse[axis]));
            let (a, b) = ((node.low[axis] - origin) * inverse, (node.high[axis] - origin) * inverse);
            (near, far) = (near.max(a.min(b)), far.min(a.max(b)));
        }
        (near.to_array(), near.cmple(far).bitmask() & node.lanes)
    }
}

/// An inner node with up to four children.
#[derive(Clone, Copy, Debug)]
struct Node {
    /// Smallest coordinates of the children's boxes, by axis.
    low: [Vec4; 3],
    /// Largest coordinates of the children's boxes, by axis.
    high: [Vec4; 3],
    /// Index of a node, or [`LEAF`] and the index of a leaf.
    children: [u32; LANES],
    /// One bit per child that exists.
    lanes: u32,
}

/// Flag of leaf indices among children.
const LEAF: u32 = 1 << 31;

/// A tree with four children per node.
#[derive(Clone, Debug, Default)]
pub struct Bvh {
    /// Nodes with the root first; empty if there are no items.
    nodes: Vec<Node>,
}

impl Bvh {
    /// Builds the tree over boxes. Returns it with the items of each leaf, at most `leaf_items`.
    pub fn build(boxes: &[Bounds], leaf_items: usize) -> (Self, Vec<Vec<u32>>) {
        let (mut bvh, mut leaves) = (Self::default(), Vec::new());
        if !boxes.is_empty() {
            let items = (0..boxes.len() as u32).collect();
            let mut builder = Builder { boxes, leaf_items, order: items, nodes: vec![Binary::EMPTY] };
            builder.split(0, 0, boxes.len(), 0);
            builder.widened(0, &mut bvh, &mut leaves);
        }
        (bvh, leaves)
    }

    /// Visits the leaves whose boxes the ray hits before `t_max`, near ones first. `visit` may lower `t_max`; the walk
    /// ends when it returns true.
    pub fn walk(&self, ray: &Ray, t_max: &mut f32, mut visit: impl FnMut(usize, &mut f32) -> bool) {
        let mut stack = [(0f32, 0u32); STACK];
        let mut pending = usize::from(!self.nodes.is_empty());
        while pending > 0 {
            pending -= 1;
            let (entry, child) = stack[pending];
            if entry > *t_max {
                continue;
            }
            if child & LEAF != 0 {
                if visit((child & !LEAF) as usize, t_max) {
                    return;
                }
                continue;
            }
            let node = &self.nodes[child as usize];
            let (entries, mut met) = ray.enters(node, *t_max);
            let begin = pending;
            while met != 0 {
                let lane = met.trailing_zeros() as usize & (LANES - 1);
                met &= met - 1;
                // Insertion sort keeps the nearest child on top.
                let mut place = pending;
                while place > begin && stack[place - 1].0 < entries[lane] {
                    stack[place] = stack[place - 1];
                    place -= 1;
                }
                stack[place] = (entries[lane], node.children[lane]);
                pending += 1;
            }
        }
    }
}

/// Node of the binary tree from which the wide one is made.
#[derive(Clone, Copy)]
struct Binary {
    bounds: Bounds,
    /// First item of a leaf, or index of the left child, which the right one follows.
    first: u32,
    /// Number of items of a leaf; 0 for an inner node.
    count: u32,
}

impl Binary {
    const EMPTY: Self = Self { bounds: Bounds::EMPTY, first: 0, count: 0 };
}

struct Builder<'a> {
    boxes: &'a [Bounds],
    leaf_items: usize,
    order: Vec<u32>,
    nodes: Vec<Binary>,
}

impl Builder<'_> {
    /// Adds a wide node with the grandchildren of a binary node and everything below; returns its index.
    fn widened(&self, root: u32, bvh: &mut Bvh, leaves: &mut Vec<Vec<u32>>) -> u32 {
        let below = |n: u32| match self.nodes[n as usize] {
            Binary { count: 0, first, .. } => vec![first, first + 1],
            _ => vec![n],
        };
        let children: Vec<u32> = below(root).into_iter().flat_map(below).collect();
        let number = bvh.nodes.len();
        let none = [Vec4::ZERO; 3];
        let lanes = (1 << children.len()) - 1;
        bvh.nodes.push(Node { low: none, high: none, children: [0; LANES], lanes });
        for (lane, &child) in children.iter().enumerate() {
            let Binary { bounds, first, count } = self.nodes[child as usize];
            let code = if count > 0 {
                leaves.push(self.order[first as usize..(first + count) as usize].to_vec());
                LEAF | (leaves.len() - 1) as u32
            } else {
                self.widened(child, bvh, leaves)
            };
            let node = &mut bvh.nodes[number];
            node.children[lane] = code;
            for axis in 0..3 {
                node.low[axis][lane] = bounds.low[axis];
                node.high[axis][lane] = bounds.high[axis];
            }
        }
        number as u32
    }

    fn split(&mut self, node: usize, begin: usize, end: usize, depth: usize) {
        let of = |item: &u32| self.boxes[*item as usize];
        let bounds = self.order[begin..end].iter().map(of).fold(Bounds::EMPTY, Bounds::union);
        // Flat boxes get some thickness, so that rays within their plane need no special case.
        let grow = Vec3::splat(1e-5 * (1.0 + bounds.high.abs().max_element().max(bounds.low.abs().max_element())));
        self.nodes[node].bounds = Bounds { low: bounds.low - grow, high: bounds.high + grow };
        let middle = match end - begin <= self.leaf_items {
            true => None,
            false if depth >= MAX_DEPTH => Some((begin + end) / 2),
            false => self.partition(begin, end),
        };
        let Some(middle) = middle else {
            self.nodes[node].first = begin as u32;
            self.nodes[node].count = (end - begin) as u32;
            return;
        };
        let left = self.nodes.len();
        self.nodes[node].first = left as u32;
        self.nodes.extend([Binary::EMPTY; 2]);
        self.split(left, begin, middle, depth + 1);
        self.split(left + 1, middle, end, depth + 1);
    }

    /// Moves the items of the first side to the front and returns where the second begins.
    fn partition(&mut self, begin: usize, end: usize) -> Option<usize> {
        let boxes = self.boxes;
        let centre = |item: u32| boxes[item as usize].centre();
        let items = &mut self.order[begin..end];
        let spread = items.iter().fold(Bounds::EMPTY, |b, &i| b.with(centre(i)));
        let mut best: Option<(f32, usize, usize)> = None;
        for axis in 0..3 {
            let (low, width) = (spread.low[axis], spread.high[axis] - spread.low[axis]);
            if width <= 0.0 {
                continue;
            }
            let mut bins = [(Bounds::EMPTY, 0u32); BINS];
            for &item in items.iter() {
                let bin = &mut bins[bin_of(centre(item)[axis], low, width)];
                *bin = (bin.0.union(boxes[item as usize]), bin.1 + 1);
            }
            for cut in 1..BINS {
                let side = |bins: &[(Bounds, u32)]| {
                    let (b, n) = bins.iter().fold((Bounds::EMPTY, 0), |(b, n), bin| (b.union(bin.0), n + bin.1));
                    if n == 0 { f32::INFINITY } else { b.area() * n as f32 }
                };
                let cost = side(&bins[..cut]) + side(&bins[cut..]);
                if cost.is_finite() && best.is_none_or(|b| cost < b.0) {
                    best = Some((cost, axis, cut));
                }
            }
        }
        let Some((_, axis, cut)) = best else { return Some((begin + end) / 2) };
        let (low, width) = (spread.low[axis], spread.high[axis] - spread.low[axis]);
        items.sort_by_key(|&item| bin_of(centre(item)[axis], low, width) >= cut);
        Some(begin + items.partition_point(|&item| bin_of(centre(item)[axis], low, width) < cut))
    }
}

fn bin_of(centre: f32, low: f32, width: f32) -> usize {
    (((centre - low) / width * BINS as f32) as usize).min(BINS - 1)
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;

    /// Every box that a ray hits is visited, and none twice.
    #[test]
    fn a_walk_visits_what_the_ray_meets() {
        let mut rng = Rng::new(4);
        let mut point = |size: f64| (rng.unit_vector() * size).as_vec3();
        let boxes: Vec<Bounds> = (0..500)
            .map(|_| {
                let centre = point(10.0);
                Bounds::EMPTY.with(centre - point(0.5).abs()).with(centre + point(0.5).abs())
            })
            .collect();
        let (bvh, leaves) = Bvh::build(&boxes, 3);
        for _ in 0..200 {
            let ray = Ray::new(point(12.0), point(1.0));
            let mut seen: Vec<u32> = Vec::new();
            bvh.walk(&ray, &mut f32::INFINITY.clone(), |leaf, _| {
                seen.extend(&leaves[leaf]);
                false
            });
            let meets = |b: &Bounds| {
                let (u, v) = ((b.low - ray.origin) * ray.inverse, (b.high - ray.origin) * ray.inverse);
                u.min(v).max_element().max(0.0) <= u.max(v).min_element()
            };
            for (i, b) in boxes.iter().enumerate() {
                let count = seen.iter().filter(|&&s| s as usize == i).count();
                assert!(count <= 1 && (count == 1 || !meets(b)), "{i}");
            }
        }
        assert!(leaves.iter().all(|items| (1..=3).contains(&items.len())));
        Bvh::build(&[], 1).0.walk(&Ray::new(Vec3::ZERO, Vec3::X), &mut 1.0, |_, _| panic!("visited nothing"));
        assert_eq!(Bvh::build(&[boxes[0]; 50], 1).1.len(), 50);
    }
}
