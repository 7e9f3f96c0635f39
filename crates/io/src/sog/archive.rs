//! ZIP archives, as far as `.sog` files need them: entries that are stored or deflated, without encryption, within 4 GiB.
//!
//! An archive ends with a record of 22 bytes and a comment: signature, two disk numbers (u16), entries (u16, twice), bytes
//! and offset of the directory (u32), length of the comment (u16). The directory has a record per entry, which names the
//! offset of the entry's local header; the data follow that. Entries are written stored, dated 1980-01-01, so that the same
//! files make the same bytes.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::io::Read;
use std::path::Path;

use crate::bytes::{Cursor, MAX_INFLATION};
use crate::error::{IoError, Place};

const LOCAL: u32 = u32::from_le_bytes(*b"PK\x03\x04");
const CENTRAL: u32 = u32::from_le_bytes(*b"PK\x01\x02");
const END: u32 = u32::from_le_bytes(*b"PK\x05\x06");
/// Length of the record at the end, without its comment.
const END_BYTES: usize = 22;
/// Length of a local header and of a directory's record, without names and extra fields.
const LOCAL_BYTES: usize = 30;
const CENTRAL_BYTES: usize = 46;
/// Version of the format that is needed to extract stored entries.
const NEEDED_VERSION: u16 = 20;
/// The date 1980-01-01 in MS-DOS's notation.
const DATE: u16 = 0x21;
const FLAG_ENCRYPTED: u16 = 1;
const STORED: u16 = 0;
const DEFLATED: u16 = 8;
/// One entry of the directory.
struct Entry {
    flags: u16,
    method: u16,
    crc: u32,
    packed_bytes: u32,
    plain_bytes: u32,
    local_header: u32,
}

/// A parsed directory, and the bytes that it describes.
pub(super) struct Archive<'a> {
    bytes: &'a [u8],
    path: &'a Path,
    entries: BTreeMap<&'a [u8], Entry>,
}

impl<'a> Archive<'a> {
    /// Parses the directory; `path` is only used in messages.
    pub(super) fn parse(bytes: &'a [u8], path: &'a Path) -> Result<Self, IoError> {
        let end = end_record(bytes).ok_or_else(|| {
            let what =
                if bytes.starts_with(b"PK") { "is a damaged or truncated ZIP archive" } else { "is no ZIP archive" };
            IoError::damaged(path, format!("{what}: its directory is not at its end"))
        })?;
        let mut cursor = Cursor::new(bytes, path);
        const WHAT: &str = "the end of the archive";
        cursor.take(end + 10, WHAT)?;
        let (count, _bytes, offset) = (cursor.u16(WHAT)?, cursor.u32(WHAT)?, cursor.u32(WHAT)?);
        if count == u16::MAX || offset == u32::MAX {
            return Err(IoError::new(path, "is a ZIP64 archive, which is not read").advise("unpack it"));
        }
        let mut cursor = Cursor::new(bytes, path);
        cursor.take(offset as usize, "the archive's directory")?;
        let mut entries = BTreeMap::new();
        for _ in 0..count {
            let (name, entry) = central_record(&mut cursor)?;
            entries.insert(name, entry);
        }
        Ok(Self { bytes, path, entries })
    }

    /// The contents of a file.
    ///
    /// # Errors
    /// The file is not there, is damaged, or packed in another way.
    pub(super) fn file(&self, name: &str) -> Result<Cow<'a, [u8]>, IoError> {
        let fail = |what: String| IoError::new(self.path, what).at(Place::Field(name.to_owned()));
        let entry = self.entries.get(name.as_bytes()).ok_or_else(|| fail("is not in the archive".into()))?;
        if entry.flags & FLAG_ENCRYPTED != 0 {
            return Err(fail("is encrypted".into()));
        }
        let packed = self.packed(entry)?;
        let plain_bytes = u64::from(entry.plain_bytes);
        let plain = match entry.method {
            STORED => Cow::Borrowed(packed),
            DEFLATED if plain_bytes <= packed.len() as u64 * MAX_INFLATION => {
                let mut plain = Vec::new();
                // At most one byte more than expected is read.
                let inflated =
                    flate2::bufread::DeflateDecoder::new(packed).take(plain_bytes + 1).read_to_end(&mut plain);
                inflated.map_err(|e| fail(format!("is damaged: {e}")))?;
                Cow::Owned(plain)
            }
            DEFLATED => return Err(fail(format!("claims {plain_bytes} bytes in {}", packed.len()))),
            other => return Err(fail(format!("is packed by method {other}, only 0 and 8 are read"))),
        };
        if plain.len() as u64 != plain_bytes || checksum(&plain) != entry.crc {
            return Err(fail("is damaged: length or checksum is wrong".into()));
        }
        Ok(plain)
    }

    /// The bytes of an entry as they are in the archive.
    fn packed(&self, entry: &Entry) -> Result<&'a [u8], IoError> {
        const WHAT: &str = "an entry's local header";
        let mut cursor = Cursor::new(self.bytes, self.path);
        cursor.take(entry.local_header as usize, WHAT)?;
        if cursor.u32(WHAT)? != LOCAL {
            return Err(cursor.error("the directory does not name an entry's local header"));
        }
        cursor.take(LOCAL_BYTES - 8, WHAT)?;
        let (name, extra) = (cursor.u16(WHAT)?, cursor.u16(WHAT)?);
        cursor.take(usize::from(name) + usize::from(extra), WHAT)?;
        cursor.take(entry.packed_bytes as usize, "an entry")
    }
}

