//! Float images as `.ktx2`: one level, no supercompression, `VK_FORMAT_R32G32B32A32_SFLOAT` or `VK_FORMAT_R32_SFLOAT`.
//!
//! Colours are those of the photos, in their encoding (sRGB), and the descriptor says so: KTX 2.0 (revision 4) lets formats that
//! have no sRGB variant do that, if the alpha is marked as linear. Depth is linear. Colour is blended over the background, so it
//! is premultiplied only where that is black; the descriptor says that it is not.
//!
//! The header, level index and data-format descriptor are written here; reading uses the `ktx2` crate, which thus
//! checks the writer independently.

use std::path::Path;

use crate::error::{IoError, Place};
use crate::{atomic_write, read_bytes};

/// A float image, row major from the top left.
#[derive(Clone, Debug, PartialEq)]
pub struct FloatImage {
    /// Width of the image, pixels.
    pub width: u32,
    /// Height of the image, pixels.
    pub height: u32,
    /// Number of channels: 4 (red, green and blue in the photos' encoding, sRGB, and alpha) or 1 (depth).
    pub channels: u32,
    /// `width * height * channels` values, channels innermost.
    pub values: Vec<f32>,
}

const IDENTIFIER: [u8; 12] = [0xAB, 0x4B, 0x54, 0x58, 0x20, 0x32, 0x30, 0xBB, 0x0D, 0x0A, 0x1A, 0x0A];
const VK_FORMAT_R32_SFLOAT: u32 = 100;
const VK_FORMAT_R32G32B32A32_SFLOAT: u32 = 109;
/// Offset of the descriptor: identifier, nine header words, the index, and one level of three 64-bit words precede it.
const DFD_OFFSET: u32 = 80 + 24;

/// Writes an image with 4 or 1 channels.
///
/// # Errors
/// Another number of channels, a wrong number of values, or a file that cannot be written.
pub fn write_ktx2(path: &Path, image: &FloatImage) -> Result<(), IoError> {
    let bytes = ktx2_bytes(image, path)?;
    atomic_write(path, |out| out.write_all(&bytes))
}

/// The bytes that [`write_ktx2`] writes.
pub fn ktx2_bytes(image: &FloatImage, path: &Path) -> Result<Vec<u8>, IoError> {
    let (format, channel_ids): (u32, &[u32]) = match image.channels {
        1 => (VK_FORMAT_R32_SFLOAT, &[0]),
        4 => (VK_FORMAT_R32G32B32A32_SFLOAT, &[0, 1, 2, ALPHA]),
        other => return Err(IoError::new(path, format!("cannot write: an image of {other} channels, not 1 or 4"))),
    };
    let values = u64::from(image.width) * u64::from(image.height) * u64::from(image.channels);
    if values == 0 || values != image.values.len() as u64 {
        let what = format!(
            "cannot write: {}x{}x{} pixels with {} values",
            image.width,
            image.height,
            image.channels,
            image.values.len()
        );
        return Err(IoError::new(path, what).advise("give one value for each channel of each pixel"));
    }
    let dfd = data_format_descriptor(channel_ids);
    let writer = key_value(b"KTXwriter", concat!("instgs-vk ", env!("CARGO_PKG_VERSION")).as_bytes());
    let kvd_offset = DFD_OFFSET as usize + dfd.len();
    // A level starts at a multiple of its texel size (4 or 16, both multiples of 4).
    let data_offset = (kvd_offset + writer.len()).next_multiple_of(4 * image.channels as usize);
    let data_bytes = 4 * values;

    let mut out = Vec::with_capacity(data_offset + data_bytes as usize);
    out.extend_from_slice(&IDENTIFIER);
    let mut words = |values: &[u32]| values.iter().for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
    // vkFormat, typeSize, width, height, depth (2D: 0), layers (no array: 0), faces, levels, supercompression (none).
    words(&[format, 4, image.width, image.height, 0, 0, 1, 1, 0]);
    // Offset and length of the descriptor, of the key-value data, and (64 bit) of supercompression data.
    words(&[DFD_OFFSET, dfd.len() as u32, kvd_offset as u32, writer.len() as u32, 0, 0, 0, 0]);
    for value in [data_offset as u64, data_bytes, data_bytes] {
        out.extend_from_slice(&value.to_le_bytes());
    }
    out.extend_from_slice(&dfd);
    out.extend_from_slice(&writer);
    out.resize(data_offset, 0);
    image.values.iter().for_each(|v| out.extend_from_slice(&v.to_le_bytes()));
    Ok(out)
}

