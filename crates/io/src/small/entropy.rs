//! Columns of integers, entropy coded: the payload of a coded tensor of `--pack small`.
//!
//! An integer v, of up to 45 bits, becomes u = 2 |v| - [v < 0]; u below 16 is a *token* of its own, a larger one the token of its highest two
//! bits, followed by the lower bits as they are. Tokens are coded by asymmetric numeral systems (crate `constriction`) with
//! the frequencies of their *model* and *context*: columns of the same kind share a model, and the context of a row is its
//! class of precision, since values that were rounded more coarsely are smaller. Contexts with few tokens are merged.
//!
//! The bytes: number of ANS words u32; for each model its contexts' table numbers, then the tables (number of tokens u8, then
//! token u8 and frequency u16 of each; one token alone has no frequency and takes no bits); the ANS words u16; the lower bits
//! from the lowest bit of the first byte on. All little-endian; columns one after another, rows in order.

use constriction::stream::model::{ContiguousCategoricalEntropyModel, SmallContiguousLookupDecoderModel};
use constriction::stream::stack::SmallAnsCoder;
use constriction::stream::{Decode, Encode};

use crate::step_columns::TableError;

/// Number of contexts: the classes of precision.
pub(super) const CONTEXTS: usize = 15;
/// Integers have at most this magnitude: a scene's farthest Gaussian may be that many steps from its nearest.
pub(super) const MOST_STEPS: f64 = (1u64 << 44) as f64;
/// Values of u below this are tokens of their own.
const EXACT: u64 = 16;
/// Number of tokens: 16 exact ones, and two for each highest bit from 4 to 46.
const TOKENS: usize = EXACT as usize + 2 * 43;
/// Bits of frequencies: a table's sum is 4096.
const PRECISION: usize = 12;
/// A context with fewer tokens than this shares its table with the next ones: a table takes some 40 bytes.
const LEAST_TOKENS: u32 = 400;

/// The kinds of a table's columns and the rows' contexts, which encoder and decoder know from elsewhere.
pub(super) struct Layout<'a> {
    /// Number of rows.
    pub(super) rows: usize,
    /// For each column its model, counted from 0 without gaps, and whether rows have contexts in it.
    pub(super) columns: &'a [ColumnKind<'a>],
}

/// A column's model and contexts.
#[derive(Clone, Copy)]
pub(super) struct ColumnKind<'a> {
    pub(super) model: usize,
    /// The context of each row, below [`CONTEXTS`]; `None` if all rows have context 0.
    pub(super) contexts: Option<&'a [u8]>,
}

impl Layout<'_> {
    fn models(&self) -> usize {
        self.columns.iter().map(|column| column.model + 1).max().unwrap_or(0)
    }

    /// Index of the model and context of every value, column by column.
    fn places(&self) -> impl Iterator<Item = usize> + '_ {
        self.columns.iter().flat_map(move |column| {
            (0..self.rows).map(move |row| column.model * CONTEXTS + column.contexts.map_or(0, |c| usize::from(c[row])))
        })
    }
}

/// Token, number of lower bits, and lower bits of an integer.
fn token_of(value: i64) -> (u8, u32, u64) {
    let u = 2 * value.unsigned_abs() - u64::from(value < 0);
    if u < EXACT {
        return (u as u8, 0, 0);
    }
    let top = u.ilog2();
    let low = top - 1;
    ((EXACT + 2 * u64::from(top - 4) + (u >> low & 1)) as u8, low, u & ((1 << low) - 1))
}

/// What a token says of u.
#[derive(Clone, Copy)]
struct Base {
    /// u without its lower bits.
    u: u64,
    /// Number of lower bits.
    low: u32,
}

impl Base {
    fn of(token: u8) -> Self {
        let token = u64::from(token);
        if token < EXACT {
            return Self { u: token, low: 0 };
        }
        let (low, second) = (3 + (token - EXACT) / 2, (token - EXACT) % 2);
        Self { u: (2 + second) << low, low: low as u32 }
    }
}

fn value_of(u: u64) -> i64 {
    let magnitude = u.div_ceil(2) as i64;
    // -1 for a negative value, else 0: flipping all bits and adding 1 negates, without a branch that is hard to predict.
    let sign = -((u & 1) as i64);
    (magnitude ^ sign) - sign
}

/// The tokens of a table in order, and their frequencies, whose sum is 4096; empty for a table that no value uses.
#[derive(Clone, Default)]
struct Frequencies {
    tokens: Vec<u8>,
    frequencies: Vec<u16>,
}

