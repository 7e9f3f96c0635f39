//! Tables of values as multiples of a step, column by column, compressed: the coding of format 2, which is only read.
//!
//! A table has `rows` of `width` values; a column is cut into blocks of rows with a step each. The bytes:
//!
//! - rows u64, width u32, rows per block u32, little-endian;
//! - one zstd frame: for each column and block the lowest value in steps (i64) and the step (f32); for each column the
//!   bytes per value (u8: 0, 1 or 2); then for each column its values minus the lowest of their block, in steps: the
//!   low bytes of all rows, then the high ones.
//!
//! The error of a value is at most half a step; 0 is a multiple of every step and stays exact. If the values of a block
//! span more than 65535 steps, the step is enlarged: nothing is clamped. zstd compresses columns in planes of bytes to
//! within 2 % of their entropy at level 19; level 9 takes 8 % more.

use std::io::Read;
use std::ops::Range;

use super::host_memory::available_bytes;

/// Bytes of the header: rows, width, rows per block.
pub(super) const HEADER_BYTES: usize = 16;
/// Upper limit on rows per byte of a table: a real one has bits of noise in every row, so that more is damage.
const MOST_ROWS_PER_BYTE: u64 = 1 << 16;
/// Bytes per block: lowest value and step.
const BLOCK_BYTES: u64 = 12;

/// Why the bytes of a coded table cannot be decoded.
#[derive(Debug, thiserror::Error)]
pub enum TableError {
    /// There are fewer bytes than a header has.
    #[error("has {bytes} bytes, too few for a header")]
    NoHeader {
        /// The number of bytes.
        bytes: usize,
    },
    /// The header has a count that is zero, or too large for the bytes after it.
    #[error("claims {rows} rows of {width} numbers in blocks of {block_rows}")]
    Counts {
        /// The number of rows.
        rows: u64,
        /// The number of values per row.
        width: u32,
        /// The number of rows per block.
        block_rows: u32,
    },
    /// zstd cannot decompress the bytes.
    #[error("is damaged: {0}")]
    Damaged(std::io::Error),
    /// There are fewer values than the header claims.
    #[error("ends too early")]
    TooShort,
    /// There are bytes after the last value.
    #[error("has bytes beyond its end")]
    TooLong,
    /// A step is not finite.
    #[error("has a step of {0}")]
    Step(f32),
    /// A column has more than two bytes per value.
    #[error("has {bytes} bytes per value in column {column}")]
    ValueBytes {
        /// The number of bytes per value.
        bytes: u8,
        /// Index of the column.
        column: usize,
    },
    /// The values would take more host memory than is available.
    #[error("claims values of {} MiB, but {} MiB of memory are available", need >> 20, have >> 20)]
    NoMemory {
        /// Memory of the values, bytes.
        need: u64,
        /// Available memory, bytes.
        have: u64,
    },
    /// Allocating the values failed.
    #[error("takes too much memory: {0}")]
    Allocation(std::collections::TryReserveError),
    /// Frequencies of tokens do not add up, or a value has none.
    #[error("has impossible frequencies")]
    Frequencies,
    /// Classes of precision are missing, impossible, or of another number of rows.
    #[error("has no classes of precision for its rows")]
    Classes,
    /// There are more rows than the bytes make plausible.
    #[error("claims {rows} rows in {bytes} bytes, more than is plausible")]
    Implausible {
        /// The number of rows.
        rows: usize,
        /// The number of bytes.
        bytes: usize,
    },
    /// A row of a table of rotations is not a coded quaternion.
    #[error("has an invalid rotation")]
    Rotation,
}

/// The header of a coded table.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Shape {
    pub(super) rows: usize,
    pub(super) width: usize,
    block_rows: usize,
}

