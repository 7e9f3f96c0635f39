//! Number formats of packed `.instgs` files: f16, and offsets in 8 bits (q8). The format `small` is in [`crate::small`].
//!
//! q8: the offset records are cut into *segments* wherever the run of an instance begins or ends (`segments`); in a
//! usual scene a segment is an instance, and shared, overlapping and unused records need no special case. Row r of
//! `offset.range` [segments, 7, 2] holds the lowest and highest value of segment r, per channel: position x, y, z, SH 0
//! red, green, blue, opacity logit. Byte q stands for `(low (255 - q) + high q) / 255`.
//!
//! Ranges that contain 0 are widened by 1/254, so that 0 is one of the 256 values and stays exact. The error of a value
//! is at most half a step, 1/508 of the range. Ranges include outliers, which make the steps of their own instance and
//! channel coarser. In the tests, logits of hidden parts (-14 among values around 0) cause an error of at most 0.03,
//! less than 1/128 in opacity.

use std::collections::BTreeSet;
use std::ops::Range;

use half::f16;

use instgs_vk::scene::instanced_scene::{ForeignTensor, Instance, SourceRange};

/// How the values of an `.instgs` file are stored. Transforms are F32 in all formats, template and background means in
/// all but `Small`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Pack {
    /// All values in F32: lossless to the bit.
    #[default]
    F32,
    /// Other values in F16: 124 bytes per template Gaussian of SH degree 3, 14 per offset record.
    F16,
    /// Like `F16`, but offsets in 8 bits with a range per instance: 7 bytes per record.
    Q8,
    /// All clouds and the offsets in steps, entropy coded ([`crate::small`]): about 25 bytes per Gaussian of SH degree 3. The
    /// background and own Gaussians are reordered where nothing depends on their order. Older readers reject the file.
    Small,
}

/// Number of channels of an offset record that q8 packs.
pub(crate) const CHANNELS: usize = 7;

/// The effect of f16 underflow on a tensor.
#[derive(Clone, Copy)]
pub(crate) enum Underflow {
    /// Invisible: logits, logarithms and SH may be off by 3e-8.
    Harmless,
    /// Harmful: in rows of this many values, the largest of each row must keep its 11 bits, unless all are 0.
    Rows(usize),
}

/// Values as F16 if they fit, otherwise as F32: values that are not finite or beyond 65504 do not fit, nor do small
/// ones if `underflow` says that they matter.
pub(crate) fn halves(shape: &[usize], values: &[f32], underflow: Underflow) -> ForeignTensor {
    let largest = |row: &[f32]| row.iter().fold(0.0, |m: f32, v| m.max(v.abs()));
    let keeps_bits = match underflow {
        Underflow::Harmless => true,
        Underflow::Rows(width) => {
            values.chunks(width.max(1)).map(largest).all(|m| m == 0.0 || m >= f16::MIN_POSITIVE.to_f32())
        }
    };
    if !(fits_half(values) && keeps_bits) {
        return floats(shape, values);
    }
    let bytes = values.iter().flat_map(|&v| f16::from_f32(v).to_le_bytes()).collect();
    ForeignTensor { dtype: "F16".into(), shape: shape.into(), bytes }
}

/// The values as an F32 tensor.
pub(crate) fn floats(shape: &[usize], values: &[f32]) -> ForeignTensor {
    let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    ForeignTensor { dtype: "F32".into(), shape: shape.into(), bytes }
}

/// True if all values are finite and within the range of F16.
pub(crate) fn fits_half(values: &[f32]) -> bool {
    values.iter().all(|v| v.abs() <= f16::MAX.to_f32())
}

/// The records `0..count`, cut where a run of an instance begins or ends, in order. Runs may still be invalid.
pub fn segments(instances: &[Instance], templates: &[SourceRange], count: usize) -> Vec<Range<usize>> {
    let mut cuts = BTreeSet::from([0, count]);
    for instance in instances {
        if let (Some(first), Some(range)) = (instance.first_offset, templates.get(instance.template as usize)) {
            let (first, len) = (first as usize, range.count as usize);
            cuts.extend([first, first.saturating_add(len)].map(|cut| cut.min(count)));
        }
    }
    let cuts: Vec<usize> = cuts.into_iter().collect();
    cuts.windows(2).map(|w| w[0]..w[1]).collect()
}

