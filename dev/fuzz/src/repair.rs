//! Checksums and lengths of files that were changed. What cannot be found is left as it is.

use flate2::Crc;
use serde_json::Value;

/// Most bytes that a tensor file is grown to, for a header that claims them.
const MOST_BYTES: usize = 1 << 16;

fn crc_of(bytes: &[u8]) -> u32 {
    let mut crc = Crc::new();
    crc.update(bytes);
    crc.sum()
}

fn little_u32(bytes: &[u8], at: usize) -> Option<usize> {
    bytes.get(at..)?.first_chunk().map(|word| u32::from_le_bytes(*word) as usize)
}

/// Checksums of a PNG's chunks.
pub(crate) fn png(bytes: &mut [u8]) {
    let mut at = 8;
    while let Some(length) = bytes.get(at..).and_then(|rest| rest.first_chunk()).map(|word| u32::from_be_bytes(*word)) {
        let end = at + 8 + length as usize;
        let Some(sum) = bytes.get(at + 4..end).map(crc_of) else { return };
        let Some(place) = bytes.get_mut(end..end + 4) else { return };
        place.copy_from_slice(&sum.to_be_bytes());
        at = end + 4;
    }
}

/// Checksums of the entries of a ZIP archive whose records have no extra fields, in local headers and in the directory.
pub(crate) fn zip(bytes: &mut [u8]) {
    let (mut at, mut sums) = (0, Vec::new());
    while bytes.get(at..).is_some_and(|rest| rest.starts_with(b"PK\x03\x04")) {
        let (Some(length), Some(name)) = (little_u32(bytes, at + 18), little_u32(bytes, at + 26)) else { return };
        let data = at + 30 + (name & 0xffff);
        let Some(sum) = data.checked_add(length).and_then(|end| bytes.get(data..end)).map(crc_of) else { return };
        bytes[at + 14..at + 18].copy_from_slice(&sum.to_le_bytes());
        sums.push(sum);
        at = data + length;
    }
    for sum in sums {
        let Some(record) = bytes.get_mut(at..).filter(|rest| rest.starts_with(b"PK\x01\x02") && rest.len() >= 46)
        else {
            return;
        };
        record[16..20].copy_from_slice(&sum.to_le_bytes());
        at += 46 + usize::from(u16::from_le_bytes([record[28], record[29]]));
    }
}

/// Length of the header of a safetensors file, and the bytes that its tensors need.
pub(crate) fn safetensors(bytes: &mut Vec<u8>) {
    let Some(end) = end_of_object(bytes, 8) else { return };
    // Writers fill the header with spaces up to a multiple of eight.
    let is_filled = |filled: &usize| bytes.get(end..*filled).is_some_and(|fill| fill.iter().all(|&byte| byte == b' '));
    let end = Some(end.next_multiple_of(8)).filter(is_filled).unwrap_or(end);
    bytes[..8].copy_from_slice(&((end - 8) as u64).to_le_bytes());
    let Ok(Value::Object(entries)) = serde_json::from_slice(&bytes[8..end]) else { return };
    let last = |entry: &Value| entry.get("data_offsets")?.get(1)?.as_u64();
    let needed = entries.values().filter_map(last).max().unwrap_or_default();
    if let Some(length) = usize::try_from(needed).ok().filter(|n| *n <= MOST_BYTES) {
        bytes.resize(end + length, 0);
    }
}

/// The same, and the checksum of a checkpoint.
pub(crate) fn checkpoint(bytes: &mut Vec<u8>) {
    const KEY: &[u8] = b"\"checksum\":\"";
    safetensors(bytes);
    let Some(at) = bytes.windows(KEY.len()).position(|window| window == KEY).map(|at| at + KEY.len()) else { return };
    if bytes.len() < at + 8 {
        return;
    }
    bytes[at..at + 8].copy_from_slice(b"00000000");
    let digits = format!("{:08x}", crc_of(bytes));
    bytes[at..at + 8].copy_from_slice(digits.as_bytes());
}

/// The end of the JSON object that begins at `first`.
fn end_of_object(bytes: &[u8], first: usize) -> Option<usize> {
    let (mut depth, mut in_text, mut escaped) = (0usize, false, false);
    for (at, byte) in bytes.iter().enumerate().skip(first) {
        match byte {
            _ if escaped => escaped = false,
            b'\\' if in_text => escaped = true,
            b'"' => in_text = !in_text,
            b'{' if !in_text => depth += 1,
            b'}' if !in_text => {
                depth = depth.checked_sub(1)?;
                if depth == 0 {
                    return Some(at + 1);
                }
            }
            _ => {}
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::seeds;

    /// A byte of the content is changed, which the reader notices; repaired, it is read.
    #[test]
    fn what_is_repaired_is_read() -> Result<(), crate::SeedError> {
        let read = |target: &str| crate::targets::all().into_iter().find(|t| t.name == target).map(|t| t.read);
        let folder = tempfile::tempdir()?;
        let cases = [
            ("checkpoint", seeds::runs::checkpoint(folder.path())?, checkpoint as fn(&mut Vec<u8>)),
            ("sog", seeds::clouds::sog()?, |bytes| zip(bytes)),
        ];
        for (name, good, repair) in cases {
            let read = read(name).ok_or("no such target")?;
            let mut same = good.clone();
            repair(&mut same);
            assert!(same == good && read(&good, folder.path()), "{name}: a whole file changes");
            let mut damaged = good.clone();
            let at = match name {
                // A letter of a file's name in the metadata, and a digit of the version of its writer.
                "sog" => good.windows(7).position(|w| w == b"instgs-").ok_or("no generator")?,
                _ => good.len() - 1,
            };
            damaged[at] ^= 1;
            assert!(!read(&damaged, folder.path()), "{name}: the damage is not noticed");
            repair(&mut damaged);
            assert!(read(&damaged, folder.path()), "{name}: not repaired");
        }
        Ok(())
    }
}
