//! Eq. 2-3 of the paper in integers. For a Gaussian i and an instance k, `inside[i, k]` is the weight of i in the
//! pixels of k's masks, and `shown[i, k]` its weight in all pixels of the views in which k has a mask. Views in which k
//! has no mask do not count: a detector misses objects.
//!
//! Only pairs that occur are kept, about two per Gaussian whatever the number of instances. Sums are integers, so they
//! do not depend on the order of views.

use instgs_vk::render::Contribution;

/// Weights of one pair of a Gaussian and an instance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Vote {
    /// Index of the Gaussian.
    pub gaussian: u32,
    /// Id of the instance, above 0.
    pub id: u16,
    /// Weight in the instance's masks, in units of 1 / [`instgs_vk::render::CONTRIBUTION_ONE`] pixel.
    pub inside: u64,
    /// Weight in all pixels of the views in which the instance has a mask, in the same unit; counted in a second sweep,
    /// when all pairs are known.
    pub shown: u64,
}

impl Vote {
    /// `inside - alpha (shown - inside)`: above 0 if more than alpha / (1 + alpha) of the shown weight is inside.
    pub fn gain(&self, alpha: f64) -> f64 {
        // Exact: both are below 2^53 for any realistic set of pictures, 2^29 pixels of weight 1.
        self.inside as f64 - alpha * self.shown.saturating_sub(self.inside) as f64
    }
}

/// The votes of all views.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Votes {
    /// Sorted by Gaussian, then by id.
    votes: Vec<Vote>,
    /// Weight of each Gaussian in all pixels of all views.
    weights: Vec<u64>,
    /// Number of views in which each Gaussian contributes to a pixel.
    views: Vec<u32>,
}

impl Votes {
    /// Empty votes for a cloud of `gaussians` Gaussians.
    pub fn new(gaussians: usize) -> Self {
        Self { votes: Vec::new(), weights: vec![0; gaussians], views: vec![0; gaussians] }
    }

    /// Weight of each Gaussian in all pixels of all views; 0 = never seen.
    pub fn weights(&self) -> &[u64] {
        &self.weights
    }

    /// Number of views in which each Gaussian contributes to a pixel.
    pub fn views(&self) -> &[u32] {
        &self.views
    }

    /// Adds one view to the total weights, whatever its mask; `contributions` are sorted by Gaussian.
    pub fn add_weights(&mut self, contributions: &[Contribution]) {
        for of_gaussian in contributions.chunk_by(|a, b| a.gaussian == b.gaussian) {
            let gaussian = of_gaussian[0].gaussian as usize;
            let weight: u64 = of_gaussian.iter().map(|c| c.weight).sum();
            self.weights[gaussian] += weight;
            self.views[gaussian] += u32::from(weight > 0);
        }
    }

    /// First sweep: adds the `contributions` of one view, sorted by Gaussian and id, to `inside`.
    pub fn add_inside(&mut self, contributions: &[Contribution]) {
        let mut old = std::mem::take(&mut self.votes).into_iter().peekable();
        let mut merged = Vec::with_capacity(old.len() + contributions.len());
        for c in contributions.iter().filter(|c| c.id != 0) {
            let key = (c.gaussian, c.id);
            while let Some(vote) = old.next_if(|vote| (vote.gaussian, vote.id) < key) {
                merged.push(vote);
            }
            let known = old.next_if(|vote| (vote.gaussian, vote.id) == key);
            let mut vote = known.unwrap_or(Vote { gaussian: c.gaussian, id: c.id, inside: 0, shown: 0 });
            vote.inside += c.weight;
            merged.push(vote);
        }
        merged.extend(old);
        self.votes = merged;
    }

