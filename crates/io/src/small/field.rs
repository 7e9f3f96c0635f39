//! A coded field: rows of values. Each is coded as the whole number of steps between it and a prediction.
//!
//! The columns form *parts* (an SH band, say), and a part has one step for all rows or one that doubles with the row's class
//! of precision. The bytes: rows u64, columns u16, parts u8, flags u8 ([`DELTA`], [`OPPONENT`]); for each part its columns u16,
//! step f32, most f32 and kind u8 (what its step follows, plus 16 times the quarters of its memory); the centre f32 of each
//! column; then the entropy-coded integers (`entropy.rs`). Value = prediction + integer * step. In a column's first row the
//! prediction is the centre. After each row it moves by the part's *memory*, from 0 to 1, of the way to the decoded value: with
//! 0 it stays the centre, with 1 it is the value of the row before. The encoder predicts from decoded values too: no error grows.

use super::entropy::{self, CONTEXTS, ColumnKind, Decoded, Layout, MOST_STEPS};
use crate::host_memory::available_bytes;
use crate::step_columns::TableError;
use instgs_vk::math::opponent::rgb_from_opponent;

/// Class of the middle: a step is `base * 2^(class - MIDDLE)`.
pub(super) const MIDDLE: u8 = (CONTEXTS / 2) as u8;
/// Flag of older files: the memory of all parts is 1.
const DELTA: u8 = 1;
/// Flag: the columns are colours (`opponent.rs`).
const OPPONENT: u8 = 2;
/// A memory is a number of quarters; this one is 1.
const QUARTERS: u8 = 4;
/// Quarters of the memories that the encoder tries.
const TRIED: [u8; 4] = [0, 1, 2, QUARTERS];
/// The last byte of a part is its kind plus this times the quarters of its memory.
const KINDS: u8 = 16;
/// Bytes of the fixed part of the header, and for each part.
const HEADER_BYTES: usize = 12;
const PART_BYTES: usize = 11;
/// A field has at most this many columns: 15 coefficients of SH in 3 colours are 45, with coefficient 0 48.
const MOST_COLUMNS: usize = 64;

/// What a part's step follows.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Follows {
    /// All rows have the same step.
    Nothing,
    /// The class of the row's shape: position, rotation, sizes.
    Shape,
    /// The class of the row's colour: opacity, SH.
    Colour,
}

/// Columns with one step, or one step per class.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Part {
    pub(super) columns: usize,
    /// The step of rows of the class `MIDDLE`, in units of the values.
    pub(super) step: f32,
    /// No row has a larger step, whatever its class.
    pub(super) most: f32,
    pub(super) follows: Follows,
    pub(super) memory: Memory,
}

/// How far the prediction moves towards the value of the row before.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Memory {
    /// Quarters of the difference, 0 to 4.
    Quarters(u8),
    /// What takes the fewest bits; for the encoder.
    Best,
}

impl Memory {
    /// The prediction is always the centre.
    pub(super) const NONE: Self = Self::Quarters(0);
    /// The prediction is the value of the row before: whole numbers stay whole.
    pub(super) const ALL: Self = Self::Quarters(QUARTERS);

    /// Its quarters, as a file has them; 0 while the encoder has not chosen.
    fn quarters(self) -> u8 {
        match self {
            Self::Quarters(quarters) => quarters,
            Self::Best => 0,
        }
    }

    /// Part of the difference, 0 to 1.
    fn part(self) -> f64 {
        f64::from(self.quarters()) / f64::from(QUARTERS)
    }
}

/// Classes of precision, one of each kind per row, below [`CONTEXTS`]; empty where no part follows them.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub(super) struct Classes {
    pub(super) shape: Vec<u8>,
    pub(super) colour: Vec<u8>,
}

impl Classes {
    fn of(&self, follows: Follows) -> Option<&[u8]> {
        match follows {
            Follows::Nothing => None,
            Follows::Shape => Some(&self.shape),
            Follows::Colour => Some(&self.colour),
        }
    }
}

/// How the values of a field are to be coded.
pub(super) struct Plan<'a> {
    pub(super) parts: &'a [Part],
    pub(super) classes: &'a Classes,
    pub(super) centre: Centre<'a>,
    /// Whether the columns are colours, arranged by [`to_opponent`](super::opponent::to_opponent).
    pub(super) opponent: bool,
}

/// Where each column's centre is.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Centre<'a> {
    /// At 0.
    Zero,
    /// In the middle between the lowest and the highest value, for values that are far from 0.
    Middle,
    /// At the whole number next to that: whole numbers stay whole.
    Whole,
    /// At these values, one for each column.
    At(&'a [f32]),
}

