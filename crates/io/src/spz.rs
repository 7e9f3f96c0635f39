//! `.spz` (Niantic): quantised, compressed clouds. Reads versions 1 to 4; `spz_write.rs` writes version 4.
//!
//! Containers: versions 1-3 are one gzip stream of a 16-byte header and the attribute arrays (a bare, uncompressed
//! stream is accepted too). Version 4 has a bare 32-byte header, a table of contents of (compressed, uncompressed) sizes
//! at the offset that the header names, and one zstd frame per non-empty attribute array. The arrays, in order:
//! positions, alphas, colours, scales, rotations, SH.
//!
//! Axes: SPZ is right-up-back unless an extension names others (`spz_axes.rs`), scenes here are right-down-front like
//! INRIA's `.ply`; reading and writing rotate positions, rotations and SH by 180 degrees about x, as the reference
//! implementation does between SPZ and PLY.
//!
//! Limits: SH of degree 4 (version 4) are truncated to degree 3. Of the vendor extensions only that of the axes is used.
//! Opacity bytes 0 and 255 get finite logits. Writing keeps 5 bits of SH degree 1 and 4 bits of the higher degrees, as the
//! reference implementation does, and clamps SH to -1..1, the range of the format.

use std::io::Read;
use std::path::Path;

use crate::bytes::Cursor;
use crate::error::{BY_ENDING, IoError, Place};
use crate::host_memory::{available_bytes, check_reading};
use crate::plausible::{AS_PLY, most_gaussians};
use crate::spz_axes::Extensions;
use crate::spz_codec::{self, Layout};
use crate::{cut_note, read_bytes};
use instgs_vk::scene::gaussians::Gaussians;

pub use crate::spz_write::{Clamped, SpzLoss, spz_bytes, write_spz};

const MAGIC: u32 = u32::from_le_bytes(*b"NGSP");
/// Flag of clouds that were trained with opacity compensation.
pub(crate) const FLAG_ANTIALIAS: u8 = 1;
const FLAG_EXTENSIONS: u8 = 2;
/// Upper limit on the compression of gzip: Deflate reaches about 1032:1.
const MAX_GZIP_RATIO: u64 = 1040;
const HEADER_BYTES: usize = 16;
/// Length of the header of version 4.
pub(crate) const HEADER_BYTES_V4: usize = 32;
/// Upper limit on the extensions after the arrays of versions 1 to 3; those that are known have up to a hundred bytes.
const MAX_EXTENSION_BYTES: u64 = 1 << 16;
/// Upper limit on bytes behind them that are read to reach the end of the gzip stream.
const MAX_TRAILER_BYTES: u64 = 64 << 20;

/// The contents of an `.spz` file.
#[derive(Clone, Debug, PartialEq)]
pub struct SpzCloud {
    /// The Gaussians, in right-down-front axes.
    pub gaussians: Gaussians,
    /// Whether the cloud was trained with opacity compensation.
    pub antialias: bool,
    /// Notes for the user, one line each.
    pub notes: Vec<String>,
}

/// Reads an `.spz` file of version 1 to 4.
///
/// # Errors
/// The file cannot be read, is damaged, has another version, or takes more memory than is available.
pub fn read_spz(path: &Path) -> Result<SpzCloud, IoError> {
    parse_spz(&read_bytes(path)?, path)
}

/// Parses the bytes of an `.spz` file; `path` is only used in messages.
pub fn parse_spz(bytes: &[u8], path: &Path) -> Result<SpzCloud, IoError> {
    parse_within(bytes, available_bytes(), path)
}

/// The same with so many bytes of memory; `None` if it is unknown how many there are.
fn parse_within(bytes: &[u8], memory: Option<u64>, path: &Path) -> Result<SpzCloud, IoError> {
    if bytes.starts_with(&[0x1f, 0x8b]) {
        let broken =
            |e: std::io::Error| IoError::damaged(path, format!("the gzip stream is damaged or truncated: {e}"));
        let mut stream = flate2::bufread::GzDecoder::new(bytes);
        let mut plain = Vec::new();
        stream.by_ref().take(HEADER_BYTES as u64).read_to_end(&mut plain).map_err(broken)?;
        let header = Header::parse(&mut Cursor::new(&plain, path), path)?;
        let need = header.layout().total_bytes();
        if need > (bytes.len() as u64).saturating_mul(MAX_GZIP_RATIO) {
            return Err(header.too_many(bytes.len(), path));
        }
        header.check_count(bytes.len(), path)?;
        header.check_memory(need, memory, path)?;
        stream.by_ref().take(need.saturating_add(MAX_EXTENSION_BYTES)).read_to_end(&mut plain).map_err(broken)?;
        // Reading on to the end makes the decoder verify the stream's checksum.
        std::io::copy(&mut stream.take(MAX_TRAILER_BYTES), &mut std::io::sink()).map_err(broken)?;
        return arrays_in_one_piece(&header, &plain[HEADER_BYTES..], path);
    }
    if !bytes.starts_with(b"NGSP") {
        return Err(
            IoError::new(path, "is not an SPZ file: neither gzip nor the letters NGSP at its start").advise(BY_ENDING)
        );
    }
    let mut cursor = Cursor::new(bytes, path);
    let header = Header::parse(&mut cursor, path)?;
    if header.version >= 4 {
        return streams(&header, bytes, memory, path);
    }
    let body = &bytes[HEADER_BYTES..];
    // What ends early is refused for that, below.
    if header.layout().total_bytes() <= body.len() as u64 {
        header.check_memory(0, memory, path)?;
    }
    arrays_in_one_piece(&header, body, path)
}