    /// Second sweep: adds the same view to `shown` of the instances for which `has_mask`, indexed by id, is true.
    pub fn add_shown(&mut self, contributions: &[Contribution], has_mask: &[bool]) {
        let mut votes = self.votes.iter_mut().peekable();
        for of_gaussian in contributions.chunk_by(|a, b| a.gaussian == b.gaussian) {
            let gaussian = of_gaussian[0].gaussian;
            let weight: u64 = of_gaussian.iter().map(|c| c.weight).sum();
            while votes.next_if(|vote| vote.gaussian < gaussian).is_some() {}
            while let Some(vote) = votes.next_if(|vote| vote.gaussian == gaussian) {
                vote.shown += if has_mask.get(usize::from(vote.id)).is_some_and(|&has| has) { weight } else { 0 };
            }
        }
    }

    /// All votes, sorted by Gaussian and id.
    pub fn all(&self) -> &[Vote] {
        &self.votes
    }

    /// Id with the largest gain for each Gaussian, the lower one in a tie; 0 if no gain is above 0.
    pub fn winners(&self, alpha: f64) -> Vec<u16> {
        let mut out = vec![0; self.weights.len()];
        for of_gaussian in self.votes.chunk_by(|a, b| a.gaussian == b.gaussian) {
            let mut best = (0, 0.0);
            for vote in of_gaussian {
                let gain = vote.gain(alpha);
                best = if gain > best.1 { (vote.id, gain) } else { best };
            }
            out[of_gaussian[0].gaussian as usize] = best.0;
        }
        out
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn contribution(gaussian: u32, id: u16, weight: u64) -> Contribution {
        Contribution { gaussian, id, weight }
    }

    fn has_mask(ids: &[u16]) -> Vec<bool> {
        (0..=u16::MAX).map(|id| ids.contains(&id)).collect()
    }

    /// Three views; instance 9 has no mask in the second, instance 4 only in the third.
    fn counted() -> Votes {
        let views = [
            (vec![contribution(0, 0, 10), contribution(0, 9, 30), contribution(2, 9, 5)], vec![9]),
            (vec![contribution(0, 0, 100), contribution(2, 0, 1)], vec![]),
            (vec![contribution(0, 4, 40), contribution(0, 9, 7), contribution(1, 0, 8)], vec![4, 9]),
        ];
        let mut votes = Votes::new(4);
        views.iter().for_each(|(contributions, _)| votes.add_weights(contributions));
        views.iter().for_each(|(contributions, _)| votes.add_inside(contributions));
        views.iter().for_each(|(contributions, ids)| votes.add_shown(contributions, &has_mask(ids)));
        votes
    }

    #[test]
    fn views_without_a_mask_of_the_instance_do_not_count() {
        let votes = counted();
        let vote = |gaussian, id, inside, shown| Vote { gaussian, id, inside, shown };
        assert_eq!(votes.votes, [vote(0, 4, 40, 47), vote(0, 9, 37, 87), vote(2, 9, 5, 5)]);
        assert_eq!(votes.weights(), [187, 8, 6, 0]);
        assert_eq!(votes.views(), [3, 1, 2, 0]);
    }

    #[test]
    fn the_largest_gain_wins_and_the_lower_id_of_equals() {
        assert_eq!(counted().winners(0.8), [4, 0, 9, 0]);
        let mut votes = Votes::new(1);
        let equal = [contribution(0, 3, 5), contribution(0, 7, 5)];
        votes.add_inside(&equal);
        votes.add_shown(&equal, &has_mask(&[3, 7]));
        assert_eq!(votes.winners(0.8), [3]);
        assert_eq!(votes.winners(1.0), [0], "a gain of 0 is none");
    }

    #[test]
    fn the_order_of_views_changes_nothing() {
        let a = [contribution(0, 1, 3), contribution(5, 2, 4)];
        let b = [contribution(0, 1, 1), contribution(3, 2, 9), contribution(5, 1, 2)];
        let run = |views: [&[Contribution]; 2]| {
            let mut votes = Votes::new(6);
            views.iter().for_each(|view| votes.add_inside(view));
            votes
        };
        assert_eq!(run([&a, &b]), run([&b, &a]));
    }
}