impl Frequencies {
    fn of(counts: &[u32; TOKENS]) -> Self {
        let total: u64 = counts.iter().map(|&c| u64::from(c)).sum();
        let used: Vec<(u8, u32)> =
            counts.iter().enumerate().filter(|(_, c)| **c > 0).map(|(t, &c)| (t as u8, c)).collect();
        let scaled = |count: u32| (u64::from(count) << PRECISION).checked_div(total).unwrap_or(0).max(1) as u16;
        let mut frequencies: Vec<u16> = used.iter().map(|&(_, count)| scaled(count)).collect();
        // Rounding down leaves some over; at least 1 for each may have taken too many. The largest one bears both.
        if let Some(largest) = (0..used.len()).max_by_key(|&i| (frequencies[i], std::cmp::Reverse(i))) {
            let others: u32 = frequencies.iter().map(|&f| u32::from(f)).sum::<u32>() - u32::from(frequencies[largest]);
            frequencies[largest] = ((1 << PRECISION) - others.min((1 << PRECISION) - 1)) as u16;
        }
        Self { tokens: used.iter().map(|&(token, _)| token).collect(), frequencies }
    }

    fn write(&self, out: &mut Vec<u8>) {
        out.push(self.tokens.len() as u8);
        for (&token, frequency) in self.tokens.iter().zip(&self.frequencies) {
            out.push(token);
            if self.tokens.len() > 1 {
                out.extend(frequency.to_le_bytes());
            }
        }
    }

    fn read(bytes: &mut Bytes<'_>) -> Result<Self, TableError> {
        let count = bytes.take::<1>()?[0];
        let mut out = Self::default();
        for _ in 0..count {
            out.tokens.push(bytes.take::<1>()?[0]);
            out.frequencies.push(if count == 1 { 1 << PRECISION } else { u16::from_le_bytes(bytes.take::<2>()?) });
        }
        let sum: u32 = out.frequencies.iter().map(|&f| u32::from(f)).sum();
        let ordered = out.tokens.windows(2).all(|pair| pair[0] < pair[1]);
        let known = out.tokens.iter().all(|&token| usize::from(token) < TOKENS);
        let positive = out.frequencies.iter().all(|&f| f > 0);
        if ordered && known && positive && (count == 0 || sum == 1 << PRECISION) {
            Ok(out)
        } else {
            Err(TableError::Frequencies)
        }
    }
}

/// Bytes that are read from the front.
struct Bytes<'a>(&'a [u8]);

impl Bytes<'_> {
    fn take<const N: usize>(&mut self) -> Result<[u8; N], TableError> {
        let (first, rest) = self.0.split_first_chunk::<N>().ok_or(TableError::TooShort)?;
        self.0 = rest;
        Ok(*first)
    }
}

/// Codes integers of at most [`MOST_STEPS`], column by column.
pub(super) fn encode(layout: &Layout<'_>, values: &[i64]) -> Vec<u8> {
    let models = layout.models();
    let mut counts = vec![[0u32; TOKENS]; models * CONTEXTS];
    for (place, &value) in layout.places().zip(values) {
        counts[place][usize::from(token_of(value).0)] += 1;
    }
    let mut out = vec![0; 4];
    let mut tables: Vec<Frequencies> = Vec::new();
    let mut table_of = Vec::with_capacity(counts.len());
    for contexts in counts.chunks(CONTEXTS) {
        let mut sums = [0u32; TOKENS];
        let mut left: u32 = contexts.iter().flatten().sum();
        for context in contexts {
            // All tables are at most 15 a model; a tensor has at most 12 models.
            table_of.push(tables.len() as u8);
            sums.iter_mut().zip(context).for_each(|(sum, count)| *sum += count);
            left -= context.iter().sum::<u32>();
            if sums.iter().sum::<u32>() >= LEAST_TOKENS && left >= LEAST_TOKENS {
                tables.push(Frequencies::of(&std::mem::replace(&mut sums, [0; TOKENS])));
            }
        }
        tables.push(Frequencies::of(&sums));
    }
    out.extend(&table_of);
    out.push(tables.len() as u8);
    tables.iter().for_each(|table| table.write(&mut out));
    let coders: Vec<Option<Coder>> = tables.iter().map(Coder::of).collect();

    let mut bits = BitWriter::default();
    let mut tokens = Vec::with_capacity(values.len());
    for (place, &value) in layout.places().zip(values) {
        let (token, count, low) = token_of(value);
        bits.push(low, count);
        tokens.push((table_of[place], token));
    }
    let mut ans = SmallAnsCoder::new();
    for &(table, token) in tokens.iter().rev() {
        if let Some(coder) = &coders[usize::from(table)] {
            let _ = ans.encode_symbol(coder.index[usize::from(token)], &coder.model);
        }
    }
    let words = ans.into_compressed().unwrap_or_else(|never| match never {});
    out[..4].copy_from_slice(&(words.len() as u32).to_le_bytes());
    out.extend(words.iter().flat_map(|word| word.to_le_bytes()));
    out.extend(bits.finish());
    out
}

