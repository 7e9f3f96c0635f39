//! Colours that distinguish objects: each object has the same colour in every picture of a page.

use std::collections::BTreeMap;

/// Colours that differ clearly, on grey too: the lighter twelve of S. Trubetskoy's "20 simple, distinct colors".
const PALETTE: [[u8; 3]; 12] = [
    [230, 25, 75],
    [60, 180, 75],
    [255, 225, 25],
    [67, 99, 216],
    [245, 130, 49],
    [66, 212, 244],
    [240, 50, 230],
    [191, 239, 69],
    [145, 30, 180],
    [250, 190, 212],
    [70, 153, 144],
    [220, 190, 255],
];
/// Grey value, and its weight, that the palette is mixed with when it is used again: lighter, then darker.
const TURNS: [(f32, f32); 3] = [(0.0, 0.0), (255.0, 0.5), (0.0, 0.45)];
/// Weights of red, green and blue in luminance (Rec. 709), accurate enough for sRGB values.
const LUMINANCE: [f32; 3] = [0.2126, 0.7152, 0.0722];

/// Colours by object id; after 36 ids they repeat.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Colors {
    rank: BTreeMap<u32, usize>,
}

impl Colors {
    /// Assigns colours to these ids in ascending order; 0 is ignored.
    pub fn of_ids(ids: impl IntoIterator<Item = u32>) -> Self {
        let mut rank: BTreeMap<u32, usize> = ids.into_iter().filter(|&id| id != 0).map(|id| (id, 0)).collect();
        rank.values_mut().enumerate().for_each(|(i, rank)| *rank = i);
        Self { rank }
    }

    /// The colour of an id, sRGB; `None` for 0 and ids that were not given.
    pub fn of(&self, id: u32) -> Option<[u8; 3]> {
        let &rank = self.rank.get(&id)?;
        let (towards, part) = TURNS[rank / PALETTE.len() % TURNS.len()];
        Some(PALETTE[rank % PALETTE.len()].map(|c| (f32::from(c) * (1.0 - part) + towards * part).round() as u8))
    }

    /// The ids in ascending order.
    pub fn ids(&self) -> impl Iterator<Item = u32> + '_ {
        self.rank.keys().copied()
    }

    /// Number of colours that differ.
    pub const DISTINCT: usize = PALETTE.len() * TURNS.len();
}

/// The luminance of a colour, in the range of its channels.
pub(super) fn luminance(rgb: [f32; 3]) -> f32 {
    rgb.iter().zip(LUMINANCE).map(|(c, weight)| c * weight).sum()
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::*;

    #[test]
    fn ids_have_colours_of_their_own() {
        let colors = Colors::of_ids((0..40).map(|i| 500 * i));
        assert_eq!(colors.ids().count(), 39);
        assert_eq!((colors.of(0), colors.of(1)), (None, None));
        let seen: BTreeSet<_> = colors.ids().filter_map(|id| colors.of(id)).collect();
        assert_eq!(seen.len(), Colors::DISTINCT);
        assert_eq!(colors.of(500), Some(PALETTE[0]));
        assert_eq!(Colors::of_ids([9, 3, 9]), Colors::of_ids([3, 9]), "order and repeats do not matter");
    }
}
