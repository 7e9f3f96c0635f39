//! A scene in fewer bytes, as the device holds it for drawing: f16 instead of f32 for everything but means and colour
//! matrices, rotations in 48 bits, offsets in f16 or in 8 bits. Kernel `preprocess_instance_expand_packed` reads it.
//!
//! Numbers of 16 bits stand in rows without padding, two in a word, the first one in its lower half. [`PackedScene::unpacked`]
//! gives the scene that the device sees: its picture is that of the packed one.

use half::f16;
use rayon::prelude::*;

use crate::gpu::interface::constants::{CODED_CHANNELS, RECORDS_PER_RANGE};
use crate::math::smallest_three::{normal_scale, smallest_three};
use crate::scene::offset_runs::{OffsetRun, sources_of_records};
use crate::scene::parameters::Rows;
use crate::scene::{DevicePrecision, InstancedScene, Parameter, ParameterSet};

/// Why a scene cannot be packed.
#[derive(Debug, thiserror::Error, PartialEq, Eq)]
pub enum PackError {
    /// Offsets of quaternions follow the length of their template's quaternion, of which there must be one.
    #[error("instances of different templates share offset records, so their rotations cannot be packed")]
    SharedRecords,
    /// Codes of 8 bits have no place for these.
    #[error("offset record {0} is not finite, so it has no code of 8 bits")]
    NotFinite(usize),
}

/// The packed arrays of a scene. Words hold two numbers of 16 bits, or four of 8; the unused rest of a last word is 0.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PackedScene {
    /// By source Gaussian, two words: log standard deviations and opacity logit in f16.
    pub shapes: Vec<u32>,
    /// By source Gaussian, a rotation as three codes of 16 bits.
    pub quats: Vec<u32>,
    /// By band, three f16 for every coefficient of the source Gaussians that have it.
    pub sh: [Vec<u32>; 4],
    /// By offset record, the arrays of [`PackedOffsets`].
    pub offsets: PackedOffsets,
    /// By offset record and coefficient above 0, three f16, if there are any.
    pub offset_sh_rest: Vec<u32>,
    /// By [`RECORDS_PER_RANGE`] offset records, the lower limits of the codes of all channels, then their steps. Channels are
    /// mean, logit, SH coefficient 0, log scales, quaternion. Only with codes.
    pub offset_ranges: Vec<f32>,
}

/// Words of offset records, in this order: mean and opacity logit; SH coefficient 0; log standard deviations; the quaternion
/// for the unit quaternion that is stored. Each is three or four f16, or one word of three or four codes. The last two are
/// empty without such offsets.
pub type PackedOffsets = [Vec<u32>; 4];

/// Number of channels of an offset record that have codes.
const CHANNELS: usize = CODED_CHANNELS as usize;
/// Offset records whose codes have the same limits.
const PER_RANGE: usize = RECORDS_PER_RANGE as usize;
/// Code of 15 bits that stands for 0, and the number of steps up to sqrt(1/2), the most that a component besides the largest
/// can be.
const ZERO_CODE: f32 = 16384.0;
const QUAT_STEPS: f32 = 16383.0;

/// Where the numbers of an array of offsets go.
struct Channels {
    parameter: Parameter,
    /// The first of its channels, and how many it has.
    first: usize,
    width: usize,
    /// The array of [`PackedOffsets`], and the first of its numbers in a record there.
    array: usize,
    place: usize,
}

const fn channels(parameter: Parameter, [first, width]: [usize; 2], [array, place]: [usize; 2]) -> Channels {
    Channels { parameter, first, width, array, place }
}

/// The arrays of offsets that can have codes.
const CODED: [Channels; 5] = [
    channels(Parameter::OffsetMeans, [0, 3], [0, 0]),
    channels(Parameter::OffsetOpacityLogits, [3, 1], [0, 3]),
    channels(Parameter::OffsetShDc, [4, 3], [1, 0]),
    channels(Parameter::OffsetLogScales, [7, 3], [2, 0]),
    channels(Parameter::OffsetQuats, [10, 4], [3, 0]),
];

/// The bands of SH.
const BANDS: [Parameter; 4] = [Parameter::Sh0, Parameter::Sh1, Parameter::Sh2, Parameter::Sh3];

impl PackedScene {
    /// Bytes of all arrays.
    pub fn bytes(&self) -> u64 {
        let words = [&self.shapes, &self.quats, &self.offset_sh_rest].into_iter().chain(&self.sh).chain(&self.offsets);
        let words: usize = words.map(Vec::len).sum();
        4 * (words + self.offset_ranges.len()) as u64
    }