/// A table for encoding; a table of one token needs none.
struct Coder {
    model: ContiguousCategoricalEntropyModel<u16, Vec<u16>, PRECISION>,
    /// Index of each token in the table.
    index: [usize; TOKENS],
}

impl Coder {
    fn of(table: &Frequencies) -> Option<Self> {
        if table.tokens.len() < 2 {
            return None;
        }
        let mut index = [0; TOKENS];
        table.tokens.iter().enumerate().for_each(|(i, &token)| index[usize::from(token)] = i);
        let model =
            ContiguousCategoricalEntropyModel::from_nonzero_fixed_point_probabilities(&table.frequencies, false);
        model.ok().map(|model| Self { model, index })
    }
}

/// A table for decoding.
enum Decoder {
    /// No value uses it.
    Unused,
    /// Every value has this token.
    Constant(Base),
    Table(SmallContiguousLookupDecoderModel, Vec<Base>),
}

impl Decoder {
    fn of(table: Frequencies) -> Result<Self, TableError> {
        Ok(match table.tokens[..] {
            [] => Self::Unused,
            [token] => Self::Constant(Base::of(token)),
            _ => {
                let model = SmallContiguousLookupDecoderModel::from_nonzero_fixed_point_probabilities(
                    &table.frequencies,
                    false,
                );
                let bases = table.tokens.iter().map(|&token| Base::of(token)).collect();
                Self::Table(model.map_err(|()| TableError::Frequencies)?, bases)
            }
        })
    }
}

/// Bytes of a payload's tokens and lower bits; `None` for what is no payload. Tokens take
/// their entropy to within 1 %.
pub(super) fn stream_bytes(models: usize, coded: &[u8]) -> Option<[usize; 2]> {
    let mut bytes = Bytes(coded);
    let words = u32::from_le_bytes(bytes.take().ok()?) as usize;
    bytes.0 = bytes.0.get(models * CONTEXTS..)?;
    for _ in 0..bytes.take::<1>().ok()?[0] {
        Frequencies::read(&mut bytes).ok()?;
    }
    let low = bytes.0.len().checked_sub(2 * words)?;
    Some([2 * words, low])
}

/// Consecutive values of a column, as they are decoded.
pub(super) struct Decoded<'a> {
    /// Index of the column.
    pub(super) column: usize,
    /// Row of the first of them.
    pub(super) first_row: usize,
    pub(super) values: &'a [i64],
}

/// Decodes the output of [`encode`]; `put` is called for some values at a time, column by column and row by row.
///
/// # Errors
/// The bytes are not a whole payload of this layout.
pub(super) fn decode(layout: &Layout<'_>, coded: &[u8], mut put: impl FnMut(Decoded<'_>)) -> Result<(), TableError> {
    let mut bytes = Bytes(coded);
    let words = u32::from_le_bytes(bytes.take()?) as usize;
    let mut table_of = Vec::with_capacity(layout.models());
    for _ in 0..layout.models() {
        table_of.push(bytes.take::<CONTEXTS>()?);
    }
    let tables = bytes.take::<1>()?[0];
    let tables: Vec<Decoder> =
        (0..tables).map(|_| Decoder::of(Frequencies::read(&mut bytes)?)).collect::<Result<_, _>>()?;
    if table_of.as_flattened().iter().any(|&table| usize::from(table) >= tables.len()) {
        return Err(TableError::Frequencies);
    }
    let (words, bits) = bytes.0.split_at_checked(2 * words).ok_or(TableError::TooShort)?;
    let words: Vec<u16> = words.as_chunks::<2>().0.iter().map(|&pair| u16::from_le_bytes(pair)).collect();
    // The last word is the state, which is never 0.
    let ans = SmallAnsCoder::from_compressed(words).map_err(|_| TableError::Frequencies)?;
    let mut streams = Streams { ans, bits: BitReader { bytes: bits, held: 0, count: 0 } };
    let mut values = [0; BLOCK];
    for (column, kind) in layout.columns.iter().enumerate() {
        let decoders = table_of[kind.model].map(|table| &tables[usize::from(table)]);
        for first_row in (0..layout.rows).step_by(BLOCK) {
            let values = &mut values[..BLOCK.min(layout.rows - first_row)];
            match kind.contexts {
                None => values.iter_mut().try_for_each(|value| streams.next(decoders[0]).map(|next| *value = next))?,
                Some(contexts) => {
                    let contexts = &contexts[first_row..first_row + values.len()];
                    for (value, &context) in values.iter_mut().zip(contexts) {
                        *value = streams.next(decoders[usize::from(context)])?;
                    }
                }
            }
            put(Decoded { column, first_row, values });
        }
    }
    if !streams.ans.is_empty() || !streams.bits.is_empty() {
        return Err(TableError::TooLong);
    }
    Ok(())
}