/// Offset of the record at the end, whose comment must reach to the end.
fn end_record(bytes: &[u8]) -> Option<usize> {
    let last = bytes.len().checked_sub(END_BYTES)?;
    let first = last.saturating_sub(usize::from(u16::MAX));
    let is_end = |&at: &usize| {
        let record = bytes.get(at..at + END_BYTES).unwrap_or_default();
        record.starts_with(&END.to_le_bytes())
            && record.last_chunk().is_some_and(|&comment| usize::from(u16::from_le_bytes(comment)) == last - at)
    };
    (first..=last).rev().find(is_end)
}

/// Name and entry of the directory's next record.
fn central_record<'a>(cursor: &mut Cursor<'a>) -> Result<(&'a [u8], Entry), IoError> {
    const WHAT: &str = "the archive's directory";
    if cursor.u32(WHAT)? != CENTRAL {
        return Err(cursor.error("is no record of the archive's directory"));
    }
    // Two versions; later time and date, and later disk number and attributes.
    cursor.take(4, WHAT)?;
    let (flags, method) = (cursor.u16(WHAT)?, cursor.u16(WHAT)?);
    cursor.take(4, WHAT)?;
    let (crc, packed_bytes, plain_bytes) = (cursor.u32(WHAT)?, cursor.u32(WHAT)?, cursor.u32(WHAT)?);
    let [name, extra, comment] = [cursor.u16(WHAT)?, cursor.u16(WHAT)?, cursor.u16(WHAT)?].map(usize::from);
    cursor.take(8, WHAT)?;
    let local_header = cursor.u32(WHAT)?;
    let name = cursor.take(name, WHAT)?;
    cursor.take(extra + comment, WHAT)?;
    Ok((name, Entry { flags, method, crc, packed_bytes, plain_bytes, local_header }))
}

fn checksum(bytes: &[u8]) -> u32 {
    let mut crc = flate2::Crc::new();
    crc.update(bytes);
    crc.sum()
}