/// The header of a coded field.
#[derive(Clone, Debug)]
pub(super) struct Header {
    pub(super) rows: usize,
    pub(super) width: usize,
    parts: Vec<Part>,
    opponent: bool,
    centres: Vec<f32>,
    /// Where the integers begin.
    payload: usize,
}

impl Part {
    /// The step of rows of each class.
    pub(super) fn steps(&self) -> [f64; CONTEXTS] {
        let of = |class: usize| f64::from(self.step) * (class as f64 - f64::from(MIDDLE)).exp2();
        std::array::from_fn(|class| of(class).min(f64::from(self.most)))
    }
}

impl Header {
    /// Parses the header.
    ///
    /// # Errors
    /// There is no header, or it is impossible.
    pub(super) fn of(coded: &[u8]) -> Result<Self, TableError> {
        let too_short = TableError::NoHeader { bytes: coded.len() };
        let Some((header, rest)) = coded.split_first_chunk::<HEADER_BYTES>() else { return Err(too_short) };
        let rows = u64::from_le_bytes(std::array::from_fn(|i| header[i]));
        let width = usize::from(u16::from_le_bytes([header[8], header[9]]));
        let (count, flags) = (usize::from(header[10]), header[11]);
        let Some((parts, rest)) = rest.split_at_checked(count * PART_BYTES) else { return Err(too_short) };
        let Some((centres, _)) = rest.split_at_checked(4 * width) else { return Err(too_short) };
        let parts: Option<Vec<Part>> = parts.as_chunks::<PART_BYTES>().0.iter().map(part_of).collect();
        let mut parts = parts.ok_or(TableError::Frequencies)?;
        let counts = TableError::Counts { rows, width: width as u32, block_rows: count as u32 };
        let columns: usize = parts.iter().map(|part| part.columns).sum();
        if flags & DELTA != 0 {
            parts.iter_mut().for_each(|part| part.memory = Memory::ALL);
        }
        let opponent = flags & OPPONENT != 0;
        let are_colours = |parts: &[Part]| parts.len() == 3 && parts.iter().all(|p| p.columns == parts[0].columns);
        let fit = !opponent || parts.chunks(3).all(are_colours);
        if columns != width
            || width == 0
            || width > MOST_COLUMNS
            || flags > DELTA | OPPONENT
            || !fit
            || rows > u64::from(u32::MAX)
        {
            return Err(counts);
        }
        let centres: Vec<f32> = centres.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect();
        let mut numbers = parts.iter().flat_map(|part| [part.step, part.most]).chain(centres.iter().copied());
        if let Some(number) = numbers.find(|number| !number.is_finite()) {
            return Err(TableError::Step(number));
        }
        let payload = HEADER_BYTES + count * PART_BYTES + 4 * width;
        Ok(Self { rows: rows as usize, width, parts, opponent, centres, payload })
    }
}

impl Header {
    /// Bytes of the tokens and of the lower bits; `None` if the payload is damaged.
    pub(super) fn stream_bytes(&self, coded: &[u8]) -> Option<[usize; 2]> {
        entropy::stream_bytes(self.parts.len(), coded.get(self.payload..)?)
    }
}

fn part_of(bytes: &[u8; PART_BYTES]) -> Option<Part> {
    let [c0, c1, s0, s1, s2, s3, m0, m1, m2, m3, kind] = *bytes;
    let (quarters, kind) = (kind / KINDS, kind % KINDS);
    let follows = match kind {
        0 => Follows::Nothing,
        1 => Follows::Shape,
        2 => Follows::Colour,
        _ => return None,
    };
    let columns = usize::from(u16::from_le_bytes([c0, c1]));
    if quarters > QUARTERS || columns == 0 {
        return None;
    }
    let memory = Memory::Quarters(quarters);
    let [step, most] = [[s0, s1, s2, s3], [m0, m1, m2, m3]].map(f32::from_le_bytes);
    Some(Part { columns, step, most, follows, memory })
}

/// The column kinds of parts: one model per part.
fn kinds<'a>(parts: &[Part], classes: &'a Classes) -> Vec<ColumnKind<'a>> {
    let kind = |(model, part): (usize, &Part)| {
        std::iter::repeat_n(ColumnKind { model, contexts: classes.of(part.follows) }, part.columns)
    };
    parts.iter().enumerate().flat_map(kind).collect()
}

