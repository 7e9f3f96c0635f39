//! `.spz` (Niantic): quantised, compressed clouds. Reads versions 1 to 4, writes version 3.
//!
//! Containers: versions 1-3 are one gzip stream of a 16-byte header and the attribute arrays (a bare, uncompressed
//! stream is accepted too). Version 4 has a bare 32-byte header, a table of contents of (compressed, uncompressed) sizes
//! at the offset that the header names, and one zstd frame per non-empty attribute array. The arrays, in order:
//! positions, alphas, colours, scales, rotations, SH.
//!
//! Axes: SPZ is right-up-back, scenes here are right-down-front like INRIA's `.ply`; reading and writing rotate
//! positions, rotations and SH by 180 degrees about x, as the reference implementation does between SPZ and PLY.
//!
//! Limits: SH of degree 4 (version 4) are truncated to degree 3. Vendor extensions are skipped. Opacity bytes 0 and 255
//! get finite logits. Writing keeps 5 bits of SH degree 1 and 4 bits of the higher degrees, as the reference
//! implementation does, and clamps SH to -1..1, the range of the format.

use std::io::{Read, Write};
use std::path::Path;

use crate::bytes::Cursor;
use crate::error::{IoError, Place};
use crate::spz_codec::{self, Layout};
use crate::{atomic_write, cut_note, read_bytes};
use instgs_vk::scene::gaussians::{Gaussians, MAX_SH_DEGREE};

const MAGIC: u32 = u32::from_le_bytes(*b"NGSP");
const FLAG_ANTIALIAS: u8 = 1;
const FLAG_EXTENSIONS: u8 = 2;
/// Upper limit on the compression of gzip: Deflate reaches about 1032:1.
const MAX_GZIP_RATIO: u64 = 1040;
/// Positions alone take 9 bytes per splat, and no real stream is compressed 1024:1: the reference implementation
/// rejects more as well.
const MAX_SPLATS_PER_BYTE: u64 = 1024 / 9;
const HEADER_BYTES: usize = 16;
const HEADER_BYTES_V4: usize = 32;
/// Upper limit on bytes after the arrays (extensions) that are read to reach the end of the gzip stream.
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
/// The file cannot be read, is damaged, or has another version.
pub fn read_spz(path: &Path) -> Result<SpzCloud, IoError> {
    parse_spz(&read_bytes(path)?, path)
}

/// Parses the bytes of an `.spz` file; `path` is only used in messages.
pub fn parse_spz(bytes: &[u8], path: &Path) -> Result<SpzCloud, IoError> {
    if bytes.starts_with(&[0x1f, 0x8b]) {
        let broken = |e: std::io::Error| IoError::new(path, format!("the gzip stream is damaged or truncated: {e}"));
        let mut stream = flate2::bufread::GzDecoder::new(bytes);
        let mut plain = Vec::new();
        stream.by_ref().take(HEADER_BYTES as u64).read_to_end(&mut plain).map_err(broken)?;
        let header = Header::parse(&mut Cursor::new(&plain, path), path)?;
        let need = header.layout().total_bytes();
        if need > (bytes.len() as u64).saturating_mul(MAX_GZIP_RATIO) {
            return Err(header.too_many(bytes.len(), path));
        }
        stream.by_ref().take(need).read_to_end(&mut plain).map_err(broken)?;
        // Reading on to the end makes the decoder verify the stream's checksum.
        std::io::copy(&mut stream.take(MAX_TRAILER_BYTES), &mut std::io::sink()).map_err(broken)?;
        return arrays_in_one_piece(&header, &plain[HEADER_BYTES..], path);
    }
    if !bytes.starts_with(b"NGSP") {
        return Err(IoError::new(path, "is not an SPZ file: neither gzip nor the letters NGSP at its start"));
    }
    let mut cursor = Cursor::new(bytes, path);
    let header = Header::parse(&mut cursor, path)?;
    if header.version >= 4 {
        streams(&header, bytes, path)
    } else {
        arrays_in_one_piece(&header, &bytes[HEADER_BYTES..], path)
    }
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
            return Err(IoError::new(path, "is not an SPZ file: the data does not start with NGSP").at(Place::Byte(0)));
        }
        let version = cursor.u32("the SPZ header")?;
        let splats = cursor.u32("the SPZ header")?;
        let byte = |c: &mut Cursor<'_>| c.u8("the SPZ header");
        let (sh_degree, fractional_bits) = (byte(cursor)?, byte(cursor)?);
        let (flags, streams) = (byte(cursor)?, byte(cursor)?);
        let field = |name: &str, what: String| Err(IoError::new(path, what).at(Place::Field(name.into())));
        if !(1..=4).contains(&version) {
            return field("version", format!("SPZ version {version} is not known, only 1 to 4"));
        }
        if sh_degree > 4 {
            return field("shDegree", format!("SH degree {sh_degree} is not known, only 0 to 4"));
        }
        if fractional_bits > 30 {
            return field(
                "fractionalBits",
                format!("{fractional_bits} fractional bits do not fit the 24-bit positions"),
            );
        }
        Ok(Self { version, splats, sh_degree, fractional_bits, flags, streams })
    }

    fn layout(&self) -> Layout {
        Layout::new(self.version, self.splats, self.sh_degree)
    }

    fn too_many(&self, file_bytes: usize, path: &Path) -> IoError {
        let what = format!("the header claims {} splats, more than {file_bytes} bytes can hold", self.splats);
        IoError::new(path, what).at(Place::Field("numPoints".into()))
    }

    fn decode(&self, arrays: &[&[u8]; 6]) -> SpzCloud {
        let gaussians = spz_codec::decode(&self.layout(), u32::from(self.fractional_bits), arrays);
        let mut notes: Vec<String> = cut_note(u32::from(self.sh_degree)).into_iter().collect();
        if self.flags & FLAG_EXTENSIONS != 0 {
            notes.push(
                "has vendor extensions, which are ignored; if one declares other axes, the scene appears rotated"
                    .into(),
            );
        }
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
        return Err(IoError::new(path, what).at(Place::Byte((HEADER_BYTES + body.len()) as u64)));
    }
    let mut rest = body;
    let arrays = layout.array_bytes().map(|n| {
        let (array, tail) = rest.split_at(n as usize);
        rest = tail;
        array
    });
    Ok(header.decode(&arrays))
}