/// Ranges of all channels of all segments, for q8.
pub(crate) struct OffsetRanges {
    segments: Vec<Range<usize>>,
    /// Lowest and highest value by segment and channel.
    ranges: Vec<[[f32; 2]; CHANNELS]>,
}

impl OffsetRanges {
    /// Ranges of segments before any tensor is packed.
    pub(crate) fn empty(segments: Vec<Range<usize>>) -> Self {
        Self { ranges: vec![[[0.0; 2]; CHANNELS]; segments.len()], segments }
    }

    /// Ranges as stored in a file: `segments.len() * 7 * 2` values.
    pub(crate) fn from_values(segments: Vec<Range<usize>>, values: &[f32]) -> Self {
        Self { segments, ranges: values.as_chunks::<2>().0.as_chunks::<CHANNELS>().0.to_vec() }
    }

    /// The ranges as the tensor `offset.range`.
    pub(crate) fn tensor(&self) -> ForeignTensor {
        floats(&[self.ranges.len(), CHANNELS, 2], self.ranges.as_flattened().as_flattened())
    }

    /// Packs finite values, `width` per record, as channels `first..first + width` and sets their ranges.
    pub(crate) fn pack(&mut self, values: &[f32], width: usize, first: usize) -> Vec<u8> {
        let mut out = vec![0; values.len()];
        for (segment, ranges) in self.segments.iter().zip(&mut self.ranges) {
            for c in 0..width {
                let places = segment.clone().map(|i| i * width + c);
                ranges[first + c] = range_of(places.clone().map(|at| values[at]));
                places.for_each(|at| out[at] = byte_of(values[at], ranges[first + c]));
            }
        }
        out
    }

    /// Unpacks rows of `width` bytes, one per record, as channels `first..first + width`.
    pub(crate) fn unpack(&self, bytes: &[u8], width: usize, first: usize) -> Vec<f32> {
        let mut out = Vec::with_capacity(bytes.len());
        for (segment, ranges) in self.segments.iter().zip(&self.ranges) {
            let values = bytes[segment.start * width..segment.end * width].chunks_exact(width);
            out.extend(values.flat_map(|row| row.iter().zip(&ranges[first..]).map(|(&q, &range)| value_of(q, range))));
        }
        out
    }
}

/// The range of finite values, widened so that 0 is a level if it lies within.
fn range_of(values: impl Iterator<Item = f32> + Clone) -> [f32; 2] {
    let low = values.clone().fold(f32::INFINITY, f32::min);
    let high = values.fold(f32::NEG_INFINITY, f32::max);
    if !(low <= 0.0 && high >= 0.0 && low < high) {
        return [low, high];
    }
    // With 254 steps between low and high, rounding both ends up to whole steps from 0 needs at most 255. The step
    // keeps 16 bits, rounded up: multiplied by an 8-bit level it is exact in f32, so 0 is restored exactly.
    let step = ((f64::from(high) - f64::from(low)) / 254.0).max(f64::from(f32::MIN_POSITIVE));
    let unit = (step.log2().floor() - 15.0).exp2();
    let step = (step / unit).ceil() * unit;
    let zero = (-f64::from(low) / step).ceil();
    [(-zero * step) as f32, ((255.0 - zero) * step) as f32]
}

fn byte_of(value: f32, [low, high]: [f32; 2]) -> u8 {
    let (value, low, high) = (f64::from(value), f64::from(low), f64::from(high));
    // The cast saturates, and maps the NaN of an empty range to 0, which stands for its only value.
    ((value - low) / (high - low) * 255.0).round() as u8
}