/// The part of each column.
fn by_column(parts: &[Part]) -> Vec<Part> {
    parts.iter().flat_map(|part| std::iter::repeat_n(*part, part.columns)).collect()
}

/// How the values of a field are rounded, and to what.
pub(super) struct Rounded {
    /// The prediction of the first row of each column, and of all rows without a memory.
    pub(super) centres: Vec<f32>,
    /// The parts as they are stored: each has a memory, and steps that reach all of its values.
    pub(super) parts: Vec<Part>,
    /// The numbers of steps between values and their predictions, all rows of a column before those of the next.
    integers: Vec<i64>,
}

/// Rounds finite values, row by row; `None` if they are so far apart that a step would be beyond f32.
pub(super) fn rounded_field(values: &[f32], rows: usize, plan: &Plan<'_>) -> Option<Rounded> {
    let width: usize = plan.parts.iter().map(|part| part.columns).sum();
    let column = |c: usize| (0..rows).map(move |row| values[row * width + c]);
    let centre = |c: usize| match plan.centre {
        Centre::Zero => 0.0,
        Centre::Middle => middle(column(c)),
        Centre::Whole => middle(column(c)).round(),
        Centre::At(centres) => centres[c],
    };
    let centres: Vec<f32> = (0..width).map(centre).collect();
    // Steps must reach the farthest value in MOST_STEPS even where their class is the finest.
    let mut first = 0;
    let parts: Vec<Part> = plan
        .parts
        .iter()
        .map(|part| {
            let columns = first..first + part.columns;
            first = columns.end;
            let moves = part.memory != Memory::NONE;
            let reach = columns.map(|c| reach(column(c), centres[c], moves)).fold(0.0, f64::max);
            let least = (reach / MOST_STEPS * (MIDDLE as f64 + 1.0).exp2()).max(f64::from(f32::MIN_POSITIVE));
            Part { step: part.step.max(least as f32), most: part.most.max(least as f32), ..*part }
        })
        .collect();
    if parts.iter().any(|part| !part.step.is_finite() || !part.most.is_finite()) {
        return None;
    }

    let mut integers = Vec::with_capacity(values.len());
    let mut first = 0;
    let resolved = |part: Part| {
        let (columns, begin) = (first..first + part.columns, integers.len());
        first = columns.end;
        let tried = match part.memory {
            Memory::Best => &TRIED[..],
            Memory::Quarters(quarters) => &[quarters],
        };
        let mut best = (f64::INFINITY, part);
        for &quarters in tried {
            let part = Part { memory: Memory::Quarters(quarters), ..part };
            let classes = plan.classes.of(part.follows);
            let of_part: Vec<i64> =
                columns.clone().flat_map(|c| rounded(column(c), f64::from(centres[c]), &part, classes)).collect();
            // One pass alone needs no comparison.
            let bits = if tried.len() > 1 { of_part.iter().map(|&integer| rough_bits(integer)).sum() } else { 0.0 };
            if bits < best.0 {
                best = (bits, part);
                integers.truncate(begin);
                integers.extend(of_part);
            }
        }
        best.1
    };
    let parts: Vec<Part> = parts.into_iter().map(resolved).collect();
    Some(Rounded { centres, parts, integers })
}

/// Codes finite values, row by row; `None` if they are so far apart that a step would be beyond f32.
pub(super) fn encode(values: &[f32], rows: usize, plan: &Plan<'_>) -> Option<Vec<u8>> {
    let Rounded { centres, parts, integers } = rounded_field(values, rows, plan)?;
    let mut out = (rows as u64).to_le_bytes().to_vec();
    out.extend((centres.len() as u16).to_le_bytes());
    out.extend([parts.len() as u8, if plan.opponent { OPPONENT } else { 0 }]);
    for part in &parts {
        out.extend((part.columns as u16).to_le_bytes());
        out.extend(part.step.to_le_bytes());
        out.extend(part.most.to_le_bytes());
        let kind = match part.follows {
            Follows::Nothing => 0,
            Follows::Shape => 1,
            Follows::Colour => 2,
        };
        out.push(kind + KINDS * part.memory.quarters());
    }
    out.extend(centres.iter().flat_map(|centre| centre.to_le_bytes()));
    out.extend(entropy::encode(&Layout { rows, columns: &kinds(&parts, plan.classes) }, &integers));
    Some(out)
}