    /// Packs the clouds and offsets of a scene for a precision below f32; `runs` say which Gaussian an offset record belongs
    /// to. Finite numbers beyond f16 become its largest.
    ///
    /// # Errors
    /// See [`PackError`].
    pub fn new(scene: &InstancedScene, runs: &[OffsetRun], precision: DevicePrecision) -> Result<Self, PackError> {
        let of = |parameter: Parameter| scene.parameter(parameter);
        let offsets = offset_arrays(scene, runs)?;
        let mut out = Self {
            shapes: halves(&side_by_side((&of(Parameter::LogScales), 3), (&of(Parameter::OpacityLogits), 1))),
            quats: words(&of(Parameter::Quats).as_chunks().0.par_iter().flat_map_iter(quat_codes).collect::<Vec<_>>()),
            sh: BANDS.map(|band| halves(&of(band))),
            offset_sh_rest: halves(&of(Parameter::OffsetShRest)),
            ..Self::default()
        };
        if precision == DevicePrecision::Q8 {
            out.code_offsets(&offsets)?;
        } else {
            let [means, logits, sh_dc, log_scales, quats] = &offsets;
            out.offsets = [&side_by_side((means, 3), (logits, 1)), sh_dc, log_scales, quats].map(|v| halves(v));
        }
        Ok(out)
    }

    /// Writes offsets in 8 bits.
    fn code_offsets(&mut self, offsets: &[Vec<f32>; CODED.len()]) -> Result<(), PackError> {
        for (Channels { first, width, array, place, .. }, values) in CODED.into_iter().zip(offsets) {
            if let Some(i) = values.iter().position(|v| !v.is_finite()) {
                return Err(PackError::NotFinite(i / width));
            }
            let records = values.len() / width;
            let ranges = self.offset_ranges.len().max(2 * CHANNELS * records.div_ceil(PER_RANGE));
            self.offset_ranges.resize(ranges, 0.0);
            self.offsets[array].resize(records, 0);
            for (range, values) in values.chunks(PER_RANGE * width).enumerate() {
                for channel in 0..width {
                    let column = || values.iter().skip(channel).step_by(width);
                    let (low, step) = limits(column());
                    let at = 2 * CHANNELS * range + first + channel;
                    (self.offset_ranges[at], self.offset_ranges[at + CHANNELS]) = (low, step);
                    for (word, &value) in self.offsets[array][PER_RANGE * range..].iter_mut().zip(column()) {
                        *word |= code_of(value, low, step) << (8 * (place + channel));
                    }
                }
            }
        }
        Ok(())
    }

    /// The scene as the device sees it: `scene`, which was packed, with the numbers that are left of its own. The quaternions
    /// of a template have length 1, and its offsets go with that.
    pub fn unpacked(&self, scene: &InstancedScene) -> InstancedScene {
        let rows = scene.parameter_rows();
        let mut out = self.with_unpacked_shapes(scene);
        for (band, words) in BANDS.into_iter().zip(&self.sh) {
            out.set_parameter(band, rows[band], &from_halves(words, numbers(&rows, band)));
        }
        let rest = from_halves(&self.offset_sh_rest, numbers(&rows, Parameter::OffsetShRest));
        out.set_parameter(Parameter::OffsetShRest, rows[Parameter::OffsetShRest], &rest);
        out
    }

    /// The same, with the SH of `scene` as it is: bounds do not depend on colours, which are most of a scene's numbers.
    pub(super) fn with_unpacked_shapes(&self, scene: &InstancedScene) -> InstancedScene {
        let rows = scene.parameter_rows();
        let mut out = scene.clone();
        let mut set = |parameter: Parameter, values: &[f32]| out.set_parameter(parameter, rows[parameter], values);
        let [log_scales, logits] =
            apart(&from_halves(&self.shapes, 4 * numbers(&rows, Parameter::OpacityLogits)), 3, 4);
        set(Parameter::LogScales, &log_scales);
        set(Parameter::OpacityLogits, &logits);
        let codes: Vec<u16> = split(&self.quats).collect();
        let quats = codes.as_chunks().0.iter().take(rows[Parameter::Quats].iter().sum()).flat_map(quat_of);
        set(Parameter::Quats, &quats.collect::<Vec<f32>>());
        let offsets =
            if self.offset_ranges.is_empty() { self.offsets_of_halves(&rows) } else { self.decoded_offsets(&rows) };
        for (Channels { parameter, .. }, values) in CODED.into_iter().zip(&offsets) {
            set(parameter, values);
        }
        out
    }