/// An archive of stored files, in order; `None` if it would exceed 4 GiB or have too many files.
pub(super) fn stored(files: &[(&str, Vec<u8>)]) -> Option<Vec<u8>> {
    let beside = |name: &str| LOCAL_BYTES + CENTRAL_BYTES + 2 * name.len();
    let total = END_BYTES + files.iter().map(|(name, data)| beside(name) + data.len()).sum::<usize>();
    u32::try_from(total).ok().filter(|&total| total < u32::MAX)?;
    let count = u16::try_from(files.len()).ok().filter(|&count| count < u16::MAX)?;
    let mut out = Vec::with_capacity(total);
    let mut directory = Vec::new();
    for (name, data) in files {
        let offset = out.len() as u32;
        // What both headers have: version, flags, method, time, date, checksum, two lengths, length of the name.
        let mut common = Vec::new();
        for word in [NEEDED_VERSION, 0, STORED, 0, DATE] {
            common.extend_from_slice(&word.to_le_bytes());
        }
        for word in [checksum(data), data.len() as u32, data.len() as u32] {
            common.extend_from_slice(&word.to_le_bytes());
        }
        common.extend_from_slice(&(name.len() as u16).to_le_bytes());
        out.extend_from_slice(&LOCAL.to_le_bytes());
        out.extend_from_slice(&common);
        out.extend_from_slice(&0u16.to_le_bytes());
        out.extend_from_slice(name.as_bytes());
        out.extend_from_slice(data);
        directory.extend_from_slice(&CENTRAL.to_le_bytes());
        directory.extend_from_slice(&NEEDED_VERSION.to_le_bytes());
        directory.extend_from_slice(&common);
        // Lengths of extra field and comment, disk number, attributes.
        directory.extend_from_slice(&[0; 12]);
        directory.extend_from_slice(&offset.to_le_bytes());
        directory.extend_from_slice(name.as_bytes());
    }
    let (offset, bytes) = (out.len() as u32, directory.len() as u32);
    out.extend_from_slice(&directory);
    out.extend_from_slice(&END.to_le_bytes());
    for word in [0, 0, count, count] {
        out.extend_from_slice(&word.to_le_bytes());
    }
    for word in [bytes, offset] {
        out.extend_from_slice(&word.to_le_bytes());
    }
    out.extend_from_slice(&0u16.to_le_bytes());
    Some(out)
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;

    fn sample() -> Vec<u8> {
        stored(&[("a.txt", b"hello".to_vec()), ("b", Vec::new()), ("c/d", vec![7; 300])]).unwrap()
    }

    fn read(bytes: &[u8], name: &str) -> Result<Vec<u8>, IoError> {
        Archive::parse(bytes, Path::new("x.zip"))?.file(name).map(Cow::into_owned)
    }

    #[test]
    fn what_is_stored_is_read() {
        let bytes = sample();
        assert_eq!(read(&bytes, "a.txt"), Ok(b"hello".to_vec()));
        assert_eq!(read(&bytes, "b"), Ok(Vec::new()));
        assert_eq!(read(&bytes, "c/d"), Ok(vec![7; 300]));
        assert!(read(&bytes, "e").is_err_and(|e| e.to_string().contains("x.zip: e: is not in the archive")));
        assert!(read(b"hello", "e").is_err_and(|e| e.to_string().contains("is no ZIP archive")));
        assert_eq!(read(&stored(&[]).unwrap(), "a").map_err(|e| e.what), Err("is not in the archive".into()));
    }

    /// The same entry deflated, with a comment behind the archive.
    #[test]
    fn deflated_entries_and_comments_are_read() -> std::io::Result<()> {
        let plain = b"again and again and again and again".repeat(9);
        let mut encoder = flate2::write::DeflateEncoder::new(Vec::new(), flate2::Compression::default());
        encoder.write_all(&plain)?;
        let mut bytes = stored(&[("a", encoder.finish()?)]).unwrap();
        let directory = bytes.len() - END_BYTES - CENTRAL_BYTES - 1;
        bytes[directory + 10] = 8;
        bytes[directory + 16..][..4].copy_from_slice(&checksum(&plain).to_le_bytes());
        bytes[directory + 24..][..4].copy_from_slice(&(plain.len() as u32).to_le_bytes());
        assert_eq!(read(&bytes, "a"), Ok(plain));
        let end = bytes.len() - 2;
        bytes[end] = 3;
        bytes.extend_from_slice(b"abc");
        assert!(read(&bytes, "a").is_ok());
        // More than the data hold, and more than Deflate can.
        bytes[directory + 24] ^= 1;
        assert!(read(&bytes, "a").is_err_and(|e| e.to_string().contains("checksum")));
        bytes[directory + 26] = 0xff;
        assert!(read(&bytes, "a").is_err_and(|e| e.to_string().contains("claims")));
        Ok(())
    }

    #[test]
    fn damage_is_an_error() {
        let bytes = sample();
        for end in 0..bytes.len() {
            assert!(read(&bytes[..end], "a.txt").is_err(), "cut to {end}");
        }
        for at in 0..bytes.len() {
            let mut damaged = bytes.clone();
            damaged[at] ^= 0xff;
            // Another name, date or version, or another entry's data: never other data.
            if let Ok(data) = read(&damaged, "a.txt") {
                assert_eq!(data, b"hello", "byte {at}");
            }
        }
        let mut secret = bytes.clone();
        let directory = bytes.windows(4).position(|w| w == CENTRAL.to_le_bytes()).unwrap();
        secret[directory + 8] = 1;
        assert!(read(&secret, "a.txt").is_err_and(|e| e.to_string().contains("encrypted")));
        secret[directory + 8] = 0;
        secret[directory + 10] = 93;
        assert!(read(&secret, "a.txt").is_err_and(|e| e.to_string().contains("method 93")));
    }
}