impl Shape {
    /// Parses the header of a coded table.
    ///
    /// # Errors
    /// There is no header, or its counts are impossible.
    pub(super) fn of(coded: &[u8]) -> Result<Self, TableError> {
        let Some((header, packed)) = coded.split_first_chunk::<HEADER_BYTES>() else {
            return Err(TableError::NoHeader { bytes: coded.len() });
        };
        let word = |at: usize| header[at..].first_chunk::<4>().map_or(0, |b| u32::from_le_bytes(*b));
        let rows = u64::from(word(0)) | u64::from(word(4)) << 32;
        let (width, block_rows) = (word(8), word(12));
        if rows > MOST_ROWS_PER_BYTE * packed.len() as u64
            || width == 0
            || block_rows == 0
            || width > u32::from(u16::MAX)
        {
            return Err(TableError::Counts { rows, width, block_rows });
        }
        Ok(Self { rows: rows as usize, width: width as usize, block_rows: block_rows as usize })
    }

    fn blocks(&self) -> impl ExactSizeIterator<Item = Range<usize>> + Clone {
        let Self { rows, block_rows, .. } = *self;
        (0..rows.div_ceil(block_rows)).map(move |b| b * block_rows..rows.min((b + 1) * block_rows))
    }

    /// Bytes of the frame before the planes.
    fn table_bytes(&self) -> u64 {
        self.width as u64 * (self.blocks().len() as u64 * BLOCK_BYTES + 1)
    }
}

