//! Clusters masks into objects where the views agree: Yan et al., MaskClustering (CVPR 2024), Section 3.3.
//!
//! Two nodes (sets of masks) are joined if at least nine in ten of the views that see each of them in one mask see both
//! in the *same* mask. Pairs seen by many views have better evidence and are joined first.
//!
//! Chains of such pairs can join repeated objects that stand side by side, so one rule is added: nodes that own
//! different masks in many views and are far apart are two objects.

use std::cmp::Ordering;

use rayon::prelude::*;

use super::bits::Bits;
use super::observe::Observations;
use super::relations::Relations;
use crate::segment::components::Partition;

/// Part of the observing views that must see both nodes in one mask (MaskClustering).
const CONSENSUS_RATE: f64 = 0.9;
/// Steps of the schedule: percentiles of the numbers of observers over all pairs, each the least number that a pair
/// needs to be joined in that step (MaskClustering).
const PERCENTILES: [u32; 20] = [95, 90, 85, 80, 75, 70, 65, 60, 55, 50, 45, 40, 35, 30, 25, 20, 15, 10, 5, 0];
/// Below this percentile a single observer ends the schedule; above, it is enough (MaskClustering).
const LEAST_PERCENTILE_OF_ONE: u32 = 50;
/// Number of nodes whose pairs give the percentiles: two million pairs are enough.
const MOST_SAMPLED_NODES: usize = 2000;
/// Nodes that own different masks in this part of the views that see both are two objects if they are far apart ...
const CONFLICT_PART: f64 = 0.3;
/// ... by more than half the diagonal of a box of their size: for uniform points it is sqrt(12) deviations.
const FAR_DEVIATIONS: f64 = 1.732;

/// A set of masks that may show one object.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Node {
    /// Views that see it in one mask.
    visible: Bits,
    /// Views in which it owns a mask.
    own_views: Bits,
    /// Masks that contain it, ascending.
    containers: Vec<u32>,
    /// Its own masks, ascending.
    pub(super) masks: Vec<u32>,
    /// The points of its masks, ascending.
    pub(super) points: Vec<u32>,
}

impl Node {
    fn of_mask(observations: &Observations, relations: &Relations, mask: u32) -> Self {
        let m = mask as usize;
        let mut own_views = Bits::new(observations.view_count);
        own_views.insert(observations.masks[m].view as usize);
        Self {
            visible: relations.visible[m].clone(),
            own_views,
            containers: relations.containers[m].clone(),
            masks: vec![mask],
            points: observations.points_of_mask[m].clone(),
        }
    }

    fn absorb(&mut self, other: Self) {
        self.visible.unite(&other.visible);
        self.own_views.unite(&other.own_views);
        self.containers = united(&self.containers, &other.containers);
        self.masks = united(&self.masks, &other.masks);
        self.points = united(&self.points, &other.points);
    }
}

/// Union of two ascending lists, ascending.
pub(super) fn united(a: &[u32], b: &[u32]) -> Vec<u32> {
    let mut out = [a, b].concat();
    out.sort_unstable();
    out.dedup();
    out
}

/// The nodes left when all pairs that the views agree on are joined, in order of their smallest mask. `positions` are
/// those of the points.
pub(super) fn cluster(observations: &Observations, relations: &Relations, positions: &[[f32; 3]]) -> Vec<Node> {
    let masks = (0..observations.masks.len() as u32).filter(|&mask| relations.is_node[mask as usize]);
    let mut nodes: Vec<Node> = masks.map(|mask| Node::of_mask(observations, relations, mask)).collect();
    for observers in schedule(&nodes) {
        nodes = joined(nodes, observations, observers, positions);
    }
    nodes
}