fn value_of(q: u8, [low, high]: [f32; 2]) -> f32 {
    let q = f64::from(q);
    ((f64::from(low) * (255.0 - q) + f64::from(high) * q) / 255.0) as f32
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;
    use instgs_vk::math::similarity::Similarity;

    /// One channel of one segment after packing and unpacking.
    fn packed(values: &[f32]) -> Vec<f32> {
        let mut ranges = OffsetRanges::empty(std::iter::once(0..values.len()).collect());
        let bytes = ranges.pack(values, 1, 6);
        ranges.unpack(&bytes, 1, 6)
    }

    fn largest_error(values: &[f32]) -> f32 {
        packed(values).iter().zip(values).fold(0.0, |m: f32, (a, b)| m.max((a - b).abs()))
    }

    #[test]
    fn zero_and_constants_stay_and_errors_are_half_a_step() {
        let mut rng = Rng::new(3);
        for round in 0..400 {
            let scale = 10.0f64.powi(round % 9 - 6);
            let shift = if round % 3 == 0 { 3.0 } else { 0.2 } * scale;
            let mut values: Vec<f32> = (0..50).map(|_| (shift + scale * rng.normal()) as f32).collect();
            values[7] = 0.0;
            let (low, high) = values.iter().fold((0.0f32, 0.0f32), |(l, h), &v| (l.min(v), h.max(v)));
            let back = packed(&values);
            assert_eq!(back[7].to_bits(), 0.0f32.to_bits(), "{low} {high}");
            // The bound 1/508, plus the rounding of the step.
            assert!(largest_error(&values) <= (high - low) / 507.0, "{low} {high}");
        }
        for values in [[0.0; 3], [-7.3; 3], [1e-30; 3], [65504.0; 3]] {
            assert_eq!(packed(&values), values);
        }
        // If 0 is outside the range, the ends are exact to the bit.
        assert_eq!(packed(&[5.1, 5.3, 5.1])[..2], [5.1, 5.3]);
        assert!(packed(&[]).is_empty());
    }

    #[test]
    fn hidden_parts_cost_what_is_documented() {
        let mut rng = Rng::new(1);
        let usual: Vec<f32> = (0..1000).map(|_| 0.3 * rng.normal() as f32).collect();
        let hidden: Vec<f32> = usual.iter().enumerate().map(|(i, &v)| if i % 20 == 0 { -14.0 } else { v }).collect();
        // Measured: 0.004 without and 0.030 with outliers. A logit error e changes an opacity by e / 4 at most.
        assert!(largest_error(&usual) < 0.005, "{}", largest_error(&usual));
        assert!((0.01..0.031).contains(&largest_error(&hidden)), "{}", largest_error(&hidden));
    }

    #[test]
    fn segments_are_cut_where_runs_begin_and_end() {
        let instance = |template, first_offset| Instance {
            template,
            world_from_template: Similarity::IDENTITY,
            first_offset: Some(first_offset),
        };
        let templates = [SourceRange { first: 0, count: 3 }, SourceRange { first: 3, count: 2 }];
        // The same run twice, an overlapping one, and the unused records 6..9.
        let runs = [instance(0, 0), instance(0, 0), instance(0, 3), instance(1, 2)];
        assert_eq!(segments(&runs, &templates, 9), [0..2, 2..3, 3..4, 4..6, 6..9]);
        assert_eq!(segments(&[], &templates, 4).len(), 1);
        assert!(segments(&runs, &templates, 0).is_empty());
        // Invalid instances: a template that does not exist, and a run beyond the end.
        assert_eq!(segments(&[instance(9, 1), instance(0, u32::MAX - 1)], &templates, 4).len(), 1);
    }

    #[test]
    fn halves_only_where_they_hold_the_values() {
        let dtype = |values: &[f32], underflow| halves(&[values.len()], values, underflow).dtype;
        for fits in [[0.0, 65504.0, -65504.0], [1e-9, 1.0, -14.0]] {
            assert_eq!(dtype(&fits, Underflow::Harmless), "F16");
        }
        for lost in [65505.0, f32::NAN, f32::NEG_INFINITY] {
            assert_eq!(dtype(&[1.0, lost], Underflow::Harmless), "F32");
        }
        for (row, want) in [([0.0; 4], "F16"), ([1e-9, 0.0, 0.5, 0.0], "F16"), ([1e-5; 4], "F32")] {
            let values = [[1.0; 4], row].concat();
            assert_eq!(dtype(&values, Underflow::Rows(4)), want, "{row:?}");
        }
    }
}