struct Header {
    version: u32,
    splats: u32,
    sh_degree: u8,
    fractional_bits: u8,
    flags: u8,
    /// Number of streams in version 4, otherwise reserved.
    streams: u8,
}

impl Header {
    fn parse(cursor: &mut Cursor<'_>, path: &Path) -> Result<Self, IoError> {
        if cursor.u32("the SPZ header")? != MAGIC {
            let error = IoError::new(path, "is not an SPZ file: the data does not start with NGSP").at(Place::Byte(0));
            return Err(error.advise(BY_ENDING));
        }
        let version = cursor.u32("the SPZ header")?;
        let splats = cursor.u32("the SPZ header")?;
        let byte = |c: &mut Cursor<'_>| c.u8("the SPZ header");
        let (sh_degree, fractional_bits) = (byte(cursor)?, byte(cursor)?);
        let (flags, streams) = (byte(cursor)?, byte(cursor)?);
        let field = |name: &str, what: String| IoError::damaged(path, what).at(Place::Field(name.into()));
        if !(1..=4).contains(&version) {
            let error = field("version", format!("SPZ version {version} is not known, only 1 to 4"));
            return Err(error.advise("have its program write one of these, or a .ply"));
        }
        if sh_degree > 4 {
            return Err(field("shDegree", format!("SH degree {sh_degree} is not known, only 0 to 4")));
        }
        if fractional_bits > 30 {
            let what = format!("{fractional_bits} fractional bits do not fit the 24-bit positions");
            return Err(field("fractionalBits", what));
        }
        Ok(Self { version, splats, sh_degree, fractional_bits, flags, streams })
    }

    fn layout(&self) -> Layout {
        Layout::new(self.version, self.splats, self.sh_degree)
    }

    fn too_many(&self, file_bytes: usize, path: &Path) -> IoError {
        let what = format!("the header claims {} splats, more than {file_bytes} bytes can hold", self.splats);
        IoError::damaged(path, what).at(Place::Field("numPoints".into()))
    }

    /// Checks that so many splats are plausible in a file of so many bytes.
    fn check_count(&self, file_bytes: usize, path: &Path) -> Result<(), IoError> {
        if u64::from(self.splats) > most_gaussians(file_bytes as u64) {
            let what =
                format!("the header claims {} splats in {file_bytes} bytes, more than is plausible", self.splats);
            return Err(IoError::new(path, what).at(Place::Field("numPoints".into())).advise(AS_PLY));
        }
        Ok(())
    }

    /// Checks memory for arrays of so many bytes, which are unpacked first, and for the Gaussians.
    fn check_memory(&self, unpacked_bytes: u64, memory: Option<u64>, path: &Path) -> Result<(), IoError> {
        check_reading(path, "takes", unpacked_bytes.saturating_add(self.layout().gaussians_bytes()), memory)
    }

    /// Decodes the arrays; `extensions` are the bytes where extensions are, if the header says that there are any.
    fn decode(&self, arrays: &[&[u8]; 6], extensions: &[u8]) -> SpzCloud {
        let Extensions { axes, notes: extension_notes } =
            if self.flags & FLAG_EXTENSIONS != 0 { Extensions::parse(extensions) } else { Extensions::default() };
        let gaussians = spz_codec::decode(&self.layout(), u32::from(self.fractional_bits), axes, arrays);
        let notes = cut_note(u32::from(self.sh_degree)).into_iter().chain(extension_notes).collect();
        SpzCloud { gaussians, antialias: self.flags & FLAG_ANTIALIAS != 0, notes }
    }
}