/// Reads version 4: a table of contents and zstd frames.
fn streams(header: &Header, bytes: &[u8], path: &Path) -> Result<SpzCloud, IoError> {
    if u64::from(header.splats) > (bytes.len() as u64).saturating_mul(MAX_SPLATS_PER_BYTE) {
        return Err(header.too_many(bytes.len(), path));
    }
    let mut cursor = Cursor::new(bytes, path);
    cursor.take(HEADER_BYTES, "the SPZ header")?;
    let toc = cursor.u32("the SPZ header")? as usize;
    if toc < HEADER_BYTES_V4 {
        let what = format!("the table of contents at byte {toc} lies within the header");
        return Err(IoError::new(path, what).at(Place::Field("tocByteOffset".into())));
    }
    cursor.take(toc - cursor.position(), "the part before the table of contents")?;
    let sizes = header.layout().array_bytes();
    let present = sizes.iter().filter(|&&n| n > 0).count();
    if present != usize::from(header.streams) {
        let what =
            format!("{} streams, where {} splats of this SH degree have {present}", header.streams, header.splats);
        return Err(IoError::new(path, what).at(Place::Field("numStreams".into())));
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
        let broken = |what: String| IoError::new(path, format!("stream {i} {what}")).at(Place::Byte(start as u64));
        // The buffer grows with the actual output, and at most one byte more than expected is read.
        let read = zstd::stream::read::Decoder::with_buffer(packed)
            .and_then(|d| d.take(sizes[i].saturating_add(1)).read_to_end(&mut arrays[i]));
        read.map_err(|e| broken(format!("is damaged: {e}")))?;
        if arrays[i].len() as u64 != sizes[i] {
            return Err(broken(format!("does not unpack to the {} bytes that the table of contents names", sizes[i])));
        }
    }
    Ok(header.decode(&arrays.each_ref().map(Vec::as_slice)))
}

/// Writes a gzipped version 3 file: its smallest-three rotations are about five times finer than version 2's for one
/// byte more, while version 2 loses w near half turns; version 4 is not widely supported yet.
///
/// Positions get 12 fractional bits (1/4096 units), fewer if the cloud reaches beyond +-2048 units.
pub fn write_spz(path: &Path, cloud: &Gaussians, antialias: bool) -> Result<(), IoError> {
    let bytes = spz_bytes(cloud, antialias, path)?;
    atomic_write(path, |out| out.write_all(&bytes))
}

