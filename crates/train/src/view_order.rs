//! The training view of each step: every view once per epoch, in an order that depends only on seed and epoch, so that
//! a resumed run needs no state.

use instgs_vk::math::rng::Rng;

/// Sub-stream of the seed that orders views ("view" in ASCII); other parts of training take other streams.
const VIEW_STREAM: u64 = 0x7669_6577;

/// The views 0..`views` in the order of `epoch`: a seeded shuffle. With two or more views, an epoch never starts with
/// the view that the previous one ended with.
pub fn epoch_order(seed: u64, epoch: u64, views: usize) -> Vec<usize> {
    // Two views can only alternate, so all epochs are alike.
    let epoch = if views == 2 { 0 } else { epoch };
    let (mut order, mut rng) = shuffled(seed, epoch, views);
    if views < 3 || epoch == 0 {
        return order;
    }
    let (before, _) = shuffled(seed, epoch - 1, views);
    if before.last() == order.first() {
        // The last view stays in place, as the next epoch computes it without this swap.
        order.swap(0, 1 + rng.index(views - 2));
    }
    order
}

fn shuffled(seed: u64, epoch: u64, views: usize) -> (Vec<usize>, Rng) {
    let mut rng = Rng::new(seed).fork(VIEW_STREAM).fork(epoch);
    let mut order: Vec<usize> = (0..views).collect();
    rng.shuffle(&mut order);
    (order, rng)
}

/// The view of each step; caches the order of the current epoch.
#[derive(Clone, Debug)]
pub struct ViewOrder {
    seed: u64,
    views: usize,
    epoch: u64,
    order: Vec<usize>,
}

impl ViewOrder {
    /// An order of `views` training views.
    pub fn new(seed: u64, views: usize) -> Self {
        Self { seed, views, epoch: 0, order: epoch_order(seed, 0, views) }
    }

    /// Index of the view that step index `step` (from 0) uses; `None` if there are no views. Steps may be asked for in
    /// any order; those of one epoch in a row are fast.
    pub fn view_at(&mut self, step: u64) -> Option<usize> {
        let epoch = step.checked_div(self.views as u64)?;
        if epoch != self.epoch {
            self.order = epoch_order(self.seed, epoch, self.views);
            self.epoch = epoch;
        }
        self.order.get((step % self.views as u64) as usize).copied()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn views(seed: u64, count: usize, steps: std::ops::Range<u64>) -> Vec<usize> {
        let mut order = ViewOrder::new(seed, count);
        steps.filter_map(|s| order.view_at(s)).collect()
    }

    #[test]
    fn every_epoch_has_every_view_once_and_none_comes_twice_in_a_row() {
        for count in 1..9 {
            for seed in 0..20 {
                let all = views(seed, count, 0..50 * count as u64);
                for epoch in all.chunks(count) {
                    let mut sorted = epoch.to_vec();
                    sorted.sort_unstable();
                    assert_eq!(sorted, (0..count).collect::<Vec<_>>());
                }
                assert!(count == 1 || all.windows(2).all(|w| w[0] != w[1]), "{count} views, seed {seed}: {all:?}");
            }
        }
    }

    #[test]
    fn resuming_anywhere_gives_the_same_views() {
        let all = views(7, 5, 0..100);
        for start in 0..100 {
            assert_eq!(views(7, 5, start..100), all[start as usize..]);
        }
        assert_eq!(ViewOrder::new(7, 0).view_at(3), None);
    }

    #[test]
    fn seeds_and_epochs_differ() {
        assert_ne!(epoch_order(1, 0, 50), epoch_order(2, 0, 50));
        assert_ne!(epoch_order(1, 0, 50), epoch_order(1, 1, 50));
        assert_eq!(epoch_order(1, 3, 50), epoch_order(1, 3, 50));
    }

    /// The swap at the border of epochs must not favour a view: 6000 epochs of 4 views, 1500 expected first places
    /// each, standard deviation 34.
    #[test]
    fn first_places_are_fairly_spread() {
        let mut first = [0u32; 4];
        (0..6000).for_each(|epoch| first[epoch_order(3, epoch, 4)[0]] += 1);
        assert!(first.iter().all(|&n| (1330..1670).contains(&n)), "{first:?}");
    }
}