/// The channel of alpha.
const ALPHA: u32 = 15;

/// One basic block of the Khronos Data Format 1.3: 32-bit signed float samples, one per channel; sRGB with alpha, linear without.
fn data_format_descriptor(channel_ids: &[u32]) -> Vec<u8> {
    const VERSION: u32 = 2;
    const MODEL_RGBSDA: u32 = 1;
    const PRIMARIES_BT709: u32 = 1;
    const TRANSFER_LINEAR: u32 = 1;
    const TRANSFER_SRGB: u32 = 2;
    const FLOAT: u32 = 0x80;
    const SIGNED: u32 = 0x40;
    /// Alpha is no colour: the transfer function is not for it.
    const LINEAR: u32 = 0x10;
    let is_colour = channel_ids.contains(&ALPHA);
    let transfer = if is_colour { TRANSFER_SRGB } else { TRANSFER_LINEAR };
    let block_bytes = 24 + 16 * channel_ids.len() as u32;
    let mut words = vec![
        4 + block_bytes,
        0, // vendor Khronos, type basic
        VERSION | block_bytes << 16,
        MODEL_RGBSDA | PRIMARIES_BT709 << 8 | transfer << 16, // flags 0: alpha not premultiplied
        0,                                                    // texel block of 1x1x1x1
        4 * channel_ids.len() as u32,                         // bytes of plane 0
        0,
    ];
    for (i, id) in channel_ids.iter().enumerate() {
        let (offset, last_bit) = (32 * i as u32, 31);
        let linear = if *id == ALPHA { LINEAR } else { 0 };
        words.extend([
            offset | last_bit << 16 | (id | FLOAT | SIGNED | linear) << 24,
            0,
            (-1f32).to_bits(),
            1f32.to_bits(),
        ]);
    }
    words.iter().flat_map(|w| w.to_le_bytes()).collect()
}

/// One key-value entry, padded to 4 bytes.
fn key_value(key: &[u8], value: &[u8]) -> Vec<u8> {
    let body = [key, b"\0", value, b"\0"].concat();
    let mut out = (body.len() as u32).to_le_bytes().to_vec();
    out.extend_from_slice(&body);
    out.resize(out.len().next_multiple_of(4), 0);
    out
}

/// Reads a `.ktx2` file of the two formats that [`write_ktx2`] writes, from any program.
pub fn read_ktx2(path: &Path) -> Result<FloatImage, IoError> {
    parse_ktx2(&read_bytes(path)?, path)
}

/// True for texel blocks of 256 texels in a dimension, at which the parser panics (crate ktx2 0.5: it adds 1 to a byte).
fn has_impossible_blocks(bytes: &[u8]) -> bool {
    /// Where the header has the descriptor's offset, and the descriptor the dimensions.
    const OFFSET_AT: usize = 48;
    const DIMENSIONS_AT: usize = 16;
    let offset =
        bytes.get(OFFSET_AT..).and_then(|rest| rest.first_chunk()).map(|word| u32::from_le_bytes(*word) as usize);
    let dimensions = offset.and_then(|at| bytes.get(at.checked_add(DIMENSIONS_AT)?..)?.first_chunk::<4>());
    dimensions.is_some_and(|dimensions| dimensions.contains(&u8::MAX))
}

