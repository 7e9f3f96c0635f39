//! Instance masks as PNG bytes; [`crate::masks::read_mask`] says how pixels become ids.

use std::collections::BTreeMap;
use std::io::Cursor;
use std::path::Path;

use png::{BitDepth, ColorType, Transformations};

use crate::bytes::MAX_INFLATION;
use crate::error::IoError;
use crate::host_memory::{available_bytes, check_reading};
use crate::masks::Mask;
use instgs_vk::scene::camera::MAX_IMAGE_SIDE;

/// Parses the bytes of a PNG mask; `path` is only used in messages.
pub fn parse_mask(bytes: &[u8], path: &Path) -> Result<Mask, IoError> {
    parse(bytes, available_bytes(), path).map(|(mask, _)| mask)
}

/// As [`parse_mask`], for a folder whose file of categories gives names to ids: colours have none.
///
/// # Errors
/// Also a picture in colours, whose objects are numbered anew in each.
pub(crate) fn parse_named_mask(bytes: &[u8], path: &Path) -> Result<Mask, IoError> {
    match parse(bytes, available_bytes(), path)? {
        (mask, false) => Ok(mask),
        (_, true) => Err(IoError::new(path, "is a mask in colours, beside a categories.json that names ids")
            .advise("save masks with ids as grey levels, or take the file away")),
    }
}

/// The mask, and whether its ids number colours; with so many bytes of memory, `None` if it is unknown how many there are.
fn parse(bytes: &[u8], memory: Option<u64>, path: &Path) -> Result<(Mask, bool), IoError> {
    let fail = |e: png::DecodingError| IoError::damaged(path, format!("cannot decode the mask: {e}"));
    let mut decoder = png::Decoder::new(Cursor::new(bytes));
    decoder.set_transformations(Transformations::IDENTITY);
    let mut reader = decoder.read_info().map_err(fail)?;
    let info = reader.info();
    let (width, height, bits) = (info.width, info.height, info.bit_depth as u8);
    let palette = info.palette.as_ref().map(|p| p.to_vec());
    let color = info.color_type;
    if matches!((color, info.bit_depth), (ColorType::Rgb | ColorType::Rgba, BitDepth::Sixteen)) {
        let what = format!("the mask is a PNG of {bits} bits of {color:?}");
        return Err(IoError::new(path, what)
            .advise("save it with 8 or 16 bits of grey (ids up to 255 or 65535), or with 8 bits of colours"));
    }
    let row_bytes = (u64::from(width) * u64::from(bits) * color.samples() as u64).div_ceil(8);
    // A header that claims more pixels is damaged, and nothing is allocated for it.
    let most = (bytes.len() as u64).saturating_mul(MAX_INFLATION);
    let whole = row_bytes.checked_mul(u64::from(height)).filter(|&total| total <= most);
    let Some(data_bytes) = whole.and_then(|total| usize::try_from(total).ok()) else {
        return Err(IoError::damaged(path, format!("the mask is too short for its {width}x{height} pixels")));
    };
    if width.max(height) > MAX_IMAGE_SIDE {
        let what = format!("the mask has {width}x{height} pixels, and no photo has a side above {MAX_IMAGE_SIDE}");
        return Err(IoError::new(path, what).advise("save the mask at the size of its photo"));
    }
    // The rows, and the ids: of one bit a pixel these take sixteen times as much.
    let id_bytes = 2 * u64::from(width) * u64::from(height);
    check_reading(path, "takes", data_bytes as u64 + id_bytes, memory)?;
    let mut data = vec![0; data_bytes];
    reader.next_frame(&mut data).map_err(fail)?;
    // The image may be complete and the file truncated: the end marker is required too.
    reader.finish().map_err(fail)?;
    let mut has_colors = false;
    let ids = match color {
        ColorType::Indexed => palette_ids(&data, width as usize, usize::from(bits), &palette.unwrap_or_default()),
        ColorType::Rgb => color_ids(data.as_chunks::<3>().0.iter().copied(), path, &mut has_colors)?,
        ColorType::Rgba => {
            color_ids(data.as_chunks::<4>().0.iter().map(|&[r, g, b, a]| shown([r, g, b], a)), path, &mut has_colors)?
        }
        ColorType::GrayscaleAlpha if bits == 16 => {
            let of = |&[g0, g1, a0, a1]: &[u8; 4]| if [a0, a1] == [0, 0] { 0 } else { u16::from_be_bytes([g0, g1]) };
            data.as_chunks::<4>().0.iter().map(of).collect()
        }
        ColorType::GrayscaleAlpha => {
            data.as_chunks::<2>().0.iter().map(|&[grey, a]| if a == 0 { 0 } else { u16::from(grey) }).collect()
        }
        ColorType::Grayscale if bits == 16 => data.as_chunks::<2>().0.iter().map(|&b| u16::from_be_bytes(b)).collect(),
        ColorType::Grayscale => packed(&data, width as usize, usize::from(bits), u16::from),
    };
    Ok((Mask { width, height, ids }, has_colors))
}

