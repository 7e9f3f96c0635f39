//! A set of small integers as a bit vector.

/// Bit `i % 64` of word `i / 64` is set if i is a member.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Bits(Vec<u64>);

impl Bits {
    /// An empty set for integers below `len`.
    pub(super) fn new(len: usize) -> Self {
        Self(vec![0; len.div_ceil(64)])
    }

    /// Adds the integer `i` < `len`.
    pub(super) fn insert(&mut self, i: usize) {
        self.0[i / 64] |= 1 << (i % 64);
    }

    /// Removes the integer `i` < `len`.
    pub(super) fn remove(&mut self, i: usize) {
        self.0[i / 64] &= !(1 << (i % 64));
    }

    /// Whether the integer `i` < `len` is a member.
    pub(super) fn contains(&self, i: usize) -> bool {
        self.0[i / 64] >> (i % 64) & 1 == 1
    }

    /// Adds all members of `other`, a set of the same length.
    pub(super) fn unite(&mut self, other: &Self) {
        self.0.iter_mut().zip(&other.0).for_each(|(a, b)| *a |= b);
    }

    /// Number of members that both sets have.
    pub(super) fn count_common(&self, other: &Self) -> u32 {
        self.0.iter().zip(&other.0).map(|(a, b)| (a & b).count_ones()).sum()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sets_of_numbers() {
        let set = |numbers: &[usize]| {
            let mut out = Bits::new(130);
            numbers.iter().for_each(|&i| out.insert(i));
            out
        };
        let (mut a, b) = (set(&[0, 63, 64, 129]), set(&[1, 63, 129]));
        assert_eq!((a.count_common(&b), a.count_common(&a)), (2, 4));
        assert!(a.contains(63) && !a.contains(1));
        a.remove(63);
        assert_eq!(a.count_common(&b), 1);
        a.unite(&b);
        assert_eq!(a, set(&[0, 1, 63, 64, 129]));
        assert_eq!(Bits::new(0).count_common(&Bits::new(0)), 0);
    }
}
