//! Bytes as text of digits to base 85, a quarter longer: `web/base85.js` reads it.

/// Without characters that HTML or JavaScript give a meaning.
const DIGITS: &[u8; 85] = b"0123456789ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz!#$%()*+,-./:;=?@[]^_{|";

/// Four bytes are five digits, the highest first; n bytes that are left over are the first n + 1 digits of the group that zeros
/// fill up.
pub(super) fn base85(bytes: &[u8]) -> String {
    let mut out = String::with_capacity(bytes.len().div_ceil(4) * 5);
    for group in bytes.chunks(4) {
        let mut word = [0; 4];
        word[..group.len()].copy_from_slice(group);
        let value = u32::from_be_bytes(word);
        let digits = [4, 3, 2, 1, 0].map(|power| char::from(DIGITS[(value / 85u32.pow(power) % 85) as usize]));
        out.extend(&digits[..=group.len()]);
    }
    out
}

/// The bytes of a text of digits, as `base85.js` has them.
#[cfg(test)]
pub(super) fn bytes_of_base85(text: &str) -> Vec<u8> {
    let digits: Vec<u64> = text.bytes().map(|c| DIGITS.iter().position(|&d| d == c).expect("a digit") as u64).collect();
    let mut out = Vec::new();
    for group in digits.chunks(5) {
        let value = (0..5).fold(0, |sum, i| sum * 85 + group.get(i).copied().unwrap_or(84));
        out.extend(&(value as u32).to_be_bytes()[..group.len() - 1]);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn bytes_of_any_length_come_back() {
        for length in 0..40u8 {
            for start in [0, 1, 120, 250, 255] {
                let bytes: Vec<u8> = (0..length).map(|i| u8::wrapping_add(start, i.wrapping_mul(i))).collect();
                assert_eq!(bytes_of_base85(&base85(&bytes)), bytes);
            }
        }
        assert_eq!(bytes_of_base85(&base85(&[255; 7])), [255; 7]);
    }

    #[test]
    fn digits_differ_and_mean_nothing_elsewhere() {
        let mut sorted = DIGITS.to_vec();
        sorted.sort_unstable();
        sorted.dedup();
        assert_eq!(sorted.len(), 85);
        assert!(DIGITS.iter().all(|d| d.is_ascii_graphic() && !b"<>&\"'\\`".contains(d)));
        assert!(include_str!("../../web/base85.js").contains(std::str::from_utf8(DIGITS).expect("ASCII")));
    }
}
