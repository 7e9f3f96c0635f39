//! Tables of numbers as whole multiples of a step, column by column, compressed: what `--pack small` makes of tensors.
//!
//! A table has `rows` of `width` numbers; a column is cut into blocks of rows with a step each. The bytes:
//!
//! - rows u64, width u32, rows of a block u32, little-endian;
//! - one zstd frame: for each column and block the lowest value as a count of steps (i64) and the step (f32); for each
//!   column the bytes per number (u8: 0, 1 or 2); then for each column its numbers less the lowest of their block, the low
//!   bytes of all rows, then the high ones.
//!
//! A number is off by half a step at most; 0 is a multiple of every step and stays 0. Where the values of a block span more
//! than 65535 steps, the step is made longer until they do not: nothing is clamped. Columns in planes of bytes are what
//! zstd packs to within 2 % of their entropy (measured on trained scenes, level 19; level 9 takes 8 % more).

use std::io::Read;
use std::ops::Range;

use rayon::prelude::*;

use super::host_memory::available_bytes;

/// Rows, width, rows of a block.
pub(super) const HEADER_BYTES: usize = 16;
/// Of zstd: see above.
const LEVEL: i32 = 19;
/// Most steps between the lowest and the highest value of a block: two bytes.
const MOST_STEPS: f64 = 65535.0;
/// A table that claims more rows than this for each of its bytes is none: a real one has bits of noise in every row.
const MOST_ROWS_PER_BYTE: u64 = 1 << 16;
/// Lowest value and step.
const BLOCK_BYTES: u64 = 12;

/// The first bytes of a coded table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shape {
    pub(super) rows: usize,
    pub(super) width: usize,
    block_rows: usize,
}

impl Shape {
    /// Of a coded table.
    ///
    /// # Errors
    /// What is wrong with it, for a message.
    pub(super) fn of(coded: &[u8]) -> Result<Self, String> {
        let Some((header, packed)) = coded.split_first_chunk::<HEADER_BYTES>() else {
            return Err(format!("has {} bytes, too few for a header", coded.len()));
        };
        let word = |at: usize| header[at..].first_chunk::<4>().map_or(0, |b| u32::from_le_bytes(*b));
        let rows = u64::from(word(0)) | u64::from(word(4)) << 32;
        let (width, block_rows) = (word(8), word(12));
        if rows > MOST_ROWS_PER_BYTE * packed.len() as u64
            || width == 0
            || block_rows == 0
            || width > u32::from(u16::MAX)
        {
            return Err(format!("claims {rows} rows of {width} numbers in blocks of {block_rows}"));
        }
        Ok(Self { rows: rows as usize, width: width as usize, block_rows: block_rows as usize })
    }

    fn blocks(&self) -> impl ExactSizeIterator<Item = Range<usize>> + Clone {
        let Self { rows, block_rows, .. } = *self;
        (0..rows.div_ceil(block_rows)).map(move |b| b * block_rows..rows.min((b + 1) * block_rows))
    }

    /// Bytes before the planes.
    fn table_bytes(&self) -> u64 {
        self.width as u64 * (self.blocks().len() as u64 * BLOCK_BYTES + 1)
    }
}

/// Codes finite `values`, `width` to a row, in blocks of `block_rows`; `step_of` gives a block's step, above 0, from its
/// rows.
///
/// # Errors
/// What zstd says.
pub(super) fn encode(
    values: &[f32],
    width: usize,
    block_rows: usize,
    step_of: impl Fn(Range<usize>) -> f32 + Sync,
) -> std::io::Result<Vec<u8>> {
    let shape = Shape { rows: values.len() / width, width, block_rows };
    let columns: Vec<Column> = (0..width).into_par_iter().map(|c| Column::new(values, &shape, c, &step_of)).collect();
    let mut plain = Vec::with_capacity(values.len() * 2);
    columns.iter().for_each(|column| column.blocks.iter().for_each(|block| block.write(&mut plain)));
    plain.extend(columns.iter().map(|column| column.bytes));
    for column in &columns {
        for byte in 0..column.bytes {
            plain.extend(column.steps.iter().map(|&q| q.to_le_bytes()[byte as usize]));
        }
    }
    let mut out = (shape.rows as u64).to_le_bytes().to_vec();
    out.extend([width, block_rows].into_iter().flat_map(|v| (v as u32).to_le_bytes()));
    out.extend(zstd::bulk::compress(&plain, LEVEL)?);
    Ok(out)
}