/// The bytes that [`write_spz`] writes.
pub fn spz_bytes(cloud: &Gaussians, antialias: bool, path: &Path) -> Result<Vec<u8>, IoError> {
    if let Some(i) = (0..cloud.len()).find(|&i| !cloud.is_finite(i)) {
        return Err(IoError::new(path, format!("cannot write: Gaussian {i} has a value that is not finite")));
    }
    let splats = u32::try_from(cloud.len()).map_err(|_| IoError::new(path, "cannot write: more than 2^32 splats"))?;
    let reach = cloud.means.iter().flatten().fold(0.0f64, |m, &v| m.max(f64::from(v).abs()));
    let Some(bits) = (0..=12u32).rev().find(|&b| reach * f64::from(1u32 << b) < 8_388_607.0) else {
        let what = format!("cannot write: a position of {reach:.3e} units is beyond SPZ's 24-bit range of 8.4e6");
        return Err(IoError::new(path, what).advise("scale the scene down"));
    };
    let degree = cloud.sh_degree.min(MAX_SH_DEGREE) as u8;
    let arrays = spz_codec::encode(cloud, bits);
    let mut plain = Vec::with_capacity(HEADER_BYTES + arrays.iter().map(Vec::len).sum::<usize>());
    plain.extend_from_slice(b"NGSP");
    plain.extend_from_slice(&3u32.to_le_bytes());
    plain.extend_from_slice(&splats.to_le_bytes());
    plain.extend_from_slice(&[degree, bits as u8, u8::from(antialias) * FLAG_ANTIALIAS, 0]);
    arrays.iter().for_each(|a| plain.extend_from_slice(a));
    let mut encoder = flate2::GzBuilder::new().mtime(0).write(Vec::new(), flate2::Compression::best());
    encoder.write_all(&plain).and_then(|()| encoder.finish()).map_err(|e| IoError::os(path, "cannot write", &e))
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_samples::sample;

    fn parse(bytes: &[u8]) -> Result<SpzCloud, IoError> {
        parse_spz(bytes, Path::new("test.spz"))
    }

    fn normalised(q: [f32; 4]) -> [f64; 4] {
        let n = q.iter().map(|&v| f64::from(v).powi(2)).sum::<f64>().sqrt();
        q.map(|v| f64::from(v) / n)
    }

    #[test]
    fn what_is_written_is_read_within_the_quantisation() -> Result<(), IoError> {
        for degree in 0..=3 {
            let cloud = sample(degree, 300);
            let bytes = spz_bytes(&cloud, degree == 2, Path::new("x.spz"))?;
            let back = parse(&bytes)?;
            assert_eq!(back.antialias, degree == 2);
            let back = back.gaussians;
            assert_eq!((back.len(), back.sh_degree), (300, degree));
            for i in 0..300 {
                let near = |a: &[f32], b: &[f32], tolerance: f32, what: &str| {
                    for (x, y) in a.iter().zip(b) {
                        assert!((x - y).abs() <= tolerance, "{what} of {i}: {x} {y}");
                    }
                };
                near(&back.means[i], &cloud.means[i], 0.5 / 4096.0 + 1e-6, "mean");
                near(&back.log_scales[i], &cloud.log_scales[i], 0.5 / 16.0 + 1e-6, "scale");
                near(&back.sh_of(i)[0], &cloud.sh_of(i)[0], 0.5 / (255.0 * 0.15) + 1e-6, "dc");
                near(
                    back.sh_of(i)[1..].as_flattened(),
                    cloud.sh_of(i)[1..].as_flattened(),
                    8.0 / 128.0 + 0.5 / 128.0 + 1e-6,
                    "sh",
                );
                let (a, b) = (normalised(back.quats[i]), normalised(cloud.quats[i]));
                assert!(a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>().abs() > 1.0 - 1e-5, "quat of {i}");
                let sigmoid = |l: f32| 1.0 / (1.0 + (-l).exp());
                assert!((sigmoid(back.opacity_logits[i]) - sigmoid(cloud.opacity_logits[i])).abs() < 0.51 / 255.0);
            }
        }
        Ok(())
    }

    #[test]
    fn an_empty_cloud_and_large_positions() -> Result<(), IoError> {
        let path = Path::new("x.spz");
        assert!(parse(&spz_bytes(&Gaussians::default(), false, path)?)?.gaussians.is_empty());
        let mut cloud = sample(0, 2);
        cloud.means[1] = [100_000.0, -5.0, 3.0];
        assert!((parse(&spz_bytes(&cloud, false, path)?)?.gaussians.means[1][0] - 100_000.0).abs() < 0.02);
        cloud.means[1][0] = 1e9;
        assert!(spz_bytes(&cloud, false, path).is_err());
        cloud.means[1][0] = f32::NAN;
        assert!(spz_bytes(&cloud, false, path).is_err());
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
        let mut encoder = flate2::write::GzEncoder::new(Vec::new(), flate2::Compression::default());
        let gz = encoder
            .write_all(&raw)
            .and_then(|()| encoder.finish())
            .map_err(|e| IoError::os(Path::new("x"), "gzip", &e))?;
        assert!(parse(&gz).is_err_and(|e| e.to_string().contains("claims 4294967295")));
        raw[4] = 4;
        assert!(parse(&raw).is_err_and(|e| e.to_string().contains("claims 4294967295")));
        Ok(())
    }
}