/// A colour, black where it is fully transparent.
fn shown(color: [u8; 3], alpha: u8) -> [u8; 3] {
    if alpha == 0 { [0; 3] } else { color }
}

/// A mask with more colours than this is a photo.
const MOST_COLORS: usize = 4096;

/// Ids of a picture in colour: its grey levels if it has only greys, as black and white masks saved in colour; otherwise
/// every colour but black is an object, numbered in the order of red, green and blue, which `has_colors` then says.
fn color_ids(
    pixels: impl Iterator<Item = [u8; 3]> + Clone,
    path: &Path,
    has_colors: &mut bool,
) -> Result<Vec<u16>, IoError> {
    if pixels.clone().all(|[r, g, b]| r == g && g == b) {
        return Ok(pixels.map(|[grey, ..]| u16::from(grey)).collect());
    }
    *has_colors = true;
    let mut ids: BTreeMap<[u8; 3], u16> = BTreeMap::new();
    for color in pixels.clone().filter(|color| *color != [0; 3]) {
        ids.insert(color, 0);
        if ids.len() > MOST_COLORS {
            let error = IoError::new(path, format!("the mask has more than {MOST_COLORS} colours, as a photo has"));
            return Err(error.advise("a mask has one colour for each object, without soft edges"));
        }
    }
    ids.values_mut().zip(1..).for_each(|(id, number)| *id = number);
    Ok(pixels.map(|color| ids.get(&color).copied().unwrap_or(0)).collect())
}

/// Ids of a palette image with `bits` per pixel, rows padded to bytes: grey levels if the palette has only greys,
/// otherwise indices.
fn palette_ids(data: &[u8], width: usize, bits: usize, palette: &[u8]) -> Vec<u16> {
    let colours = palette.as_chunks::<3>().0;
    let greys = colours.iter().all(|[r, g, b]| r == g && g == b);
    let id = |index: u8| match colours.get(usize::from(index)) {
        Some(colour) if greys => u16::from(colour[0]),
        _ => u16::from(index),
    };
    packed(data, width, bits, id)
}

/// The ids of pixels of at most 8 bits, by their values; rows are padded to bytes.
fn packed(data: &[u8], width: usize, bits: usize, id: impl Fn(u8) -> u16) -> Vec<u16> {
    let mask = ((1u16 << bits) - 1) as u8;
    // The first pixel of a byte is in its highest bits.
    let pixel = |row: &[u8], i: usize| (row[i * bits / 8] >> (8 - bits - i * bits % 8)) & mask;
    let rows = data.chunks_exact((width * bits).div_ceil(8).max(1));
    // Collected, the ids would take up to twice their room while they grow.
    let mut out = Vec::with_capacity(width * rows.len());
    rows.for_each(|row| out.extend((0..width).map(|i| id(pixel(row, i)))));
    out
}