/// Values that are decoded together: few enough to stay in the nearest cache.
const BLOCK: usize = 1024;

/// What is left of the two streams.
struct Streams<'a> {
    ans: SmallAnsCoder,
    bits: BitReader<'a>,
}

impl Streams<'_> {
    #[inline(always)]
    fn next(&mut self, decoder: &Decoder) -> Result<i64, TableError> {
        let base = match decoder {
            Decoder::Unused => return Err(TableError::Frequencies),
            Decoder::Constant(base) => *base,
            Decoder::Table(model, bases) => bases[self.ans.decode_symbol(model).map_err(|_| TableError::TooShort)?],
        };
        let low = if base.low == 0 { 0 } else { self.bits.take(base.low).ok_or(TableError::TooShort)? };
        Ok(value_of(base.u | low))
    }
}

#[derive(Default)]
struct BitWriter {
    bytes: Vec<u8>,
    held: u64,
    count: u32,
}

impl BitWriter {
    /// Appends the lowest `count` bits of `value`, at most 48.
    fn push(&mut self, value: u64, count: u32) {
        self.held |= value << self.count;
        self.count += count;
        while self.count >= 8 {
            self.bytes.push(self.held as u8);
            self.held >>= 8;
            self.count -= 8;
        }
    }

    fn finish(mut self) -> Vec<u8> {
        if self.count > 0 {
            self.bytes.push(self.held as u8);
        }
        self.bytes
    }
}

struct BitReader<'a> {
    bytes: &'a [u8],
    held: u64,
    count: u32,
}

impl BitReader<'_> {
    /// The next `count` bits, at most 48; `None` beyond the end.
    #[inline(always)]
    fn take(&mut self, count: u32) -> Option<u64> {
        if self.count < count {
            self.refill(count)?;
        }
        let value = self.held & ((1 << count) - 1);
        self.held >>= count;
        self.count -= count;
        Some(value)
    }

    /// Holds at least `count` bits, and as many whole bytes as there is room for; `None` beyond the end.
    fn refill(&mut self, count: u32) -> Option<()> {
        let room = ((u64::BITS - self.count) / 8) as usize;
        let (more, rest) = self.bytes.split_at(room.min(self.bytes.len()));
        for (i, &byte) in more.iter().enumerate() {
            self.held |= u64::from(byte) << (self.count + 8 * i as u32);
        }
        self.bytes = rest;
        self.count += 8 * more.len() as u32;
        (self.count >= count).then_some(())
    }

    /// Whether no whole byte is left.
    fn is_empty(&self) -> bool {
        self.bytes.is_empty() && self.count < 8
    }
}

