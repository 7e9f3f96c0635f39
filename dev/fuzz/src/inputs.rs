//! The inputs of a target, by number. They come in batches of 64. A batch begins with a seed; an input that the reader accepts may
//! become what the following ones of its batch are made from, so that they get further from the seed.

use instgs_vk::math::rng::Rng;

use crate::mutation::mutate;
use crate::{Seed, Target};

/// Number of inputs of a batch.
pub const BATCH: u64 = 64;
/// How often the checksums of an input are made right, where the target can do that.
const REPAIRED: f64 = 0.75;
/// How often an accepted input replaces what the batch began with.
const KEPT: f64 = 0.5;
/// Most bytes of an input beyond twice those of the largest seed.
const GROWTH_BYTES: usize = 1 << 10;

/// The inputs of one batch, a function of target, seed and number alone.
pub struct Batch<'a> {
    target: &'a Target,
    seeds: &'a [Seed],
    rng: Rng,
    base: Vec<u8>,
    limit_bytes: usize,
}

impl<'a> Batch<'a> {
    /// Batch `number` of a run with `seed`; `seeds` are the target's.
    ///
    /// # Panics
    /// There are no seeds.
    pub fn new(target: &'a Target, seeds: &'a [Seed], seed: u64, number: u64) -> Self {
        let mut rng = Rng::new(seed).fork(number);
        let base = seeds[rng.index(seeds.len())].bytes.clone();
        let largest = seeds.iter().map(|seed| seed.bytes.len()).max().unwrap_or_default();
        Self { target, seeds, rng, base, limit_bytes: 2 * largest + GROWTH_BYTES }
    }

    /// The next input.
    pub fn next_input(&mut self) -> Vec<u8> {
        let other = &self.seeds[self.rng.index(self.seeds.len())].bytes;
        let mut input = self.base.clone();
        // One change in half of all cases, rarely more than four.
        loop {
            mutate(&mut input, other, &mut self.rng);
            if self.rng.chance(0.5) {
                break;
            }
        }
        input.truncate(self.limit_bytes);
        if let Some(repair) = self.target.repair
            && self.rng.chance(REPAIRED)
        {
            repair(&mut input);
        }
        input
    }

    /// Takes note that the reader accepted an input.
    pub fn accepted(&mut self, input: Vec<u8>) {
        if self.rng.chance(KEPT) {
            self.base = input;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const TARGET: Target = Target { name: "x", seeds: || Ok(Vec::new()), repair: None, read: |_, _| true };

    #[test]
    fn a_batch_is_the_same_each_time_and_no_other_is() {
        let seeds = [Seed::new("a", *b"{\"a\": 12.5}"), Seed::new("b", [7; 40])];
        let inputs = |seed, number| {
            let mut batch = Batch::new(&TARGET, &seeds, seed, number);
            let one = |_| {
                let input = batch.next_input();
                batch.accepted(input.clone());
                input
            };
            (0..BATCH).map(one).collect::<Vec<_>>()
        };
        assert_eq!(inputs(1, 2), inputs(1, 2));
        assert!(inputs(1, 2) != inputs(1, 3) && inputs(1, 2) != inputs(2, 2));
        assert!(inputs(1, 2).iter().all(|input| input.len() <= 80 + GROWTH_BYTES));
    }
}