/// Decodes what [`encode`] made: the values, row by row.
///
/// # Errors
/// What is wrong with the bytes, for a message.
pub(super) fn decode(coded: &[u8]) -> Result<Vec<f32>, String> {
    let shape = Shape::of(coded)?;
    let mut stream =
        zstd::stream::read::Decoder::with_buffer(&coded[HEADER_BYTES..]).map_err(|e| format!("is damaged: {e}"))?;
    // Buffers grow with what really comes out.
    let mut read = |bytes: u64| {
        let mut out = Vec::new();
        let read = stream.by_ref().take(bytes).read_to_end(&mut out).map_err(|e| format!("is damaged: {e}"))?;
        if read as u64 == bytes { Ok(out) } else { Err("ends too early".to_owned()) }
    };
    let table = read(shape.table_bytes())?;
    let (blocks, bytes) = table.split_at(table.len() - shape.width);
    let blocks: Vec<Block> = blocks.chunks_exact(BLOCK_BYTES as usize).map(Block::read).collect();
    if let Some(block) = blocks.iter().find(|block| !block.step.is_finite()) {
        return Err(format!("has a step of {}", block.step));
    }
    let need = shape.rows as u64 * shape.width as u64 * size_of::<f32>() as u64;
    if let Some(have) = available_bytes().filter(|&have| need > have) {
        return Err(format!("claims numbers of {} MiB, where {} MiB of memory are to spare", need >> 20, have >> 20));
    }
    let mut values = Vec::new();
    values.try_reserve_exact(shape.rows * shape.width).map_err(|e| format!("takes too much memory: {e}"))?;
    values.resize(shape.rows * shape.width, 0.0);
    for (c, &bytes) in bytes.iter().enumerate() {
        if bytes > 2 {
            return Err(format!("has {bytes} bytes a number in column {c}"));
        }
        let planes = read(u64::from(bytes) * shape.rows as u64)?;
        let (low, high) = planes.split_at(if bytes == 0 { 0 } else { shape.rows });
        let own = &blocks[c * shape.blocks().len()..];
        for (block, rows) in own.iter().zip(shape.blocks()) {
            for row in rows {
                let byte = |plane: &[u8]| plane.get(row).copied().unwrap_or(0);
                values[row * shape.width + c] = block.value(u16::from_le_bytes([byte(low), byte(high)]));
            }
        }
    }
    let mut more = [0];
    match stream.read(&mut more) {
        Ok(0) => Ok(values),
        Ok(_) => Err("has bytes beyond its end".into()),
        Err(e) => Err(format!("is damaged: {e}")),
    }
}

struct Block {
    /// Steps.
    lowest: i64,
    step: f32,
}

impl Block {
    /// Of values, with a step of at least `step`.
    fn new(values: impl Iterator<Item = f32> + Clone, step: f32) -> Self {
        let low = f64::from(values.clone().fold(f32::INFINITY, f32::min));
        let high = f64::from(values.fold(f32::NEG_INFINITY, f32::max));
        // One step less than there are, for the rounding of both ends; and none finer than the numbers themselves, whose
        // counts of steps an i64 would not hold.
        let precision = low.abs().max(high.abs()) * f64::from(f32::EPSILON);
        let step =
            f64::from(step).max((high - low) / (MOST_STEPS - 1.0)).max(precision).max(f64::from(f32::MIN_POSITIVE));
        // Rounded up, so that the bound holds.
        let step = if f64::from(step as f32) < step { (step as f32).next_up() } else { step as f32 };
        Self { lowest: (low / f64::from(step)).round() as i64, step }
    }

    fn steps(&self, value: f32) -> u16 {
        ((f64::from(value) / f64::from(self.step)).round() as i64 - self.lowest) as u16
    }

    fn value(&self, steps: u16) -> f32 {
        let value = (self.lowest as f64 + f64::from(steps)) * f64::from(self.step);
        // Half a step beyond the largest f32 is still no infinity.
        value.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32
    }

    fn write(&self, out: &mut Vec<u8>) {
        out.extend(self.lowest.to_le_bytes());
        out.extend(self.step.to_le_bytes());
    }

    fn read(bytes: &[u8]) -> Self {
        let lowest = bytes.first_chunk().map_or(0, |b| i64::from_le_bytes(*b));
        Self { lowest, step: bytes.last_chunk().map_or(0.0, |b| f32::from_le_bytes(*b)) }
    }
}

struct Column {
    blocks: Vec<Block>,
    /// Of each row, from its block's lowest value.
    steps: Vec<u16>,
    /// That a number takes.
    bytes: u8,
}