/// The least number of observers in each step, never increasing.
fn schedule(nodes: &[Node]) -> Vec<u32> {
    let stride = nodes.len().div_ceil(MOST_SAMPLED_NODES).max(1);
    let sampled: Vec<&Node> = nodes.iter().step_by(stride).collect();
    let of_node =
        |(i, a): (usize, &&Node)| sampled[i + 1..].iter().map(|b| a.visible.count_common(&b.visible)).collect();
    let counts: Vec<Vec<u32>> = sampled.par_iter().enumerate().map(of_node).collect();
    let mut counts: Vec<u32> = counts.into_iter().flatten().filter(|&count| count > 0).collect();
    counts.sort_unstable();
    let mut out = Vec::new();
    for percentile in PERCENTILES {
        let Some(last) = counts.len().checked_sub(1) else { break };
        let value = counts[last * percentile as usize / 100];
        if value <= 1 && percentile < LEAST_PERCENTILE_OF_ONE {
            break;
        }
        out.push(value.max(1));
    }
    out
}

/// A pair of nodes that the views agree to join.
struct Edge {
    nodes: [u32; 2],
    /// Number of views that see both in the same mask.
    supporters: u32,
    /// Number of views that see both.
    observers: u32,
}

/// Joins the pairs that at least `observers` views see, in order of falling agreement.
fn joined(nodes: Vec<Node>, observations: &Observations, observers: u32, positions: &[[f32; 3]]) -> Vec<Node> {
    let mut edges = edges(&nodes, observations.masks.len(), observers);
    // a/b > c/d compared without rounding: a d > c b.
    let by_rate = |a: &Edge, b: &Edge| -> Ordering {
        let product = |x: &Edge, y: &Edge| u64::from(x.supporters) * u64::from(y.observers);
        product(b, a).cmp(&product(a, b)).then(b.supporters.cmp(&a.supporters)).then(a.nodes.cmp(&b.nodes))
    };
    edges.sort_by(by_rate);
    let mut partition = Partition::new(nodes.len());
    let mut slots: Vec<Option<Node>> = nodes.into_iter().map(Some).collect();
    for edge in edges {
        let [a, b] = edge.nodes.map(|node| partition.root(node as usize));
        let (Some(first), Some(second)) = (&slots[a], &slots[b]) else { continue };
        if a == b || are_two_objects(first, second, observations, positions) {
            continue;
        }
        partition.join(a, b);
        let (kept, gone) = (a.min(b), a.max(b));
        if let (Some(other), Some(node)) = (slots[gone].take(), &mut slots[kept]) {
            node.absorb(other);
        }
    }
    slots.into_iter().flatten().collect()
}

/// All pairs with enough observers and enough agreement.
fn edges(nodes: &[Node], mask_count: usize, observers: u32) -> Vec<Edge> {
    let mut contained: Vec<Vec<u32>> = vec![Vec::new(); mask_count];
    for (i, node) in (0..).zip(nodes) {
        node.containers.iter().for_each(|&container| contained[container as usize].push(i));
    }
    let counts = || vec![0u32; nodes.len()];
    // Only pairs with a common container have supporters.
    let of_node = |counts: &mut Vec<u32>, (i, a): (usize, &Node)| {
        let mut touched = Vec::new();
        for &j in a.containers.iter().flat_map(|&c| &contained[c as usize]).filter(|&&j| j as usize > i) {
            if counts[j as usize] == 0 {
                touched.push(j);
            }
            counts[j as usize] += 1;
        }
        touched.sort_unstable();
        let edge = |&j: &u32| {
            let supporters = std::mem::take(&mut counts[j as usize]);
            let seen = a.visible.count_common(&nodes[j as usize].visible);
            let agrees = f64::from(supporters) >= CONSENSUS_RATE * f64::from(seen);
            (seen >= observers && agrees).then_some(Edge { nodes: [i as u32, j], supporters, observers: seen })
        };
        touched.iter().filter_map(edge).collect::<Vec<Edge>>()
    };
    nodes.par_iter().enumerate().map_init(counts, of_node).flatten_iter().collect()
}

