//! Colours for a quantity: the scale of the views of load and of offsets, as `glsl/include/show.glsl` has it.

/// Heat colours from 0 to 1: black, violet, red, orange, pale yellow. Ever lighter, so that they can be read as grey too.
/// Parts outside of 0..=1 count as the nearer end.
pub fn heat(part: f64) -> [f64; 3] {
    const STOPS: [[f64; 3]; 5] =
        [[0.0; 3], [0.34, 0.06, 0.47], [0.80, 0.22, 0.26], [0.98, 0.62, 0.11], [1.0, 1.0, 0.8]];
    let place = part.clamp(0.0, 1.0) * 4.0;
    let below = (place as usize).min(3);
    let (low, high, part) = (STOPS[below], STOPS[below + 1], place - below as f64);
    std::array::from_fn(|c| low[c] + (high[c] - low[c]) * part)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Lightness as CIE 1976 has it, of sRGB values.
    #[test]
    fn heat_grows_ever_lighter_in_even_steps() {
        let linear = |v: f64| if v <= 0.04045 { v / 12.92 } else { ((v + 0.055) / 1.055).powf(2.4) };
        let lightness = |k: u32| {
            let [r, g, b] = heat(f64::from(k) / 256.0).map(linear);
            let y = 0.2126 * r + 0.7152 * g + 0.0722 * b;
            if y > 0.008856 { 116.0 * y.cbrt() - 16.0 } else { 903.3 * y }
        };
        let all: Vec<f64> = (0..=256).map(lightness).collect();
        let steps: Vec<f64> = all.windows(2).map(|pair| pair[1] - pair[0]).collect();
        assert!(steps.iter().all(|step| (0.1..1.0).contains(step)), "{steps:?}");
        assert!(all[0] == 0.0 && all[256] > 97.0);
        assert_eq!((heat(-1.0), heat(7.0)), (heat(0.0), heat(1.0)));
    }
}
