//! Draws the template's Gaussians from the merged cloud of all instances.
//!
//! The merged cloud has up to millions of Gaussians, K times too many, at a density that varies over the object. The
//! draw keeps that density, because scales were trained for it: the cloud is sorted along a Morton curve (the
//! depth-first order of an octree) and cut into runs, each of which gives its share.

use rayon::prelude::*;

use super::options::Sampling;
use instgs_vk::math::morton::morton_order;
use instgs_vk::math::rng::Rng;

/// Points drawn from one run of farthest-point sampling. The cost is this times the size of the merged cloud; runs are
/// independent, so short ones leave uneven spacing along their borders.
const DRAWN_PER_RUN: usize = 256;

/// Indices of at most `count` of the points, in Morton order.
pub(super) fn draw(means: &[[f32; 3]], count: usize, sampling: Sampling, mut rng: Rng) -> Vec<u32> {
    let order = morton_order(means);
    if count >= order.len() {
        return order;
    }
    match sampling {
        Sampling::Farthest => farthest(means, &order, count),
        Sampling::Voxel => {
            let run = |r: usize| share(r, order.len(), count)..share(r + 1, order.len(), count);
            (0..count).map(|r| order[run(r).start + rng.index(run(r).len())]).collect()
        }
        Sampling::Random => random(&order, count, &mut rng),
    }
}

/// Start of part `r` when `len` items are cut into `parts` equal parts.
fn share(r: usize, len: usize, parts: usize) -> usize {
    (r as u128 * len as u128 / parts as u128) as usize
}

/// A uniform random subset of `count` elements, in the order of `order` (Knuth's selection sampling).
fn random(order: &[u32], count: usize, rng: &mut Rng) -> Vec<u32> {
    let mut out = Vec::with_capacity(count);
    for (passed, &i) in order.iter().enumerate() {
        if rng.index(order.len() - passed) < count - out.len() {
            out.push(i);
        }
    }
    out
}

/// Farthest points of each run, in the run's order.
fn farthest(means: &[[f32; 3]], order: &[u32], count: usize) -> Vec<u32> {
    let runs = count.div_ceil(DRAWN_PER_RUN);
    let drawn: Vec<Vec<u32>> = (0..runs)
        .into_par_iter()
        .map(|r| {
            let run = &order[share(r, order.len(), runs)..share(r + 1, order.len(), runs)];
            farthest_of_run(means, run, share(r + 1, count, runs) - share(r, count, runs))
        })
        .collect();
    drawn.concat()
}

/// `count` elements of `run`: the one nearest to its centroid, then always the one farthest from all before.
fn farthest_of_run(means: &[[f32; 3]], run: &[u32], count: usize) -> Vec<u32> {
    let position = |i: u32| means[i as usize].map(f64::from);
    let squared = |p: [f64; 3], q: [f64; 3]| (0..3).map(|k| (p[k] - q[k]) * (p[k] - q[k])).sum::<f64>();
    let mut middle = [0.0; 3];
    for &i in run {
        let p = position(i);
        (0..3).for_each(|k| middle[k] += p[k] / run.len() as f64);
    }
    let mut distances: Vec<f64> = run.iter().map(|&i| -squared(position(i), middle)).collect();
    let mut taken = vec![false; run.len()];
    for round in 0..count.min(run.len()) {
        let mut best = None;
        for (rank, &distance) in distances.iter().enumerate() {
            if !taken[rank] && best.is_none_or(|b: usize| distance > distances[b]) {
                best = Some(rank);
            }
        }
        let Some(best) = best else { break };
        taken[best] = true;
        let p = position(run[best]);
        for (distance, &i) in distances.iter_mut().zip(run) {
            let to_taken = squared(position(i), p);
            *distance = if round == 0 { to_taken } else { distance.min(to_taken) };
        }
    }
    run.iter().zip(taken).filter(|(_, taken)| *taken).map(|(&i, _)| i).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::nearest::PointSet;

    const ALL: [Sampling; 3] = [Sampling::Farthest, Sampling::Voxel, Sampling::Random];

    /// A unit square whose left half is four times as dense as its right.
    fn uneven(len: usize) -> Vec<[f32; 3]> {
        let mut rng = Rng::new(1);
        let x = |rng: &mut Rng| if rng.chance(0.8) { 0.5 * rng.uniform() } else { 0.5 + 0.5 * rng.uniform() };
        (0..len).map(|_| [x(&mut rng) as f32, rng.uniform() as f32, 0.0]).collect()
    }

    #[test]
    fn draws_the_wanted_number_once_each_and_repeats() {
        for len in [1, 7, 1000] {
            let means = uneven(len);
            for sampling in ALL {
                for count in [0, 1, len / 3, len, len + 5] {
                    let drawn = draw(&means, count, sampling, Rng::new(3));
                    assert_eq!(drawn, draw(&means, count, sampling, Rng::new(3)));
                    let mut sorted = drawn.clone();
                    sorted.sort_unstable();
                    sorted.dedup();
                    assert_eq!((sorted.len(), drawn.len()), (count.min(len), count.min(len)), "{sampling:?}");
                }
            }
        }
        assert!(draw(&[], 4, Sampling::Farthest, Rng::new(3)).is_empty());
    }

    /// Four fifths of the draw lie in the dense half (Random: standard deviation 0.9 %); the smallest distance of drawn
    /// points shows how even it is.
    #[test]
    fn keeps_the_density_and_spreads_evenly() {
        let means = uneven(40_000);
        let spread = ALL.map(|sampling| {
            let drawn: Vec<[f32; 3]> =
                draw(&means, 2000, sampling, Rng::new(5)).into_iter().map(|i| means[i as usize]).collect();
            let dense = drawn.iter().filter(|m| m[0] < 0.5).count();
            assert!((1540..1660).contains(&dense), "{sampling:?}: {dense}");
            let set = PointSet::new(&drawn);
            let mut apart: Vec<f64> = drawn.iter().map(|&m| set.nearest(m, 2)[1].squared_distance.sqrt()).collect();
            apart.sort_unstable_by(f64::total_cmp);
            apart[100]
        });
        assert!(spread[0] > 1.5 * spread[1] && spread[1] > spread[2], "{spread:?}");
    }

    /// Points that coincide, on a line, and with extreme coordinates.
    #[test]
    fn degenerate_clouds() {
        let line: Vec<[f32; 3]> = (0..500).map(|i| [i as f32, 0.0, 0.0]).collect();
        let extreme: Vec<[f32; 3]> =
            (0..500).map(|i| [f32::MAX * (i as f32 - 250.0) / 250.0, -f32::MAX, 1e-40]).collect();
        for means in [vec![[2.0; 3]; 500], line, extreme] {
            for sampling in ALL {
                assert_eq!(draw(&means, 100, sampling, Rng::new(1)).len(), 100);
            }
        }
    }
}