/// Decodes the output of [`encode`] to values, row by row; colours are red, green and blue. The caller has checked that memory
/// for them is plausible.
///
/// # Errors
/// The bytes are not a whole field, or the classes that it follows are not those of its rows.
pub(super) fn decode(coded: &[u8], classes: &Classes) -> Result<Vec<f32>, TableError> {
    let header = Header::of(coded)?;
    let Header { rows, width, .. } = header;
    for part in &header.parts {
        if classes.of(part.follows).is_some_and(|classes| classes.len() != rows) {
            return Err(TableError::Classes);
        }
    }
    // Columns come one after another; those of a group go to the rows together, as rows are far apart in memory.
    let groups = header.parts.chunks(if header.opponent { 3 } else { 1 });
    let widths: Vec<usize> = groups.map(|parts| parts.iter().map(|part| part.columns).sum()).collect();
    let widest = widths.iter().copied().max().unwrap_or(0);
    let need = rows as u64 * (width + widest) as u64 * size_of::<f32>() as u64;
    if let Some(have) = available_bytes().filter(|&have| need > have) {
        return Err(TableError::NoMemory { need, have });
    }
    let (mut values, mut group) = (Vec::new(), Vec::new());
    values.try_reserve_exact(rows * width).map_err(TableError::Allocation)?;
    values.resize(rows * width, 0.0f32);
    group.try_reserve_exact(rows * widest).map_err(TableError::Allocation)?;
    let of_part = |part: &Part| (part.steps(), classes.of(part.follows), part.memory.part());
    let columns: Vec<_> = by_column(&header.parts).iter().map(of_part).collect();
    let (mut done, mut first) = (0, 0);
    let mut prediction = 0.0;
    let layout = Layout { rows, columns: &kinds(&header.parts, classes) };
    entropy::decode(&layout, &coded[header.payload..], |Decoded { column, first_row, values: integers }| {
        let (steps, classes, memory) = &columns[column];
        if first_row == 0 {
            prediction = f64::from(header.centres[column]);
        }
        // Half a step beyond the largest f32 must not become infinite.
        let narrow = |value: f64| value.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32;
        let mut value_of = |(&integer, class): (&i64, u8)| {
            let value = prediction + integer as f64 * steps[usize::from(class)];
            // Without a memory the next value does not wait for this one.
            if *memory > 0.0 {
                prediction = moved(prediction, value, *memory);
            }
            narrow(value)
        };
        match classes {
            None => group.extend(integers.iter().map(|integer| value_of((integer, MIDDLE)))),
            Some(classes) => {
                group.extend(integers.iter().zip(classes[first_row..].iter().copied()).map(value_of));
            }
        }
        let is_last = first_row + integers.len() == rows && column + 1 == first + widths[done];
        if is_last {
            put_columns(&group, &mut values, &Place { rows, width, first, are_colours: header.opponent });
            group.clear();
            (first, done) = (column + 1, done + 1);
        }
    })?;
    Ok(values)
}

/// The columns of a table that [`put_columns`] fills.
struct Place {
    /// Number of rows that the whole table has, which every column fills.
    rows: usize,
    /// Values in a row of the table.
    width: usize,
    /// Index of the first of the columns in a row.
    first: usize,
    /// Whether they are a band of opponent colours.
    are_colours: bool,
}

/// Puts consecutive columns, each a run of `columns`, into rows of `values`.
fn put_columns(columns: &[f32], values: &mut [f32], place: &Place) {
    let Place { rows, width, first, are_colours } = *place;
    let count = columns.len() / rows;
    for (row, out) in values.chunks_exact_mut(width).enumerate() {
        let out = &mut out[first..first + count];
        if are_colours {
            for (i, rgb) in out.as_chunks_mut::<3>().0.iter_mut().enumerate() {
                let of = |part: usize| columns[(part * (count / 3) + i) * rows + row];
                let [r, g, b] = rgb_from_opponent([of(0), of(1), of(2)]);
                // A sum of large numbers must not become infinite.
                *rgb = [r.clamp(f32::MIN, f32::MAX), g.clamp(f32::MIN, f32::MAX), b.clamp(f32::MIN, f32::MAX)];
            }
        } else {
            out.iter_mut().enumerate().for_each(|(c, value)| *value = columns[c * rows + row]);
        }
    }
}

/// The integers of a column.
fn rounded<'a>(
    values: impl Iterator<Item = f32> + 'a,
    centre: f64,
    part: &Part,
    classes: Option<&'a [u8]>,
) -> impl Iterator<Item = i64> + 'a {
    let (mut prediction, steps, memory) = (centre, part.steps(), part.memory.part());
    values.enumerate().map(move |(row, value)| {
        let step = steps[usize::from(classes.map_or(MIDDLE, |classes| classes[row]))];
        let integer = ((f64::from(value) - prediction) / step).round();
        prediction = moved(prediction, prediction + integer * step, memory);
        integer as i64
    })
}