/// Bits that the tokens and lower bits of integers take at least: the entropy of the tokens in their contexts, and the lower
/// bits.
#[cfg(test)]
fn entropy_bits(layout: &Layout<'_>, values: &[i64]) -> f64 {
    let mut counts = vec![[0u32; TOKENS]; layout.models() * CONTEXTS];
    let mut bits = 0.0;
    for (place, &value) in layout.places().zip(values) {
        let (token, low, _) = token_of(value);
        counts[place][usize::from(token)] += 1;
        bits += f64::from(low);
    }
    for table in &counts {
        let total: f64 = table.iter().map(|&c| f64::from(c)).sum();
        bits += table.iter().filter(|&&c| c > 0).map(|&c| f64::from(c) * (total / f64::from(c)).log2()).sum::<f64>();
    }
    bits
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::math::rng::Rng;

    fn back(layout: &Layout<'_>, coded: &[u8]) -> Result<Vec<i64>, TableError> {
        let mut out = Vec::new();
        decode(layout, coded, |decoded| {
            assert_eq!(decoded.column * layout.rows + decoded.first_row, out.len());
            out.extend(decoded.values);
        })?;
        Ok(out)
    }

    #[test]
    fn every_integer_has_one_token() {
        let most = MOST_STEPS as i64;
        for value in (-70..70).chain([-most, 1 - most, most - 1, most, 1 << 20, -(1 << 20), 12345, -99999]) {
            let (token, count, low) = token_of(value);
            let base = Base::of(token);
            assert!(usize::from(token) < TOKENS && base.low == count && low < 1 << count, "{value}");
            assert_eq!(value_of(base.u | low), value);
        }
    }

    #[test]
    fn integers_come_back_near_their_entropy() {
        let mut rng = Rng::new(5);
        let rows = 20_000;
        let contexts: Vec<u8> = (0..rows).map(|_| rng.index(CONTEXTS) as u8).collect();
        let kinds = [(0, Some(&contexts[..])), (0, Some(&contexts[..])), (1, None), (2, Some(&contexts[..]))];
        let columns = kinds.map(|(model, contexts)| ColumnKind { model, contexts });
        let layout = Layout { rows, columns: &columns };
        let mut values = Vec::new();
        for column in 0..4 {
            for &context in &contexts {
                // Spread follows the context; the third column is constant, the last one reaches far.
                let spread = (f64::from(context) - 6.0).exp2() * if column == 3 { 1e4 } else { 1.0 };
                values.push(if column == 2 { -7 } else { (rng.normal() * spread).round() as i64 });
            }
        }
        let coded = encode(&layout, &values);
        assert_eq!(back(&layout, &coded).expect("decodes"), values);
        let least = entropy_bits(&layout, &values) / 8.0;
        assert!((coded.len() as f64) < least * 1.01 + 2500.0, "{} {least}", coded.len());
    }

    #[test]
    fn small_and_empty_tables_come_back() {
        for rows in [0, 1, 2, 30] {
            let contexts: Vec<u8> = (0..rows).map(|i| (i % CONTEXTS) as u8).collect();
            let columns = [ColumnKind { model: 0, contexts: Some(&contexts) }, ColumnKind { model: 1, contexts: None }];
            let layout = Layout { rows, columns: &columns };
            let values: Vec<i64> = (0..2 * rows as i64).map(|i| i * i - 40).collect();
            assert_eq!(back(&layout, &encode(&layout, &values)).expect("decodes"), values);
        }
    }

    #[test]
    fn values_of_all_widths_come_back_across_blocks() {
        let mut rng = Rng::new(17);
        let most = MOST_STEPS as i64;
        for rows in [BLOCK - 1, BLOCK, BLOCK + 1, 2 * BLOCK + 1] {
            let contexts: Vec<u8> = (0..rows).map(|_| rng.index(CONTEXTS) as u8).collect();
            let columns = [ColumnKind { model: 0, contexts: Some(&contexts) }, ColumnKind { model: 1, contexts: None }];
            let layout = Layout { rows, columns: &columns };
            // From none to 45 lower bits, one after another: the reader of bits is refilled with any number left.
            let any = |rng: &mut Rng| match rng.index(20) {
                0 => most,
                1 => -most,
                _ => ((rng.normal() * (rng.index(43) as f64).exp2()) as i64).clamp(-most, most),
            };
            let values: Vec<i64> = (0..2 * rows).map(|_| any(&mut rng)).collect();
            assert_eq!(back(&layout, &encode(&layout, &values)).expect("decodes"), values, "{rows}");
        }
    }

    #[test]
    fn more_bytes_than_there_are_values_for_are_refused() {
        let rows = 50;
        let columns = [ColumnKind { model: 0, contexts: None }];
        let layout = Layout { rows, columns: &columns };
        // With lower bits, and without.
        for scale in [1, 1000] {
            let values: Vec<i64> = (0..rows as i64).map(|i| i % 7 * scale).collect();
            let mut coded = encode(&layout, &values);
            for _ in 0..10 {
                coded.push(0);
                assert!(matches!(back(&layout, &coded), Err(TableError::TooLong)));
            }
        }
    }

    #[test]
    fn damaged_bytes_never_panic_and_short_ones_are_refused() {
        let mut rng = Rng::new(9);
        let rows = 700;
        let contexts: Vec<u8> = (0..rows).map(|_| rng.index(CONTEXTS) as u8).collect();
        let columns = [ColumnKind { model: 0, contexts: Some(&contexts) }; 3];
        let layout = Layout { rows, columns: &columns };
        let values: Vec<i64> = (0..3 * rows).map(|_| (rng.normal() * 30.0) as i64).collect();
        let coded = encode(&layout, &values);
        for end in 0..coded.len() {
            assert!(back(&layout, &coded[..end]).is_err(), "{end}");
        }
        for _ in 0..3000 {
            let mut other = coded.clone();
            let at = rng.index(other.len());
            other[at] ^= 1 << rng.index(8);
            if let Ok(values) = back(&layout, &other) {
                assert_eq!(values.len(), 3 * rows);
            }
        }
    }
}