impl Column {
    fn new(values: &[f32], shape: &Shape, c: usize, step_of: &impl Fn(Range<usize>) -> f32) -> Self {
        let of = |rows: Range<usize>| rows.map(|row| values[row * shape.width + c]);
        let blocks: Vec<Block> = shape.blocks().map(|rows| Block::new(of(rows.clone()), step_of(rows))).collect();
        let mut steps = Vec::with_capacity(shape.rows);
        for (block, rows) in blocks.iter().zip(shape.blocks()) {
            steps.extend(of(rows).map(|value| block.steps(value)));
        }
        let bytes = match steps.iter().max() {
            None | Some(0) => 0,
            Some(..=255) => 1,
            Some(_) => 2,
        };
        Self { blocks, steps, bytes }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::rng::Rng;

    fn back(values: &[f32], width: usize, block_rows: usize, step: f32) -> Vec<f32> {
        decode(&encode(values, width, block_rows, |_| step).expect("encodes")).expect("decodes")
    }

    #[test]
    fn values_are_off_by_half_a_step_and_zero_stays() {
        let mut rng = Rng::new(1);
        for (rows, width, block_rows) in [(1, 1, 1), (700, 3, 256), (513, 5, 1000), (256, 2, 256)] {
            let values: Vec<f32> =
                (0..rows * width).map(|i| if i % 7 == 0 { 0.0 } else { rng.normal() as f32 }).collect();
            for step in [0.5, 0.02, 1e-3] {
                for (a, b) in back(&values, width, block_rows, step).iter().zip(&values) {
                    // And what rounding to f32 adds.
                    assert!((a - b).abs() <= 0.501 * step, "{a} {b} {step}");
                    assert!(*b != 0.0 || a.to_bits() == 0, "{a}");
                }
            }
        }
        assert!(back(&[], 3, 256, 0.1).is_empty());
    }

    #[test]
    fn steps_grow_where_the_range_calls_for_it() {
        // 2e6 steps of 1e-3; values so large that an f32 has no such steps; all that an f32 holds.
        for values in [[-1000.0f32, 0.0, 0.25, 1000.0], [3e8, 3e8, 3.00001e8, 3e8], [-3.4e38, 0.0, 1.0, 3.4e38]] {
            let [low, high] = [values[0], values[3].max(values[2])].map(f64::from);
            let largest = low.abs().max(high.abs()) * f64::from(f32::EPSILON);
            let step = ((high - low) / 65534.0).max(largest).max(1e-3);
            for (&a, &b) in back(&values, 1, 4, 1e-3).iter().zip(&values) {
                assert!((f64::from(a) - f64::from(b)).abs() <= 0.51 * step + largest, "{a} {b} {step}");
            }
        }
        // A block of its own keeps its step.
        let near_and_far = [0.001, 0.002, 1000.0, -1000.0];
        let got = back(&near_and_far, 1, 2, 1e-4);
        assert!((got[0] - 0.001).abs() < 1e-4 && (got[2] - 1000.0).abs() < 0.05, "{got:?}");
    }

    #[test]
    fn constant_columns_take_no_bytes() {
        let ramp: Vec<f32> = (0..60_000).map(|i| (i % 250) as f32).collect();
        let with_constants: Vec<f32> = ramp.iter().flat_map(|&v| [7.5, v, 0.0]).collect();
        let alone = encode(&ramp, 1, 60_000, |_| 1.0).expect("encodes").len();
        let three = encode(&with_constants, 3, 60_000, |_| 0.5).expect("encodes");
        assert!(three.len() < alone + 40, "{} {alone}", three.len());
        assert_eq!(decode(&three).expect("decodes"), with_constants);
    }

    #[test]
    fn damaged_bytes_are_said_to_be() {
        let values: Vec<f32> = (0..600).map(|i| (i as f32).sin()).collect();
        let coded = encode(&values, 3, 64, |_| 0.01).expect("encodes");
        for end in 0..coded.len() {
            assert!(decode(&coded[..end]).is_err(), "{end}");
        }
        // More rows than the bytes hold, no columns, no blocks, more columns than there are.
        for (at, byte) in [(0, 201), (5, 1), (8, 0), (12, 0), (8, 4), (9, 1)] {
            let mut other = coded.clone();
            other[at] = byte;
            assert!(decode(&other).is_err(), "{at} {byte}");
        }
        let mut rng = Rng::new(2);
        for _ in 0..2000 {
            let mut other = coded.clone();
            let at = rng.index(other.len());
            other[at] ^= 1 << rng.index(8);
            // Either is right, but nothing may panic or be of another size.
            if let Ok(values) = decode(&other) {
                assert_eq!(values.len(), Shape::of(&other).map_or(0, |shape| shape.rows * shape.width));
            }
        }
    }
}