/// The prediction after a row; with a memory of 1 exactly its value.
fn moved(prediction: f64, value: f64, memory: f64) -> f64 {
    (1.0 - memory) * prediction + memory * value
}

/// About the bits of an integer.
fn rough_bits(integer: i64) -> f64 {
    (1.0 + 2.0 * integer.unsigned_abs() as f64).log2()
}

/// The middle between the lowest and the highest value.
fn middle(values: impl Iterator<Item = f32> + Clone) -> f32 {
    let low = values.clone().fold(f32::INFINITY, f32::min);
    let high = values.fold(f32::NEG_INFINITY, f32::max);
    let middle = ((f64::from(low) + f64::from(high)) / 2.0) as f32;
    if middle.is_finite() { middle } else { 0.0 }
}

/// The largest difference that a column has to code.
fn reach(values: impl Iterator<Item = f32> + Clone, centre: f32, moves: bool) -> f64 {
    let of = |values: &mut dyn Iterator<Item = f32>| {
        values.fold(0.0f64, |reach, value| reach.max((f64::from(value) - f64::from(centre)).abs()))
    };
    // A prediction lies within the range of the values, but for the rounding of the row before, so that a difference is at most
    // that range and a step.
    of(&mut values.into_iter()) * if moves { 2.5 } else { 1.0 }
}

#[cfg(test)]
mod tests {
    use super::super::opponent::to_opponent;
    use super::*;
    use instgs_vk::math::rng::Rng;

    /// Numbers of rows around those that are decoded together.
    const ROWS: [usize; 6] = [0, 1, 1023, 1024, 1025, 2049];

    fn part(columns: usize, follows: Follows, memory: Memory) -> Part {
        Part { columns, step: 0.01, most: 0.04, follows, memory }
    }

    #[test]
    fn values_come_back_to_half_a_step_whatever_the_memory() {
        let mut rng = Rng::new(3);
        for rows in ROWS {
            let class = |rng: &mut Rng| (0..rows).map(|_| rng.index(CONTEXTS) as u8).collect::<Vec<_>>();
            let classes = Classes { shape: class(&mut rng), colour: class(&mut rng) };
            let follows = [Follows::Nothing, Follows::Shape, Follows::Colour];
            for (memory, follows) in TRIED.into_iter().map(Memory::Quarters).zip(follows.into_iter().cycle()) {
                let parts = [part(2, follows, memory), part(3, Follows::Nothing, Memory::NONE)];
                let values: Vec<f32> = (0..5 * rows).map(|_| (3.0 + rng.normal()) as f32).collect();
                let plan = Plan { parts: &parts, classes: &classes, centre: Centre::Middle, opponent: false };
                let coded = encode(&values, rows, &plan).expect("in reach");
                let decoded = decode(&coded, &classes).expect("decodes");
                assert_eq!(decoded.len(), values.len());
                for (i, (value, was)) in decoded.iter().zip(&values).enumerate() {
                    let class = classes.of(follows).filter(|_| i % 5 < 2).map_or(MIDDLE, |classes| classes[i / 5]);
                    let half = parts[0].steps()[usize::from(class)] / 2.0;
                    assert!(f64::from((value - was).abs()) <= half + 1e-6, "{rows}, {memory:?}, {i}: {value} {was}");
                }
            }
        }
    }

    #[test]
    fn colours_of_several_bands_come_back() {
        let mut rng = Rng::new(4);
        // Bands of one and three coefficients: twelve numbers a row.
        let parts: Vec<Part> =
            [1, 3].into_iter().flat_map(|n| [part(n, Follows::Nothing, Memory::Quarters(1)); 3]).collect();
        for rows in ROWS {
            let rgb: Vec<f32> = (0..12 * rows).map(|_| rng.normal() as f32).collect();
            let classes = Classes::default();
            let plan = Plan { parts: &parts, classes: &classes, centre: Centre::Zero, opponent: true };
            let coded = encode(&to_opponent(&rgb, &[1, 3]), rows, &plan).expect("in reach");
            let decoded = decode(&coded, &classes).expect("decodes");
            assert_eq!(decoded.len(), rgb.len());
            // Three numbers are each off by half a step, in an orthonormal basis.
            for (i, (value, was)) in decoded.iter().zip(&rgb).enumerate() {
                assert!((value - was).abs() <= 0.005 * 3f32.sqrt() + 1e-5, "{rows}, {i}: {value} {was}");
            }
        }
    }
}
