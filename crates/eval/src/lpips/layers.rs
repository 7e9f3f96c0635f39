//! The three operations of the feature extractors. Feature maps are stored pixel by pixel with the channels innermost:
//! a convolution then copies whole runs of an input row, its output is the matrix product as computed, and the two
//! halves of a fire module are written side by side.

use rayon::prelude::*;

/// Upper limit on floats of the copied windows that one thread multiplies at a time: 1 MiB, so that they stay in its
/// cache.
const BAND_FLOATS: usize = 1 << 18;

/// Features of a picture, laid out as `values[(y * width + x) * channels + c]`.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct FeatureMap {
    /// Number of positions along x.
    pub(super) width: usize,
    /// Number of positions along y.
    pub(super) height: usize,
    /// Number of values per position.
    pub(super) channels: usize,
    /// All values: height * width * channels.
    pub(super) values: Vec<f32>,
}

impl FeatureMap {
    fn zeros(width: usize, height: usize, channels: usize) -> Self {
        Self { width, height, channels, values: vec![0.0; width * height * channels] }
    }
}

/// The windows of a convolution or pooling: `size` pixels wide, `stride` apart, the first `padding` pixels before the
/// picture.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Window {
    pub(super) size: usize,
    pub(super) stride: usize,
    pub(super) padding: usize,
    /// Whether windows that begin within the picture but reach beyond it count too.
    pub(super) ceil: bool,
}

impl Window {
    /// Number of windows along a line of `len` pixels by torch's rule; 0 if the line is too short.
    pub(super) fn places(&self, len: usize) -> usize {
        let round_up = if self.ceil { self.stride - 1 } else { 0 };
        let Some(room) = (len + 2 * self.padding + round_up).checked_sub(self.size) else { return 0 };
        let places = room / self.stride + 1;
        // With `ceil`, a window that would begin beyond the padded picture does not count.
        if self.ceil && (places - 1) * self.stride >= len + self.padding { places - 1 } else { places }
    }
}

/// A convolution with bias, and the ReLU that follows each one in these networks.
#[derive(Clone, Debug)]
pub(super) struct Convolution {
    pub(super) window: Window,
    pub(super) inputs: usize,
    pub(super) outputs: usize,
    /// Weights, `[row of the window][column][input][output]`.
    pub(super) weights: Vec<f32>,
    /// One bias per output channel.
    pub(super) bias: Vec<f32>,
}

impl Convolution {
    /// Converts weights in torch's order `[output][input][row][column]`.
    pub(super) fn new(window: Window, inputs: usize, torch_weights: &[f32], bias: Vec<f32>) -> Self {
        let (outputs, area) = (bias.len(), window.size * window.size);
        let mut weights = vec![0.0; torch_weights.len()];
        for (o, of_output) in torch_weights.chunks_exact(inputs * area).enumerate() {
            for (i, of_input) in of_output.chunks_exact(area).enumerate() {
                for (place, &weight) in of_input.iter().enumerate() {
                    weights[(place * inputs + i) * outputs + o] = weight;
                }
            }
        }
        Self { window, inputs, outputs, weights, bias }
    }

    /// Computes `max(0, convolution + bias)`.
    pub(super) fn apply(&self, input: &FeatureMap) -> FeatureMap {
        side_by_side(&[self], input)
    }

    /// Copies the windows of output row `y` to `matrix`, one per row, with zeros outside the picture.
    fn copy_windows(&self, input: &FeatureMap, y: usize, places: usize, matrix: &mut Vec<f32>) {
        let Window { size, stride, padding, .. } = self.window;
        let channels = input.channels;
        for x in 0..places {
            // Columns count from the left padding; `from..to` is the part of the window within the picture.
            let first = x * stride;
            let (from, to) = (first.max(padding), (first + size).min(input.width + padding));
            for row in y * stride..y * stride + size {
                let start = matrix.len();
                matrix.resize(start + size * channels, 0.0);
                if from < to && (padding..input.height + padding).contains(&row) {
                    let source = ((row - padding) * input.width + from - padding) * channels;
                    let len = (to - from) * channels;
                    let target = start + (from - first) * channels;
                    matrix[target..target + len].copy_from_slice(&input.values[source..source + len]);
                }
            }
        }
    }
}