/// Whether many views give the two nodes different masks whose points are far apart.
fn are_two_objects(a: &Node, b: &Node, observations: &Observations, positions: &[[f32; 3]]) -> bool {
    let conflicts = a.own_views.count_common(&b.own_views);
    let seen = a.visible.count_common(&b.visible);
    if conflicts == 0 || f64::from(conflicts) < CONFLICT_PART * f64::from(seen) {
        return false;
    }
    // Only masks in conflict count: others may show both objects as one.
    let points = |node: &Node, other: &Node| {
        let of_mask = |&mask: &u32| {
            let in_conflict = other.own_views.contains(observations.masks[mask as usize].view as usize);
            in_conflict.then(|| observations.points_of_mask[mask as usize].as_slice())
        };
        let mut all: Vec<u32> = node.masks.iter().filter_map(of_mask).flatten().copied().collect();
        all.sort_unstable();
        all.dedup();
        all
    };
    let [(centre_a, deviation_a), (centre_b, deviation_b)] =
        [points(a, b), points(b, a)].map(|points| spread(&points, positions));
    let distance = (0..3).map(|k| (centre_a[k] - centre_b[k]).powi(2)).sum::<f64>().sqrt();
    distance > FAR_DEVIATIONS * deviation_a.max(deviation_b)
}

/// Mean of the points, and the root of their mean squared distance from it.
fn spread(points: &[u32], positions: &[[f32; 3]]) -> ([f64; 3], f64) {
    let count = points.len().max(1) as f64;
    let at = |point: &u32, k: usize| f64::from(positions[*point as usize][k]);
    let mean = [0, 1, 2].map(|k| points.iter().map(|point| at(point, k)).sum::<f64>() / count);
    let square = |point: &u32| (0..3).map(|k| (at(point, k) - mean[k]).powi(2)).sum::<f64>();
    (mean, (points.iter().map(square).sum::<f64>() / count).sqrt())
}

#[cfg(test)]
mod tests {
    use super::super::tests::Table;
    use super::*;

    /// Two objects that ten views see, always in the same masks, and nodes of their masks in some of these views.
    struct Pair {
        nodes: [Node; 2],
        observations: Observations,
        positions: Vec<[f32; 3]>,
    }

    fn set(views: &[usize]) -> Bits {
        let mut out = Bits::new(10);
        views.iter().for_each(|&view| out.insert(view));
        out
    }

    fn pair(own_views: [&[usize]; 2], apart: f32) -> Pair {
        let table = Table::new(&[[1, 2]; 10]);
        let observations = table.observations(1);
        let node = |object: usize| {
            let masks: Vec<u32> = own_views[object].iter().map(|view| (2 * view + object) as u32).collect();
            Node {
                visible: set(&[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]),
                own_views: set(own_views[object]),
                containers: (0..10).collect(),
                points: observations.points_of_mask[object].clone(),
                masks,
            }
        };
        let mut positions = table.positions().to_vec();
        let second = positions.len() / 2;
        positions[second..].iter_mut().for_each(|p| p[0] += apart - 10.0);
        Pair { nodes: [node(0), node(1)], observations, positions }
    }

    impl Pair {
        fn joins(self, observers: u32) -> bool {
            joined(self.nodes.into(), &self.observations, observers, &self.positions).len() == 1
        }
    }

    #[test]
    fn nodes_with_masks_of_their_own_that_are_far_apart_are_two_objects() {
        let (often, seldom): (&[usize], &[usize]) = (&[0, 1, 2], &[1, 2, 7]);
        assert!(!pair([often, often], 4.0).joins(10), "in three views of ten two masks, far apart");
        assert!(pair([often, often], 2.0).joins(10), "pieces that touch");
        assert!(pair([often, seldom], 4.0).joins(10), "in two views of ten");
        assert!(!pair([often, seldom], 4.0).joins(11), "not enough observers");
    }

    #[test]
    fn nodes_are_joined_where_nine_in_ten_agree() {
        let joins = |supporters: u32| {
            let mut pair = pair([&[0], &[1]], 4.0);
            pair.nodes[1].containers = (0..supporters).collect();
            pair.joins(1)
        };
        assert_eq!([8, 9, 10].map(joins), [false, true, true]);
    }

    #[test]
    fn the_schedule_goes_down_and_ends_at_single_observers() {
        let mut lonely = pair([&[0], &[1]], 4.0).nodes;
        assert_eq!(schedule(&lonely), [10; 20]);
        lonely[1].visible = set(&[3]);
        assert_eq!(schedule(&lonely), [1; 10]);
        assert!(schedule(&[]).is_empty());
    }
}