    fn offsets_of_halves(&self, rows: &ParameterSet<Rows>) -> [Vec<f32>; CODED.len()] {
        let of = |array: usize, parameter| from_halves(&self.offsets[array], numbers(rows, parameter));
        let [means, logits] =
            apart(&from_halves(&self.offsets[0], 4 * numbers(rows, Parameter::OffsetOpacityLogits)), 3, 4);
        let (sh_dc, log_scales) = (of(1, Parameter::OffsetShDc), of(2, Parameter::OffsetLogScales));
        [means, logits, sh_dc, log_scales, of(3, Parameter::OffsetQuats)]
    }

    fn decoded_offsets(&self, rows: &ParameterSet<Rows>) -> [Vec<f32>; CODED.len()] {
        CODED.map(|Channels { parameter, first, width, array, place }| {
            let value = |i: usize| {
                let (record, channel) = (i / width, i % width);
                let code = (self.offsets[array][record] >> (8 * (place + channel))) & 0xff;
                let at = 2 * CHANNELS * (record / PER_RANGE) + first + channel;
                self.offset_ranges[at] + self.offset_ranges[at + CHANNELS] * code as f32
            };
            (0..numbers(rows, parameter)).map(value).collect()
        })
    }
}

/// Numbers of a parameter in all its rows.
fn numbers(rows: &ParameterSet<Rows>, parameter: Parameter) -> usize {
    rows[parameter].iter().sum::<usize>() * parameter.width()
}

/// The arrays of [`CODED`], with offsets of quaternions for the unit quaternions that are stored.
fn offset_arrays(scene: &InstancedScene, runs: &[OffsetRun]) -> Result<[Vec<f32>; CODED.len()], PackError> {
    let mut out = CODED.map(|Channels { parameter, .. }| scene.parameter(parameter).into_owned());
    let quats = &mut out[4];
    if !quats.is_empty() {
        let (sources, several) = sources_of_records(runs, scene.offsets.len());
        if several {
            return Err(PackError::SharedRecords);
        }
        for (quat, source) in quats.chunks_mut(4).zip(sources) {
            let scale = source.and_then(|source| normal_scale(&scene.templates.quats[source as usize]));
            quat.iter_mut().for_each(|v| *v = (f64::from(*v) * scale.unwrap_or(1.0)) as f32);
        }
    }
    Ok(out)
}

/// A rotation as three codes of 16 bits. Their lower 15 bits are the components besides the largest, which is positive, in
/// steps of sqrt(1/2) / 16383 around 16384; the upper bits of the first two are the index of the largest. A quaternion that is
/// zero or not finite gets codes of 0.
fn quat_codes(quat: &[f32; 4]) -> [u16; 3] {
    let Some((largest, others)) = smallest_three(quat) else { return [0; 3] };
    let codes = others.map(|v| (ZERO_CODE + (v / std::f32::consts::FRAC_1_SQRT_2 * QUAT_STEPS).round()) as u16);
    let largest = largest as u16;
    [codes[0] | (largest & 1) << 15, codes[1] | (largest >> 1) << 15, codes[2]]
}

/// The inverse of [`quat_codes`], as on the device; zero for codes of 0.
fn quat_of(codes: &[u16; 3]) -> [f32; 4] {
    let largest = usize::from(codes[0] >> 15 | (codes[1] >> 15) << 1);
    let codes = codes.map(|code| code & 0x7fff);
    if codes[0] == 0 {
        return [0.0; 4];
    }
    let others = codes.map(|code| (f32::from(code) - ZERO_CODE) * (std::f32::consts::FRAC_1_SQRT_2 / QUAT_STEPS));
    let squares: f32 = others.iter().map(|v| v * v).sum();
    let mut others = others.into_iter();
    let value = (1.0 - squares).max(0.25).sqrt();
    std::array::from_fn(|k| if k == largest { value } else { others.next().unwrap_or_default() })
}

/// Lower limit and step of 255 steps over finite values; a step of 0 if they are all the same.
fn limits<'a>(values: impl Iterator<Item = &'a f32>) -> (f32, f32) {
    let (low, high) = values.fold((f32::MAX, f32::MIN), |(low, high), &v| (low.min(v), high.max(v)));
    // Halves first: the difference of two finite numbers may not be finite.
    (low, (high / 255.0 - low / 255.0).max(0.0))
}

/// The nearest code of a value.
fn code_of(value: f32, low: f32, step: f32) -> u32 {
    if step > 0.0 { ((value - low) / step).round().clamp(0.0, 255.0) as u32 } else { 0 }
}

