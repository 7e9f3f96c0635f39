//! Labels of Gaussians that no view shows: those inside an object have no weight in any picture, but must move with it.

use std::collections::BTreeMap;
use std::num::NonZero;

use rayon::prelude::*;

use instgs_vk::math::nearest::PointSet;

/// An axis-aligned box in the world frame: low and high corner.
type Bounds = [[f64; 3]; 2];

/// Gives every Gaussian that is not `seen` the majority label of its `neighbours` nearest seen Gaussians (the lower
/// label in a tie) if it lies in the bounding box of that label's seen Gaussians, else 0. Gaussians in the same place
/// count once, with the label of the first; those with means that are not finite keep 0. Returns how many got a label
/// above 0.
pub fn label_unseen(means: &[[f32; 3]], seen: &[bool], labels: &mut [u16], neighbours: NonZero<usize>) -> usize {
    let places = distinct_places(means, seen);
    if places.is_empty() {
        return 0;
    }
    let set = PointSet::new(&places.iter().map(|&i| means[i]).collect::<Vec<_>>());
    let bounds = bounds_of_labels(means, seen, labels);
    let known = &*labels;
    let found: Vec<(usize, u16)> = (0..means.len())
        .into_par_iter()
        .filter(|&i| !seen[i] && is_finite(means[i]))
        .map(|i| {
            let mut counts: BTreeMap<u16, usize> = BTreeMap::new();
            for near in set.nearest(means[i], neighbours.get()) {
                *counts.entry(known[places[near.index as usize]]).or_default() += 1;
            }
            (i, most_frequent(&counts))
        })
        .filter(|&(i, label)| bounds.get(&label).is_some_and(|bounds| contains(bounds, wide(means[i]))))
        .collect();
    for &(i, label) in &found {
        labels[i] = label;
    }
    found.len()
}

fn wide(mean: [f32; 3]) -> [f64; 3] {
    // Adding 0 turns -0 into 0.
    mean.map(|v| f64::from(v) + 0.0)
}

fn is_finite(mean: [f32; 3]) -> bool {
    mean.iter().all(|v| v.is_finite())
}

/// The first seen Gaussian of every place, sorted by position: a tree takes quadratic time for points that coincide.
fn distinct_places(means: &[[f32; 3]], seen: &[bool]) -> Vec<usize> {
    let mut out: Vec<usize> = (0..means.len()).filter(|&i| seen[i] && is_finite(means[i])).collect();
    let order = |a: &usize, b: &usize| {
        let (p, q) = (wide(means[*a]), wide(means[*b]));
        p[0].total_cmp(&q[0]).then(p[1].total_cmp(&q[1])).then(p[2].total_cmp(&q[2])).then(a.cmp(b))
    };
    out.par_sort_unstable_by(order);
    out.dedup_by(|later, first| wide(means[*later]) == wide(means[*first]));
    out
}

/// The most frequent label; the lowest in a tie.
fn most_frequent(counts: &BTreeMap<u16, usize>) -> u16 {
    counts.iter().fold((0, 0), |best, (&label, &n)| if n > best.1 { (label, n) } else { best }).0
}

/// Bounding boxes of the seen Gaussians of every label above 0.
fn bounds_of_labels(means: &[[f32; 3]], seen: &[bool], labels: &[u16]) -> BTreeMap<u16, Bounds> {
    let mut out = BTreeMap::new();
    for i in (0..means.len()).filter(|&i| seen[i] && labels[i] != 0 && is_finite(means[i])) {
        let mean = wide(means[i]);
        let [low, high] = out.entry(labels[i]).or_insert([mean, mean]);
        for axis in 0..3 {
            low[axis] = low[axis].min(mean[axis]);
            high[axis] = high[axis].max(mean[axis]);
        }
    }
    out
}

fn contains([low, high]: &Bounds, point: [f64; 3]) -> bool {
    (0..3).all(|axis| (low[axis]..=high[axis]).contains(&point[axis]))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The eight corners of a cube around `center`.
    fn cube(center: [f32; 3], half: f32) -> Vec<[f32; 3]> {
        (0..8).map(|c| [0, 1, 2].map(|axis| center[axis] + if c >> axis & 1 == 1 { half } else { -half })).collect()
    }

    #[test]
    fn the_inside_follows_its_shell_and_nothing_else_does() {
        let mut means = cube([0.0; 3], 1.0);
        means.extend(cube([10.0, 0.0, 0.0], 1.0));
        let mut labels = [vec![3; 8], vec![0; 8]].concat();
        let mut seen = vec![true; 16];
        // Inside of object 3; beside it; inside of the background's cube; not finite.
        means.extend([[0.1, 0.2, 0.3], [0.0, 1.5, 0.0], [10.0, 0.0, 0.0], [f32::NAN, 0.0, 0.0]]);
        labels.extend([0; 4]);
        seen.extend([false; 4]);
        let five = NonZero::new(5).unwrap();
        assert_eq!(label_unseen(&means, &seen, &mut labels, five), 1);
        assert_eq!(labels[16..], [3, 0, 0, 0]);
        assert_eq!(label_unseen(&means[16..], &seen[16..], &mut labels[16..], five), 0, "nothing is seen");
    }

    #[test]
    fn equal_numbers_of_neighbours_give_the_lower_label_and_a_place_counts_once() {
        // Two neighbours with label 2 and two with 5, all at the same distance; two more with 5 in a place that is
        // taken.
        let mut means = vec![[1.0, 1.0, 0.0], [-1.0, -1.0, 0.0], [1.0, -1.0, 0.0], [-1.0, 1.0, 0.0]];
        means.extend([[1.0, -1.0, 0.0], [1.0, -1.0, -0.0], [0.0; 3]]);
        let mut labels = vec![2, 2, 5, 5, 5, 5, 0];
        let seen = [true, true, true, true, true, true, false];
        assert_eq!(label_unseen(&means, &seen, &mut labels, NonZero::new(4).unwrap()), 1);
        assert_eq!(labels[6], 2);
    }

    /// A tree would take minutes for points that coincide.
    #[test]
    fn many_gaussians_in_one_place_take_no_time() {
        let mut means = vec![[0.5; 3]; 200_000];
        let mut labels = vec![7; 200_000];
        let mut seen = vec![true; 200_000];
        (means[199_999], labels[199_999], seen[199_999]) = ([0.5; 3], 0, false);
        assert_eq!(label_unseen(&means, &seen, &mut labels, NonZero::new(8).unwrap()), 1);
    }
}