/// Reads versions 1 to 3, whose arrays are concatenated.
fn arrays_in_one_piece(header: &Header, body: &[u8], path: &Path) -> Result<SpzCloud, IoError> {
    let layout = header.layout();
    let need = layout.total_bytes();
    if need > body.len() as u64 {
        let what = format!(
            "ends early: {} splats need {need} bytes after the header, {} are there",
            header.splats,
            body.len()
        );
        return Err(IoError::damaged(path, what).at(Place::Byte((HEADER_BYTES + body.len()) as u64)));
    }
    let mut rest = body;
    let arrays = layout.array_bytes().map(|n| {
        let (array, tail) = rest.split_at(n as usize);
        rest = tail;
        array
    });
    Ok(header.decode(&arrays, rest))
}

/// Reads version 4: a table of contents and zstd frames.
fn streams(header: &Header, bytes: &[u8], memory: Option<u64>, path: &Path) -> Result<SpzCloud, IoError> {
    header.check_count(bytes.len(), path)?;
    header.check_memory(header.layout().total_bytes(), memory, path)?;
    let mut cursor = Cursor::new(bytes, path);
    cursor.take(HEADER_BYTES, "the SPZ header")?;
    let toc = cursor.u32("the SPZ header")? as usize;
    if toc < HEADER_BYTES_V4 {
        let what = format!("the table of contents at byte {toc} lies within the header");
        return Err(IoError::damaged(path, what).at(Place::Field("tocByteOffset".into())));
    }
    cursor.take(HEADER_BYTES_V4 - cursor.position(), "the SPZ header")?;
    let extensions = cursor.take(toc - HEADER_BYTES_V4, "the part before the table of contents")?;
    let sizes = header.layout().array_bytes();
    let present = sizes.iter().filter(|&&n| n > 0).count();
    if present != usize::from(header.streams) {
        let what =
            format!("{} streams, where {} splats of this SH degree have {present}", header.streams, header.splats);
        return Err(IoError::damaged(path, what).at(Place::Field("numStreams".into())));
    }
    let mut packed_sizes = [0usize; 6];
    for (i, &size) in sizes.iter().enumerate().filter(|&(_, &n)| n > 0) {
        let packed = cursor.u64("the table of contents")?;
        let plain = cursor.u64("the table of contents")?;
        if plain != size {
            return Err(cursor.error(format!("stream {i} holds {plain} bytes, but the header's counts require {size}")));
        }
        packed_sizes[i] =
            usize::try_from(packed).map_err(|_| cursor.error(format!("stream {i} has {packed} bytes")))?;
    }
    let mut arrays: [Vec<u8>; 6] = Default::default();
    for i in 0..6 {
        if sizes[i] == 0 {
            continue;
        }
        let start = cursor.position();
        let packed = cursor.take(packed_sizes[i], &format!("stream {i}"))?;
        let broken = |what: String| IoError::damaged(path, format!("stream {i} {what}")).at(Place::Byte(start as u64));
        // The buffer grows with the actual output, and at most one byte more than expected is read.
        let read = zstd::stream::read::Decoder::with_buffer(packed)
            .and_then(|d| d.take(sizes[i].saturating_add(1)).read_to_end(&mut arrays[i]));
        read.map_err(|e| broken(format!("is damaged: {e}")))?;
        if arrays[i].len() as u64 != sizes[i] {
            return Err(broken(format!("does not unpack to the {} bytes that the table of contents names", sizes[i])));
        }
    }
    Ok(header.decode(&arrays.each_ref().map(Vec::as_slice), extensions))
}

#[cfg(test)]
mod tests {
    use std::io::Write;

    use super::*;
    use instgs_samples::sample;

    fn parse(bytes: &[u8]) -> Result<SpzCloud, IoError> {
        parse_spz(bytes, Path::new("test.spz"))
    }

    /// An uncompressed file of version 3 with the given flags, and the cloud's arrays with 12 fractional bits.
    fn version_3(cloud: &Gaussians, flags: u8) -> Vec<u8> {
        let mut out = b"NGSP".to_vec();
        out.extend_from_slice(&3u32.to_le_bytes());
        out.extend_from_slice(&(cloud.len() as u32).to_le_bytes());
        out.extend_from_slice(&[cloud.sh_degree as u8, 12, flags, 0]);
        spz_codec::encode(cloud, 12).iter().for_each(|array| out.extend_from_slice(array));
        out
    }

    fn gzipped(plain: &[u8]) -> Result<Vec<u8>, IoError> {
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
        let written = encoder.write_all(plain).and_then(|()| encoder.finish());
        written.map_err(|e| IoError::os(Path::new("x"), "gzip", &e))
    }