/// Decodes a table to values, row by row.
///
/// # Errors
/// The bytes are not a whole table, or its values do not fit host memory.
pub(super) fn decode(coded: &[u8]) -> Result<Vec<f32>, TableError> {
    let shape = Shape::of(coded)?;
    let mut stream = zstd::stream::read::Decoder::with_buffer(&coded[HEADER_BYTES..]).map_err(TableError::Damaged)?;
    // Buffers grow with the actual output, whatever the header claims.
    let mut read = |bytes: u64| {
        let mut out = Vec::new();
        let read = stream.by_ref().take(bytes).read_to_end(&mut out).map_err(TableError::Damaged)?;
        if read as u64 == bytes { Ok(out) } else { Err(TableError::TooShort) }
    };
    let table = read(shape.table_bytes())?;
    let (blocks, bytes) = table.split_at(table.len() - shape.width);
    let blocks: Vec<Block> = blocks.chunks_exact(BLOCK_BYTES as usize).map(Block::read).collect();
    if let Some(block) = blocks.iter().find(|block| !block.step.is_finite()) {
        return Err(TableError::Step(block.step));
    }
    let need = shape.rows as u64 * shape.width as u64 * size_of::<f32>() as u64;
    if let Some(have) = available_bytes().filter(|&have| need > have) {
        return Err(TableError::NoMemory { need, have });
    }
    let mut values = Vec::new();
    values.try_reserve_exact(shape.rows * shape.width).map_err(TableError::Allocation)?;
    values.resize(shape.rows * shape.width, 0.0);
    for (c, &bytes) in bytes.iter().enumerate() {
        if bytes > 2 {
            return Err(TableError::ValueBytes { bytes, column: c });
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
        Ok(_) => Err(TableError::TooLong),
        Err(e) => Err(TableError::Damaged(e)),
    }
}

struct Block {
    /// The lowest value in steps.
    lowest: i64,
    step: f32,
}

impl Block {
    fn value(&self, steps: u16) -> f32 {
        let value = (self.lowest as f64 + f64::from(steps)) * f64::from(self.step);
        // Half a step beyond the largest f32 must not become infinite.
        value.clamp(f64::from(f32::MIN), f64::from(f32::MAX)) as f32
    }

    fn read(bytes: &[u8]) -> Self {
        let lowest = bytes.first_chunk().map_or(0, |b| i64::from_le_bytes(*b));
        Self { lowest, step: bytes.last_chunk().map_or(0.0, |b| f32::from_le_bytes(*b)) }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use rayon::prelude::*;
    use std::ops::Range;
    /// What older versions wrote.
    /// Compression level of zstd, chosen for size: see the module's documentation.
    const LEVEL: i32 = 19;
    /// Upper limit on steps between the lowest and the highest value of a block: two bytes.
    const MOST_STEPS: f64 = 65535.0;

    /// Codes finite `values`, `width` per row, in blocks of `block_rows`; `step_of` returns the step of a range of rows, 0
    /// for the finest possible.
    ///
    /// # Errors
    /// zstd fails.
    fn encode(
        values: &[f32],
        width: usize,
        block_rows: usize,
        step_of: impl Fn(Range<usize>) -> f32 + Sync,
    ) -> std::io::Result<Vec<u8>> {
        let shape = Shape { rows: values.len() / width, width, block_rows };
        let columns: Vec<Column> =
            (0..width).into_par_iter().map(|c| Column::new(values, &shape, c, &step_of)).collect();
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

    impl Block {
        /// The block of `values`, with a step of at least `step`.
        fn new(values: impl Iterator<Item = f32> + Clone, step: f32) -> Self {
            let low = f64::from(values.clone().fold(f32::INFINITY, f32::min));
            let high = f64::from(values.fold(f32::NEG_INFINITY, f32::max));
            // One step less than available, for the rounding of both ends; and not finer than the precision of the values,
            // whose step counts an i64 could not hold.
            let precision = low.abs().max(high.abs()) * f64::from(f32::EPSILON);
            let step =
                f64::from(step).max((high - low) / (MOST_STEPS - 1.0)).max(precision).max(f64::from(f32::MIN_POSITIVE));
            // Rounded up, so that the bound holds in f32.
            let step = if f64::from(step as f32) < step { (step as f32).next_up() } else { step as f32 };
            Self { lowest: (low / f64::from(step)).round() as i64, step }
        }

        fn steps(&self, value: f32) -> u16 {
            ((f64::from(value) / f64::from(self.step)).round() as i64 - self.lowest) as u16
        }

        fn write(&self, out: &mut Vec<u8>) {
            out.extend(self.lowest.to_le_bytes());
            out.extend(self.step.to_le_bytes());
        }
    }

    struct Column {
        blocks: Vec<Block>,
        /// Steps of each row above the lowest value of its block.
        steps: Vec<u16>,
        /// Bytes per value: 0, 1 or 2.
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

    use instgs_vk::math::rng::Rng;

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
                    // Half a step, plus rounding to f32.
                    assert!((a - b).abs() <= 0.501 * step, "{a} {b} {step}");
                    assert!(*b != 0.0 || a.to_bits() == 0, "{a}");
                }
            }
        }
        assert!(back(&[], 3, 256, 0.1).is_empty());
    }

    #[test]
    fn steps_grow_where_the_range_calls_for_it() {
        // 2e6 steps of 1e-3; values too large for such steps in f32; the whole range of f32.
        for values in [[-1000.0f32, 0.0, 0.25, 1000.0], [3e8, 3e8, 3.00001e8, 3e8], [-3.4e38, 0.0, 1.0, 3.4e38]] {
            let [low, high] = [values[0], values[3].max(values[2])].map(f64::from);
            let largest = low.abs().max(high.abs()) * f64::from(f32::EPSILON);
            let step = ((high - low) / 65534.0).max(largest).max(1e-3);
            for (&a, &b) in back(&values, 1, 4, 1e-3).iter().zip(&values) {
                assert!((f64::from(a) - f64::from(b)).abs() <= 0.51 * step + largest, "{a} {b} {step}");
            }
        }
        // A separate block keeps its step.
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
        // More rows than the bytes hold, no columns, no blocks, more columns than exist.
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
            // Both outcomes are acceptable, but nothing may panic or have another size.
            if let Ok(values) = decode(&other) {
                assert_eq!(values.len(), Shape::of(&other).map_or(0, |shape| shape.rows * shape.width));
            }
        }
    }
}