/// Rows of two arrays side by side; each comes with its width.
fn side_by_side(a: (&[f32], usize), b: (&[f32], usize)) -> Vec<f32> {
    a.0.chunks(a.1).zip(b.0.chunks(b.1)).flat_map(|(a, b)| a.iter().chain(b)).copied().collect()
}

/// The inverse of [`side_by_side`]: the first `first` numbers of every row of `width`, and the others.
fn apart(values: &[f32], first: usize, width: usize) -> [Vec<f32>; 2] {
    let rows = || values.chunks_exact(width);
    [rows().flat_map(|row| &row[..first]).copied().collect(), rows().flat_map(|row| &row[first..]).copied().collect()]
}

/// Numbers as f16; finite ones beyond its range become the largest it has.
fn halves(values: &[f32]) -> Vec<u32> {
    let largest = f16::MAX.to_f32();
    let bits = |&v: &f32| f16::from_f32(if v.is_finite() { v.clamp(-largest, largest) } else { v }).to_bits();
    words(&values.par_iter().map(bits).collect::<Vec<_>>())
}

/// The first `count` numbers of words of f16.
fn from_halves(words: &[u32], count: usize) -> Vec<f32> {
    split(words).take(count).map(|bits| f16::from_bits(bits).to_f32()).collect()
}

/// Two numbers in a word, the first one in its lower half.
fn words(numbers: &[u16]) -> Vec<u32> {
    let word = |pair: &[u16]| u32::from(pair[0]) | pair.get(1).map_or(0, |&upper| u32::from(upper) << 16);
    numbers.par_chunks(2).map(word).collect()
}