/// Convolutions of the same input with the same window grid; their outputs are concatenated along the channels.
pub(super) fn side_by_side(convolutions: &[&Convolution], input: &FeatureMap) -> FeatureMap {
    let window = convolutions[0].window;
    let (width, height) = (window.places(input.width), window.places(input.height));
    let channels: usize = convolutions.iter().map(|c| c.outputs).sum();
    let mut out = FeatureMap::zeros(width, height, channels);
    let depth = convolutions.iter().map(|c| c.window.size * c.window.size * c.inputs).max().unwrap_or(1);
    let band_rows = (BAND_FLOATS / (depth * width).max(1)).max(1);
    out.values.par_chunks_mut((band_rows * width * channels).max(1)).enumerate().for_each_init(
        Vec::new,
        |matrix, (band, out)| {
            let rows = band * band_rows..band * band_rows + out.len() / (width * channels);
            let mut first_channel = 0;
            for convolution in convolutions {
                matrix.clear();
                rows.clone().for_each(|y| convolution.copy_windows(input, y, width, matrix));
                multiply(convolution, matrix, out, channels, first_channel);
                first_channel += convolution.outputs;
            }
        },
    );
    out
}

/// Writes `max(0, matrix * weights + bias)` to channels `first_channel..` of the rows of `out`, `channels` wide.
fn multiply(convolution: &Convolution, matrix: &[f32], out: &mut [f32], channels: usize, first_channel: usize) {
    let outputs = convolution.outputs;
    let depth = convolution.weights.len() / outputs;
    let rows = matrix.len() / depth;
    let own = first_channel..first_channel + outputs;
    assert!(own.end <= channels && out.len() == rows * channels && matrix.len() == rows * depth);
    out.chunks_exact_mut(channels).for_each(|row| row[own.clone()].copy_from_slice(&convolution.bias));
    // SAFETY: by the assertion, the row-major matrices `out` (rows x outputs, its rows `channels` apart, from
    // `first_channel`), `matrix` (rows x depth) and `weights` (depth x outputs) lie within their slices; only `out` is
    // written.
    unsafe {
        matrixmultiply::sgemm(
            rows,
            depth,
            outputs,
            1.0,
            matrix.as_ptr(),
            depth as isize,
            1,
            convolution.weights.as_ptr(),
            outputs as isize,
            1,
            1.0,
            out.as_mut_ptr().add(first_channel),
            channels as isize,
            1,
        );
    }
    out.chunks_exact_mut(channels).for_each(|row| row[own.clone()].iter_mut().for_each(|v| *v = v.max(0.0)));
}

