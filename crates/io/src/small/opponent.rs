//! Colours in the order in which they are coded: of each SH band first the brightness of all coefficients, then their two
//! differences of colour (`math::opponent`). Each of the three is a part of its own, as brightness is by far the largest.

use instgs_vk::math::opponent::opponent_from_rgb;

/// Rows of red, green and blue by coefficient, as they are coded; `bands` are the numbers of coefficients of the bands.
pub(super) fn to_opponent(rgb: &[f32], bands: &[usize]) -> Vec<f32> {
    let mut out = rgb.to_vec();
    for row in out.chunks_exact_mut(3 * bands.iter().sum::<usize>().max(1)) {
        let coefficients: Vec<[f32; 3]> = row.as_chunks::<3>().0.iter().map(|&rgb| opponent_from_rgb(rgb)).collect();
        for (coefficient, place) in places(bands) {
            (0..3).for_each(|i| row[place[i]] = coefficients[coefficient][i]);
        }
    }
    out
}

/// Each coefficient and the columns of its three numbers.
fn places(bands: &[usize]) -> impl Iterator<Item = (usize, [usize; 3])> + '_ {
    let firsts = bands.iter().scan(0, |first, count| {
        *first += count;
        Some(*first - count)
    });
    firsts.zip(bands).flat_map(|(first, &count)| {
        (0..count).map(move |i| (first + i, std::array::from_fn(|part| 3 * first + part * count + i)))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_band_has_its_brightness_first() {
        let rgb: Vec<f32> = (0..24).map(|i| (i as f32 * 0.7).sin()).collect();
        let coded = to_opponent(&rgb, &[1, 3]);
        // Two rows of four coefficients: of the first band one brightness, of the second three.
        for row in 0..2 {
            let opponent = |coefficient: usize| {
                let at = 12 * row + 3 * coefficient;
                opponent_from_rgb([rgb[at], rgb[at + 1], rgb[at + 2]])
            };
            let first: [f32; 3] = std::array::from_fn(|part| coded[12 * row + part]);
            assert_eq!(first, opponent(0));
            for i in 0..3 {
                let of_band: [f32; 3] = std::array::from_fn(|part| coded[12 * row + 3 + 3 * part + i]);
                assert_eq!(of_band, opponent(1 + i));
            }
        }
        assert!(to_opponent(&[], &[]).is_empty());
    }
}
