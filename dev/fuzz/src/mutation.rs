//! Changes of a file: of bits and bytes, of numbers in binary and in text, of pieces.

use instgs_vk::math::rng::Rng;

/// Integers at which readers err: limits of types, and what overflows when it is multiplied.
const INTEGERS: [u64; 18] = [
    0,
    1,
    2,
    0x7f,
    0x80,
    0xff,
    0x100,
    0x7fff,
    0x8000,
    0xffff,
    0x1_0000,
    0x2000_0000,
    0x7fff_ffff,
    0x8000_0000,
    0xffff_ffff,
    0x2000_0000_0000_0000,
    0x7fff_ffff_ffff_ffff,
    u64::MAX,
];
const FLOATS: [f32; 10] =
    [0.0, -0.0, 1e-45, f32::MIN_POSITIVE, 1e30, f32::MAX, f32::MIN, f32::INFINITY, f32::NEG_INFINITY, f32::NAN];
/// What stands in place of a number in text.
const NUMBERS: [&str; 17] = [
    "0",
    "-0.0",
    "-1",
    "1",
    "2",
    "255",
    "65536",
    "4294967295",
    "4294967296",
    "18446744073709551615",
    "-9223372036854775808",
    "1e999",
    "-1e999",
    "1e-400",
    "NaN",
    "null",
    "0.1234567890123456789012345",
];
/// Pieces of the syntaxes of JSON, TOML, PLY and scripts.
const WORDS: [&str; 20] = [
    "[",
    "]",
    "{",
    "}",
    "\"",
    ",",
    ":",
    "\\u0000",
    "\\ud800",
    "null",
    "true",
    "[]",
    "{}",
    "\n",
    "\u{feff}",
    "\u{1b}[2J",
    " ",
    "=",
    "#",
    "../",
];
/// Longest piece that is copied, removed or overwritten.
const PIECE_BYTES: usize = 64;

/// Changes `input` once; `other` is a valid file of the same kind.
pub(crate) fn mutate(input: &mut Vec<u8>, other: &[u8], rng: &mut Rng) {
    if input.is_empty() {
        input.push(rng.next_u32() as u8);
        return;
    }
    match rng.index(16) {
        0 | 1 => {
            let at = rng.index(input.len());
            input[at] ^= 1u8 << rng.index(8);
        }
        2 => {
            let at = rng.index(input.len());
            input[at] = rng.next_u32() as u8;
        }
        3 | 4 => integer(input, rng),
        5 => {
            let value = match rng.chance(0.5) {
                true => FLOATS[rng.index(FLOATS.len())],
                false => f32::from_bits(rng.next_u32()),
            };
            overwrite(input, &value.to_le_bytes(), rng);
        }
        6..=8 => number_in_text(input, rng),
        9 => remove(input, rng),
        10 => {
            let from = piece(input, rng);
            let copied = input[from].to_vec();
            insert(input, &copied, rng);
        }
        11 => insert(input, WORDS[rng.index(WORDS.len())].as_bytes(), rng),
        12 => {
            let bytes: Vec<u8> = (0..1 + rng.index(16)).map(|_| rng.next_u32() as u8).collect();
            insert(input, &bytes, rng);
        }
        13 if !other.is_empty() => {
            let from = piece(other, rng);
            match rng.chance(0.5) {
                true => insert(input, &other[from], rng),
                false => overwrite(input, &other[from], rng),
            }
        }
        14 => {
            let from = piece(input, rng);
            let copied = input[from].to_vec();
            overwrite(input, &copied, rng);
        }
        _ => input.truncate(rng.index(input.len())),
    }
}

/// A place, and at most [`PIECE_BYTES`] from there on; `bytes` has some.
fn piece(bytes: &[u8], rng: &mut Rng) -> std::ops::Range<usize> {
    let first = rng.index(bytes.len());
    let most = (bytes.len() - first).min(PIECE_BYTES);
    first..first + 1 + rng.index(most)
}

fn insert(input: &mut Vec<u8>, bytes: &[u8], rng: &mut Rng) {
    let at = rng.index(input.len() + 1);
    input.splice(at..at, bytes.iter().copied());
}

fn remove(input: &mut Vec<u8>, rng: &mut Rng) {
    let range = piece(input, rng);
    input.drain(range);
}

/// Puts `bytes` over others, as far as they reach.
fn overwrite(input: &mut [u8], bytes: &[u8], rng: &mut Rng) {
    let at = rng.index(input.len());
    input[at..].iter_mut().zip(bytes).for_each(|(to, from)| *to = *from);
}

/// An integer of 1, 2, 4 or 8 bytes becomes one of [`INTEGERS`], or a little more or less than it was.
fn integer(input: &mut [u8], rng: &mut Rng) {
    let size = 1 << rng.index(4);
    let at = rng.index(input.len());
    let Some(place) = input.get_mut(at..at + size) else { return };
    let value = match rng.chance(0.5) {
        true => INTEGERS[rng.index(INTEGERS.len())].wrapping_add(rng.index(3) as u64).wrapping_sub(1),
        false => {
            let mut word = [0; 8];
            word[..size].copy_from_slice(place);
            u64::from_le_bytes(word).wrapping_add(rng.index(33) as u64).wrapping_sub(16)
        }
    };
    let mut word = value.to_le_bytes();
    if rng.chance(0.25) {
        word[..size].reverse();
    }
    place.copy_from_slice(&word[..size]);
}

/// A number that stands as text becomes another: one of [`NUMBERS`], or other digits, as many as before.
fn number_in_text(input: &mut Vec<u8>, rng: &mut Rng) {
    let from = rng.index(input.len());
    let is_digit = |byte: &u8| byte.is_ascii_digit();
    let Some(first) = input[from..].iter().position(is_digit).map(|at| from + at) else { return };
    let digits = input[first..].iter().take_while(|byte| is_digit(byte)).count();
    match rng.chance(0.5) {
        true => input[first..first + digits].iter_mut().for_each(|digit| *digit = b'0' + rng.index(10) as u8),
        false => {
            let number = NUMBERS[rng.index(NUMBERS.len())];
            input.splice(first..first + digits, number.bytes());
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_change_keeps_within_the_bytes_there_are() {
        let mut rng = Rng::new(3);
        for length in [0, 1, 2, 7, 8, 9, 200] {
            for _ in 0..2000 {
                let mut input: Vec<u8> = (0..length).map(|i| b"a1,22.5"[i % 7]).collect();
                mutate(&mut input, &[1, 2, 3], &mut rng);
                assert!(input.len() <= length + PIECE_BYTES, "{length} became {}", input.len());
            }
        }
    }
}