/// The PNG of a mask, 16-bit grey; `path` is only used in messages.
pub fn mask_bytes(mask: &Mask, path: &Path) -> Result<Vec<u8>, IoError> {
    let pixels = u64::from(mask.width) * u64::from(mask.height);
    if pixels == 0 || pixels != mask.ids.len() as u64 {
        let (width, height, count) = (mask.width, mask.height, mask.ids.len());
        return Err(IoError::new(
            path,
            format!("cannot write: {count} ids do not make a mask of {width}x{height} pixels"),
        ));
    }
    let data: Vec<u8> = mask.ids.iter().flat_map(|id| id.to_be_bytes()).collect();
    let mut out = Vec::new();
    let mut encoder = png::Encoder::new(&mut out, mask.width, mask.height);
    encoder.set_color(ColorType::Grayscale);
    encoder.set_depth(BitDepth::Sixteen);
    let written = encoder.write_header().and_then(|mut writer| {
        writer.write_image_data(&data)?;
        writer.finish()
    });
    written.map_err(|e| IoError::new(path, format!("cannot write: {e}")))?;
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    type Outcome = Result<(), Box<dyn std::error::Error>>;

    /// A PNG of 5x2 pixels with the given data.
    fn encoded(color: ColorType, depth: BitDepth, palette: &[u8], data: &[u8]) -> Result<Vec<u8>, png::EncodingError> {
        let mut out = Vec::new();
        let mut encoder = png::Encoder::new(&mut out, 5, 2);
        encoder.set_color(color);
        encoder.set_depth(depth);
        if !palette.is_empty() {
            encoder.set_palette(palette.to_vec());
        }
        let mut writer = encoder.write_header()?;
        writer.write_image_data(data)?;
        writer.finish()?;
        Ok(out)
    }

    #[test]
    fn what_is_written_is_read() -> Outcome {
        let path = Path::new("m.png");
        let mask = Mask { width: 5, height: 2, ids: vec![0, 1, 255, 256, 65535, 4, 3, 2, 1, 0] };
        assert_eq!(parse_mask(&mask_bytes(&mask, path)?, path)?, mask);
        for (width, height, ids) in [(0, 0, vec![]), (2, 2, vec![1; 3]), (0, 4, vec![])] {
            assert!(mask_bytes(&Mask { width, height, ids }, path).is_err());
        }
        Ok(())
    }

    #[test]
    fn grey_levels_and_palette_indices_are_ids() -> Outcome {
        let path = Path::new("m.png");
        let ids = |file: Vec<u8>| parse_mask(&file, path).map(|m| m.ids);
        let bytes = [0, 1, 2, 3, 200, 0, 0, 3, 2, 1];
        assert_eq!(ids(encoded(ColorType::Grayscale, BitDepth::Eight, &[], &bytes)?)?, bytes.map(u16::from));
        let low = [0, 1, 2, 3, 1, 0, 0, 3, 2, 1];
        let colours = [0, 0, 0, 128, 0, 0, 0, 128, 0, 128, 128, 0];
        let greys = [9, 9, 9, 0, 0, 0, 255, 255, 255, 7, 7, 7];
        let of_grey = low.map(|i: u8| u16::from(greys[3 * usize::from(i)]));
        // The same indices with 2 bits per pixel, 5 pixels in 2 bytes.
        let packed = [0b00_01_10_11, 0b01_000000, 0b00_00_11_10, 0b01_000000];
        for (depth, data) in [(BitDepth::Eight, low.as_slice()), (BitDepth::Two, &packed)] {
            assert_eq!(ids(encoded(ColorType::Indexed, depth, &colours, data)?)?, low.map(u16::from));
            assert_eq!(ids(encoded(ColorType::Indexed, depth, &greys, data)?)?, of_grey);
        }
        Ok(())
    }

    #[test]
    fn colours_and_few_bits_are_ids() -> Outcome {
        let path = Path::new("m.png");
        let ids = |file: Vec<u8>| parse_mask(&file, path).map(|m| m.ids);
        let (none, red, blue, white) = ([0, 0, 0], [200, 0, 0], [0, 0, 9], [255, 255, 255]);
        let pixels = [none, red, blue, blue, none, red, red, white, none, none];
        let want = [0, 2, 1, 1, 0, 2, 2, 3, 0, 0];
        assert_eq!(ids(encoded(ColorType::Rgb, BitDepth::Eight, &[], pixels.as_flattened())?)?, want);
        // What is fully transparent is no object.
        let with_alpha = |a: u8| pixels.map(|[r, g, b]| [r, g, b, if [r, g, b] == blue { a } else { 255 }]);
        assert_eq!(ids(encoded(ColorType::Rgba, BitDepth::Eight, &[], with_alpha(1).as_flattened())?)?, want);
        let seen = ids(encoded(ColorType::Rgba, BitDepth::Eight, &[], with_alpha(0).as_flattened())?)?;
        assert_eq!(seen, [0, 1, 0, 0, 0, 1, 1, 2, 0, 0]);
        let greys = [0u8, 255, 255, 7, 0, 0, 0, 255, 255, 1];
        let in_color = greys.map(|v| [v; 3]);
        assert_eq!(ids(encoded(ColorType::Rgb, BitDepth::Eight, &[], in_color.as_flattened())?)?, greys.map(u16::from));
        let grey_alpha = greys.map(|v| [v, 255]);
        let got = ids(encoded(ColorType::GrayscaleAlpha, BitDepth::Eight, &[], grey_alpha.as_flattened())?)?;
        assert_eq!(got, greys.map(u16::from));
        let bits = encoded(ColorType::Grayscale, BitDepth::One, &[], &[0b0101_1000, 0b0000_1000])?;
        assert_eq!(ids(bits)?, [0, 1, 0, 1, 1, 0, 0, 0, 0, 1]);
        Ok(())
    }

    /// 10 bytes of rows, and 20 of ids.
    #[test]
    fn memory_is_checked_before_anything_is_unpacked() -> Outcome {
        let path = Path::new("m.png");
        let bytes = encoded(ColorType::Grayscale, BitDepth::Eight, &[], &[7; 10])?;
        assert!(parse(&bytes, Some(30), path).is_ok() && parse(&bytes, None, path).is_ok());
        let text = parse(&bytes, Some(29), path).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text.contains("MiB are available; close other programs"), "{text}");
        Ok(())
    }

    #[test]
    fn other_pictures_are_refused() -> Outcome {
        let text = |file: &[u8]| parse_mask(file, Path::new("m.png")).err().map(|e| e.to_string()).unwrap_or_default();
        let rgb = encoded(ColorType::Rgb, BitDepth::Sixteen, &[], &[0; 60])?;
        assert!(text(&rgb).contains("16 bits of Rgb; save it"), "{}", text(&rgb));
        let good = encoded(ColorType::Grayscale, BitDepth::Eight, &[], &[7; 10])?;
        for end in 0..good.len() {
            assert!(!text(&good[..end]).is_empty(), "cut to {end} of {}", good.len());
        }
        assert!(text(b"GIF89a").contains("m.png: cannot decode the mask"));
        // One bit a pixel: few bytes claim many ids.
        let mut long = Vec::new();
        let mut encoder = png::Encoder::new(&mut long, 1 << 15, 1);
        encoder.set_depth(BitDepth::One);
        encoder.write_header()?.write_image_data(&[0; 1 << 12])?;
        assert!(text(&long).contains("32768x1 pixels, and no photo has a side above 16384; save"), "{}", text(&long));
        // The header claims 2^20 by 2^20 pixels over the data of ten; its checksum is correct.
        let mut huge = good.clone();
        huge[16..24].copy_from_slice(&[0, 0x10, 0, 0, 0, 0x10, 0, 0]);
        let mut crc = flate2::Crc::new();
        crc.update(&huge[12..29]);
        huge[29..33].copy_from_slice(&crc.sum().to_be_bytes());
        assert!(text(&huge).contains("too short for its 1048576x1048576"), "{}", text(&huge));
        Ok(())
    }
}