/// The largest value of each channel in each window.
pub(super) fn max_pool(window: Window, input: &FeatureMap) -> FeatureMap {
    let channels = input.channels;
    let mut out = FeatureMap::zeros(window.places(input.width), window.places(input.height), channels);
    let row_len = (out.width * channels).max(1);
    out.values.par_chunks_mut(row_len).enumerate().for_each(|(y, out_row)| {
        out_row.fill(f32::NEG_INFINITY);
        for (x, best) in out_row.chunks_exact_mut(channels).enumerate() {
            for row in y * window.stride..(y * window.stride + window.size).min(input.height) {
                for column in x * window.stride..(x * window.stride + window.size).min(input.width) {
                    let start = (row * input.width + column) * channels;
                    let values = &input.values[start..start + channels];
                    best.iter_mut().zip(values).for_each(|(b, &v)| *b = b.max(v));
                }
            }
        }
    });
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;

    fn noise(rng: &mut Rng, len: usize) -> Vec<f32> {
        (0..len).map(|_| rng.range(-1.0, 1.0) as f32).collect()
    }

    /// One output value by the definition, in f64, from torch's order of weights.
    fn direct(input: &FeatureMap, torch: &[f32], bias: f32, window: Window, [x, y, o]: [usize; 3]) -> f64 {
        let mut sum = f64::from(bias);
        for (row, column) in (0..window.size).flat_map(|r| (0..window.size).map(move |c| (r, c))) {
            let (Some(iy), Some(ix)) = (
                (y * window.stride + row).checked_sub(window.padding).filter(|&v| v < input.height),
                (x * window.stride + column).checked_sub(window.padding).filter(|&v| v < input.width),
            ) else {
                continue;
            };
            for i in 0..input.channels {
                let weight = torch[((o * input.channels + i) * window.size + row) * window.size + column];
                sum += f64::from(weight) * f64::from(input.values[(iy * input.width + ix) * input.channels + i]);
            }
        }
        sum.max(0.0)
    }

    #[test]
    fn convolutions_agree_with_the_definition() {
        let mut rng = Rng::new(5);
        let window = |size, stride, padding| Window { size, stride, padding, ceil: false };
        for (window, width, height) in
            [(window(11, 4, 2), 31, 40), (window(3, 1, 1), 1, 1), (window(3, 1, 1), 17, 9), (window(3, 2, 0), 8, 7)]
        {
            let (inputs, outputs, other) = (3, 5, 2);
            let input =
                FeatureMap { width, height, channels: inputs, values: noise(&mut rng, width * height * inputs) };
            let torch = noise(&mut rng, (outputs + other) * inputs * window.size * window.size);
            let bias = noise(&mut rng, outputs + other);
            let split = outputs * inputs * window.size * window.size;
            let first = Convolution::new(window, inputs, &torch[..split], bias[..outputs].to_vec());
            let second = Convolution::new(window, inputs, &torch[split..], bias[outputs..].to_vec());
            let out = side_by_side(&[&first, &second], &input);
            assert_eq!(out.channels, 7);
            for (at, &value) in out.values.iter().enumerate() {
                let place = [at / 7 % out.width, at / 7 / out.width, at % 7];
                let want = direct(&input, &torch, bias[place[2]], window, place);
                // Measured: 2e-6, for sums of up to 363 products.
                assert!((f64::from(value) - want).abs() < 2e-5, "{window:?} {place:?}: {value} {want}");
            }
            assert_eq!(first.apply(&input).channels, 5);
        }
    }

    #[test]
    fn bands_do_not_show() {
        let mut rng = Rng::new(6);
        let window = Window { size: 3, stride: 1, padding: 1, ceil: false };
        // 9 * 16 * 100 floats a row of windows: bands of 18 rows.
        let input = FeatureMap { width: 100, height: 40, channels: 16, values: noise(&mut rng, 64_000) };
        let (torch, bias) = (noise(&mut rng, 4 * 9 * 16), noise(&mut rng, 4));
        let out = Convolution::new(window, 16, &torch, bias.clone()).apply(&input);
        for y in [0, 17, 18, 19, 36, 39] {
            let want = direct(&input, &torch, bias[1], window, [50, y, 1]);
            assert!((f64::from(out.values[(y * 100 + 50) * 4 + 1]) - want).abs() < 2e-5, "row {y}");
        }
    }

    #[test]
    fn max_pools_with_and_without_part_windows() {
        let line = FeatureMap { width: 6, height: 1, channels: 1, values: vec![1.0, -2.0, 0.5, -4.0, -3.0, 7.0] };
        let square = |ceil| Window { size: 3, stride: 2, padding: 0, ceil };
        assert_eq!([5, 6, 7, 8].map(|len| square(false).places(len)), [2, 2, 3, 3]);
        assert_eq!([5, 6, 7, 8].map(|len| square(true).places(len)), [2, 3, 3, 4]);
        assert_eq!([1, 2].map(|len| square(true).places(len)), [0, 1]);
        assert_eq!([2, 3].map(|len| square(false).places(len)), [0, 1]);
        // A window that would begin beyond the end does not count.
        assert_eq!(Window { size: 2, stride: 3, padding: 0, ceil: true }.places(3), 1);
        let tall = FeatureMap { width: 6, height: 3, channels: 1, values: line.values.repeat(3) };
        assert_eq!(max_pool(square(false), &tall).values, [1.0, 0.5]);
        assert_eq!(max_pool(square(true), &tall).values, [1.0, 0.5, 7.0]);
    }
}