/// Parses the bytes of a `.ktx2`; `path` is only used in messages.
pub fn parse_ktx2(bytes: &[u8], path: &Path) -> Result<FloatImage, IoError> {
    if has_impossible_blocks(bytes) {
        return Err(IoError::damaged(path, "has a descriptor of impossible texel blocks"));
    }
    let reader =
        ktx2::Reader::new(bytes).map_err(|e| IoError::damaged(path, format!("is not a whole KTX2 file: {e}")))?;
    let header = reader.header();
    let channels = match header.format {
        Some(ktx2::Format::R32_SFLOAT) => 1,
        Some(ktx2::Format::R32G32B32A32_SFLOAT) => 4,
        other => {
            let what = format!("has the format {other:?}, not R32_SFLOAT or R32G32B32A32_SFLOAT");
            return Err(IoError::new(path, what).at(Place::Field("vkFormat".into())));
        }
    };
    if header.supercompression_scheme.is_some() {
        return Err(IoError::new(path, "is supercompressed, which is not supported")
            .at(Place::Field("supercompressionScheme".into())));
    }
    let (width, height) = (header.pixel_width, header.pixel_height);
    let need = u64::from(width).checked_mul(u64::from(height)).and_then(|n| n.checked_mul(4 * u64::from(channels)));
    let level = reader.levels().next().ok_or_else(|| IoError::damaged(path, "has no image level"))?;
    let flat = header.pixel_depth <= 1 && header.layer_count <= 1 && header.face_count == 1;
    if !flat || need != Some(level.data.len() as u64) {
        let what = format!("a {width}x{height} image needs {need:?} bytes, level 0 has {}", level.data.len());
        return Err(IoError::new(path, what).at(Place::Field("level 0".into())));
    }
    let values = level.data.as_chunks::<4>().0.iter().map(|&b| f32::from_le_bytes(b)).collect();
    Ok(FloatImage { width, height, channels, values })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(channels: u32) -> FloatImage {
        FloatImage { width: 5, height: 3, channels, values: (0..15 * channels).map(|i| i as f32 * 0.5 - 1.0).collect() }
    }

    #[test]
    fn the_ktx2_crate_reads_it_back() -> Result<(), Box<dyn std::error::Error>> {
        for channels in [1, 4] {
            let bytes = ktx2_bytes(&image(channels), Path::new("x"))?;
            assert_eq!(parse_ktx2(&bytes, Path::new("x"))?, image(channels));
            let reader = ktx2::Reader::new(&bytes[..])?;
            let dfd = reader.basic_dfd().ok_or("no descriptor")?;
            assert_eq!(dfd.sample_information.len(), channels as usize);
            assert_eq!(dfd.bytes_planes[0], 4 * channels as u8);
            let transfer = if channels == 4 { ktx2::TransferFunction::SRGB } else { ktx2::TransferFunction::Linear };
            assert_eq!(reader.transfer_function(), Some(transfer));
            assert_eq!(reader.is_alpha_premultiplied(), Some(false));
            assert!(reader.writer().is_some_and(|w| w.starts_with("instgs-vk")));
        }
        assert!(ktx2_bytes(&image(3), Path::new("x")).is_err());
        assert!(ktx2_bytes(&FloatImage { width: 6, ..image(1) }, Path::new("x")).is_err());
        Ok(())
    }

    /// Fields at the offsets of the specification, read without the crate.
    #[test]
    fn fields_lie_where_the_specification_says() -> Result<(), IoError> {
        for channels in [1usize, 4] {
            let bytes = ktx2_bytes(&image(channels as u32), Path::new("x"))?;
            let u32_at = |at: usize| bytes[at..at + 4].iter().rev().fold(0usize, |v, &b| v << 8 | usize::from(b));
            assert_eq!(&bytes[1..7], b"KTX 20");
            assert_eq!(u32_at(12), if channels == 1 { 100 } else { 109 });
            assert_eq!([16, 20, 24, 28, 32, 36, 40, 44].map(u32_at), [4, 5, 3, 0, 0, 1, 1, 0]);
            let (dfd, dfd_bytes, kvd, kvd_bytes) = (u32_at(48), u32_at(52), u32_at(56), u32_at(60));
            assert_eq!([dfd, dfd_bytes, kvd], [104, 28 + 16 * channels, dfd + dfd_bytes]);
            let (data, data_bytes) = (u32_at(80), u32_at(88));
            assert_eq!([data % (4 * channels), data_bytes, u32_at(96)], [0, 60 * channels, 60 * channels]);
            assert!(kvd + kvd_bytes <= data && data < kvd + kvd_bytes + 16);
            assert_eq!(bytes.len(), data + data_bytes);
            assert_eq!([u32_at(dfd), u32_at(dfd + 4), u32_at(dfd + 8)], [dfd_bytes, 0, 2 | (dfd_bytes - 4) << 16]);
            // Model, primaries, transfer function (2 = sRGB), flags.
            assert_eq!(bytes[dfd + 12..dfd + 16], [1, 1, if channels == 1 { 1 } else { 2 }, 0]);
            for (i, id) in [0u8, 1, 2, 15].into_iter().take(channels).enumerate() {
                let sample = dfd + 28 + 16 * i;
                // Float, signed, and alpha linear.
                let kind = if id == 15 { 0xD0 } else { 0xC0 };
                assert_eq!(bytes[sample..sample + 4], [32 * i as u8, 0, 31, kind | id]);
                assert_eq!(
                    [u32_at(sample + 4), u32_at(sample + 8), u32_at(sample + 12)],
                    [0, 0xBF80_0000, 0x3F80_0000]
                );
            }
            assert_eq!(f32::from_bits(u32_at(data) as u32), -1.0);
        }
        Ok(())
    }
}