    /// The extension that names axes.
    fn axes_record(number: u32) -> Vec<u8> {
        [0xADBE_0003, 4, number].iter().flat_map(|word: &u32| word.to_le_bytes()).collect()
    }

    #[test]
    fn version_3_is_read_with_and_without_gzip() -> Result<(), IoError> {
        let cloud = sample(2, 40);
        let plain = version_3(&cloud, FLAG_ANTIALIAS);
        let [bare, packed] = [parse(&plain)?, parse(&gzipped(&plain)?)?];
        assert_eq!(bare, packed);
        assert!(bare.antialias && bare.notes.is_empty());
        let near = |(a, b): (&f32, &f32)| (a - b).abs() < 0.5 / 4096.0 + 1e-6;
        assert!(bare.gaussians.means.as_flattened().iter().zip(cloud.means.as_flattened()).all(near));
        let whole = gzipped(&plain)?;
        assert!((0..whole.len()).all(|end| parse(&whole[..end]).is_err()));
        Ok(())
    }

    /// The axes of the scene itself: the arrays are the same as right-up-back, so the cloud comes out turned about x.
    #[test]
    fn extensions_name_the_axes_in_every_version() -> Result<(), IoError> {
        let cloud = sample(1, 9);
        let usual = parse(&version_3(&cloud, 0))?.gaussians;
        let old = [version_3(&cloud, FLAG_EXTENSIONS), axes_record(6)].concat();
        let mut new = spz_bytes(&cloud, false, Path::new("x.spz"))?;
        new[14] |= FLAG_EXTENSIONS;
        new[16] += 12;
        let new = [&new[..HEADER_BYTES_V4], &axes_record(6)[..], &new[HEADER_BYTES_V4..]].concat();
        for bytes in [gzipped(&old)?, old, new] {
            let SpzCloud { gaussians, notes, .. } = parse(&bytes)?;
            assert!(notes.is_empty(), "{notes:?}");
            for (a, b) in gaussians.means.iter().zip(&usual.means) {
                assert!((0..3).all(|k| (a[k] - [1.0, -1.0, -1.0][k] * b[k]).abs() < 3e-4), "{a:?} {b:?}");
            }
            assert_eq!(gaussians.sh_of(0)[1], usual.sh_of(0)[1].map(|v| -v));
        }
        let unknown = [version_3(&cloud, FLAG_EXTENSIONS), vec![9; 20]].concat();
        assert_eq!(parse(&unknown)?.notes.len(), 1);
        Ok(())
    }

    /// Whatever the container: a few bytes may stand for many.
    #[test]
    fn memory_is_checked_before_anything_is_unpacked() -> Result<(), IoError> {
        let cloud = sample(1, 3000);
        let bare = version_3(&cloud, 0);
        let of_gaussians = 3000 * 4 * (11 + 3 * 4);
        let of_arrays = bare.len() as u64 - HEADER_BYTES as u64;
        let packed = gzipped(&bare)?;
        let streams = spz_bytes(&cloud, false, Path::new("x.spz"))?;
        for (bytes, need) in
            [(&bare, of_gaussians), (&packed, of_arrays + of_gaussians), (&streams, of_arrays + of_gaussians)]
        {
            assert_eq!(parse_within(bytes, Some(need), Path::new("x"))?, parse_within(bytes, None, Path::new("x"))?);
            let text = parse_within(bytes, Some(need - 1), Path::new("x")).err().map(|e| e.to_string());
            assert!(text.is_some_and(|text| text.contains("MiB are available; close other programs")), "{need}");
            // What ends early is refused for its size before it is unpacked; without compression its length is known.
            let cut = &bytes[..bytes.len() - 1];
            let damaged = parse_within(cut, Some(9), Path::new("x")).err().map(|e| e.to_string()).unwrap_or_default();
            assert_eq!(damaged.contains("are available"), *bytes != bare, "{damaged}");
        }
        Ok(())
    }

    #[test]
    fn counts_beyond_the_file_are_refused() -> Result<(), IoError> {
        let mut raw = b"NGSP".to_vec();
        raw.extend_from_slice(&2u32.to_le_bytes());
        raw.extend_from_slice(&u32::MAX.to_le_bytes());
        raw.extend_from_slice(&[3, 12, 0, 0]);
        raw.resize(200, 0);
        assert!(parse(&raw).is_err_and(|e| e.to_string().contains("ends early")));
        assert!(parse(&gzipped(&raw)?).is_err_and(|e| e.to_string().contains("claims 4294967295")));
        raw[4] = 4;
        assert!(parse(&raw).is_err_and(|e| e.to_string().contains("claims 4294967295")));
        Ok(())
    }
}