/// The inverse of [`words`], with the unused half of the last word.
fn split(words: &[u32]) -> impl Iterator<Item = u16> {
    words.iter().flat_map(|&word| [word as u16, (word >> 16) as u16])
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;
    use crate::math::similarity::Similarity;
    use crate::scene::{Gaussians, Instance, SourceRange};

    /// Two instances of a template with offsets of all kinds, 300 Gaussians, and a background of another degree.
    fn scene(seed: u64) -> InstancedScene {
        let mut rng = Rng::new(seed);
        let mut out = InstancedScene::default();
        let cloud =
            |degree, count| Gaussians { sh_degree: degree, means: vec![[0.5; 3]; count], ..Gaussians::default() };
        (out.templates, out.background) = (cloud(2, 300), cloud(3, 7));
        out.template_ranges = vec![SourceRange { first: 0, count: 300 }];
        let instance = |first_offset| Instance {
            template: 0,
            world_from_template: Similarity::IDENTITY,
            first_offset: Some(first_offset),
        };
        out.instances = vec![instance(0), instance(300)];
        out.offsets.means = vec![[0.0; 3]; 600];
        let clouds = [&out.templates, &out.background].map(crate::scene::source_layout::CloudSize::of);
        for parameter in Parameter::ALL {
            let rest = if parameter == Parameter::OffsetShRest { 8 } else { 1 };
            let of_offsets = if parameter == Parameter::ColorFromTemplate { [0, 0] } else { [600 * rest, 0] };
            let rows = parameter.source_rows(clouds).unwrap_or(of_offsets);
            let values: Vec<f32> = (0..numbers_of(rows, parameter)).map(|_| rng.normal() as f32).collect();
            out.set_parameter(parameter, rows, &values);
        }
        out
    }

    fn numbers_of(rows: Rows, parameter: Parameter) -> usize {
        rows.iter().sum::<usize>() * parameter.width()
    }

    fn packed(scene: &InstancedScene, precision: DevicePrecision) -> PackedScene {
        PackedScene::new(scene, &scene.offset_runs(), precision).unwrap()
    }

    /// The largest difference of a parameter, between -inf and inf.
    fn difference(a: &InstancedScene, b: &InstancedScene, parameter: Parameter) -> f32 {
        let (a, b) = (a.parameter(parameter), b.parameter(parameter));
        assert_eq!(a.len(), b.len(), "{parameter:?}");
        a.iter().zip(b.iter()).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    }

    #[test]
    fn numbers_are_what_their_bits_allow() {
        let scene = scene(1);
        for precision in [DevicePrecision::F16, DevicePrecision::Q8] {
            let seen = packed(&scene, precision).unpacked(&scene);
            seen.validate().unwrap();
            for parameter in Parameter::ALL {
                let rotation = matches!(parameter, Parameter::Quats | Parameter::OffsetQuats);
                let coded = precision == DevicePrecision::Q8 && CODED.iter().any(|c| c.parameter == parameter);
                // Normal numbers below 4: half of the last of 11 bits, or half of 255 steps over at most 9.
                let allowed = if coded { 9.0 / 510.0 } else { 4.0 / 4096.0 };
                let off = difference(&scene, &seen, parameter);
                assert!(rotation || off <= allowed, "{precision:?} {parameter:?}: {off}");
                assert!(off > 0.0 || stays(parameter), "{parameter:?} is not rounded");
            }
        }
    }

    fn stays(parameter: Parameter) -> bool {
        matches!(parameter, Parameter::Means | Parameter::ColorFromTemplate)
    }

    /// Sums of template and offset stay the same rotations, although templates get length 1 and offsets follow.
    #[test]
    fn rotations_of_instances_stay() {
        let scene = scene(2);
        let seen = packed(&scene, DevicePrecision::F16).unpacked(&scene);
        let rotation = |scene: &InstancedScene, record: usize| {
            let (quat, offset) = (scene.templates.quats[record % 300], scene.offsets.quats[record]);
            let sum: [f64; 4] = std::array::from_fn(|k| f64::from(quat[k]) + f64::from(offset[k]));
            let length = sum.iter().map(|v| v * v).sum::<f64>().sqrt();
            (sum.map(|v| v / length), length / normal_scale(&quat).unwrap().abs().recip())
        };
        for record in 0..600 {
            let ((a, length), (b, _)) = (rotation(&scene, record), rotation(&seen, record));
            let cosine = a.iter().zip(&b).map(|(a, b)| a * b).sum::<f64>().abs();
            // The rounding of an offset weighs more where the sum is short.
            assert!((1.0 - cosine).sqrt() * length < 2e-3, "record {record}: {cosine}");
        }
    }

    #[test]
    fn quaternions_keep_fifteen_bits() {
        let mut rng = Rng::new(3);
        for k in 0..10_000 {
            let quat: [f32; 4] = std::array::from_fn(|_| rng.normal() as f32);
            let scale = normal_scale(&quat).unwrap();
            let back = quat_of(&quat_codes(&quat));
            for (q, back) in quat.iter().zip(back) {
                let off = (f64::from(*q) * scale - f64::from(back)).abs();
                // Half a step for three, and up to three times as much for the largest.
                assert!(off < 1.5 * std::f64::consts::FRAC_1_SQRT_2 / 16383.0, "{k}: {quat:?} {back:?}");
            }
        }
        let axes: [[f32; 4]; 4] = std::array::from_fn(|k| std::array::from_fn(|i| if i == k { -2.0 } else { 0.0 }));
        for axis in axes {
            assert_eq!(quat_of(&quat_codes(&axis)), axis.map(|v| -0.5 * v + 0.0));
        }
        for none in [[0.0; 4], [f32::NAN, 1.0, 0.0, 0.0], [f32::INFINITY, 1.0, 0.0, 0.0]] {
            assert_eq!(quat_of(&quat_codes(&none)), [0.0; 4]);
        }
    }

    #[test]
    fn numbers_beyond_f16_become_its_largest_and_poison_stays() {
        let values = [1e6, -1e30, f32::INFINITY, f32::NEG_INFINITY, f32::NAN, 1e-30, -0.0];
        let back = from_halves(&halves(&values), 7);
        assert_eq!(back[..4], [65504.0, -65504.0, f32::INFINITY, f32::NEG_INFINITY]);
        assert!(back[4].is_nan() && back[5] == 0.0 && back[6] == 0.0);
    }

    #[test]
    fn what_cannot_be_packed_is_said() {
        let mut scene = scene(4);
        let runs = |first_source| vec![OffsetRun { first_source, first_offset: 0, count: 10 }];
        let several = [runs(0), runs(1)].concat();
        let shared = PackedScene::new(&scene, &several, DevicePrecision::F16);
        assert_eq!(shared, Err(PackError::SharedRecords));
        scene.offsets.sh_dc[417][1] = f32::NAN;
        let finite = PackedScene::new(&scene, &scene.offset_runs(), DevicePrecision::Q8);
        assert_eq!(finite, Err(PackError::NotFinite(417)));
        packed(&scene, DevicePrecision::F16);
    }

    #[test]
    fn equal_offsets_and_the_widest_ones_have_codes() {
        assert_eq!(limits([2.5f32, 2.5].iter()), (2.5, 0.0));
        assert_eq!(code_of(2.5, 2.5, 0.0), 0);
        let (low, step) = limits([f32::MAX, f32::MIN].iter());
        assert!(step.is_finite() && code_of(f32::MAX, low, step) == 255 && code_of(f32::MIN, low, step) == 0);
    }
}
