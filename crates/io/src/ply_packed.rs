//! SuperSplat's compressed `.ply`: chunks of 256 splats with ranges, and per splat four packed 32-bit words.
//!
//! Word layouts, most significant bits first: position and scale 11/10/11 bits within the chunk's range; rotation a
//! 2-bit index of the largest component (of w, x, y, z) and the other three in 10 bits each over +-sqrt(1/2); colour and
//! opacity 8 bits each. SH bytes span -4..4.

use std::path::Path;

use crate::error::IoError;
use crate::logit_of_byte;
use crate::ply::rest_columns;
use crate::ply_table::PlyTable;
use instgs_vk::scene::gaussians::{Gaussians, sh_coefficients};

const SPLATS_PER_CHUNK: usize = 256;
const SH_C0: f64 = 0.28209479177387814;

/// Ranges of a chunk: of x, y, z, of the three log scales, and of r, g, b.
type Ranges = [(f64, f64); 9];

/// Reads a table whose vertices are packed; returns the cloud, and the SH degree stored in the file.
pub(crate) fn read(table: &PlyTable<'_>, path: &Path) -> Result<(Gaussians, u32), IoError> {
    let missing = |element: &str, name: &str| {
        IoError::damaged(path, format!("compressed PLY: element {element} has no property {name}"))
    };
    let element = |name: &str| {
        table.element(name).ok_or_else(|| IoError::damaged(path, format!("compressed PLY without element {name}")))
    };
    let (chunk, vertex) = (element("chunk")?, element("vertex")?);
    let mut range_columns = [None; 9];
    for (i, name) in ["x", "y", "z", "scale_x", "scale_y", "scale_z", "r", "g", "b"].iter().enumerate() {
        let pair = chunk.column(&format!("min_{name}")).zip(chunk.column(&format!("max_{name}")));
        // The first version of the format has no colour range: it is 0..1.
        if pair.is_none() && i < 6 {
            return Err(missing("chunk", &format!("min_{name} or max_{name}")));
        }
        range_columns[i] = pair;
    }
    let packed = |name: &str| vertex.column(name).ok_or_else(|| missing("vertex", name));
    let words =
        [packed("packed_position")?, packed("packed_rotation")?, packed("packed_scale")?, packed("packed_color")?];
    let sh = table.element("sh");
    let rest = sh.map(|e| rest_columns(e, path)).transpose()?;
    let (sh_degree, stored) = rest.as_ref().map_or((0, 0), |rest| (rest.kept, rest.stored));
    let triples = rest.map_or(Vec::new(), |rest| rest.triples);
    if sh.is_some_and(|e| e.count != vertex.count) {
        return Err(IoError::damaged(path, "compressed PLY: elements sh and vertex differ in length"));
    }
    if vertex.count.div_ceil(SPLATS_PER_CHUNK as u64) != chunk.count {
        let what =
            format!("compressed PLY: {} splats need one chunk per 256, the file has {}", vertex.count, chunk.count);
        return Err(IoError::damaged(path, what));
    }

    let mut ranges: Vec<Ranges> = Vec::new();
    let mut splats: Vec<[u32; 4]> = Vec::new();
    let mut rest_values: Vec<[f32; 3]> = Vec::new();
    let mut on_chunk = |_: usize, row: &[f64]| {
        ranges.push(range_columns.map(|pair| pair.map_or((0.0, 1.0), |(low, high)| (row[low], row[high]))));
    };
    let mut on_vertex = |_: usize, row: &[f64]| splats.push(words.map(|c| row[c] as u32));
    let mut on_sh = |_: usize, row: &[f64]| rest_values.extend(triples.iter().map(|t| t.map(|c| sh_of_byte(row[c]))));
    match sh {
        Some(_) => table.walk(&mut [("chunk", &mut on_chunk), ("vertex", &mut on_vertex), ("sh", &mut on_sh)])?,
        None => table.walk(&mut [("chunk", &mut on_chunk), ("vertex", &mut on_vertex)])?,
    }

    let mut out = Gaussians::with_capacity(sh_degree, splats.len());
    let per_channel = sh_coefficients(sh_degree) - 1;
    for (i, &[position, rotation, scale, colour]) in splats.iter().enumerate() {
        let Some(range) = ranges.get(i / SPLATS_PER_CHUNK) else {
            return Err(IoError::damaged(path, format!("compressed PLY: splat {i} has no chunk")));
        };
        let within = |channel: usize, t: f64| (range[channel].0 * (1.0 - t) + range[channel].1 * t) as f32;
        let [x, y, z] = unpack_11_10_11(position);
        out.means.push([within(0, x), within(1, y), within(2, z)]);
        let [x, y, z] = unpack_11_10_11(scale);
        out.log_scales.push([within(3, x), within(4, y), within(5, z)]);
        out.quats.push(unpack_rotation(rotation));
        let [r, g, b, alpha] = colour.to_be_bytes();
        out.opacity_logits.push(logit_of_byte(alpha));
        let dc =
            |channel: usize, byte: u8| ((f64::from(within(channel, f64::from(byte) / 255.0)) - 0.5) / SH_C0) as f32;
        out.sh.push([dc(6, r), dc(7, g), dc(8, b)]);
        out.sh.extend_from_slice(&rest_values[per_channel * i..per_channel * (i + 1)]);
    }
    Ok((out, stored))
}

fn unpack_11_10_11(word: u32) -> [f64; 3] {
    let unorm = |value: u32, bits: u32| f64::from(value & ((1 << bits) - 1)) / f64::from((1u32 << bits) - 1);
    [unorm(word >> 21, 11), unorm(word >> 11, 10), unorm(word, 11)]
}

fn unpack_rotation(word: u32) -> [f32; 4] {
    let part = |shift: u32| (f64::from((word >> shift) & 1023) / 1023.0 - 0.5) * std::f64::consts::SQRT_2;
    let small = [part(20), part(10), part(0)];
    let largest = (1.0 - small.iter().map(|v| v * v).sum::<f64>()).max(0.0).sqrt();
    let mut next = small.into_iter();
    let index = (word >> 30) as usize;
    std::array::from_fn(|i| if i == index { largest } else { next.next().unwrap_or(0.0) } as f32)
}

/// Decodes an SH byte: 0 and 255 are the ends of the range, the others are centres of bins.
fn sh_of_byte(byte: f64) -> f32 {
    let unit = if byte <= 0.0 {
        0.0
    } else if byte >= 255.0 {
        1.0
    } else {
        (byte + 0.5) / 256.0
    };
    ((unit - 0.5) * 8.0) as f32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn packed_words_unpack_to_their_ends_and_middle() {
        assert_eq!(unpack_11_10_11(0), [0.0; 3]);
        assert_eq!(unpack_11_10_11(u32::MAX), [1.0; 3]);
        assert_eq!(unpack_11_10_11(2047 << 21), [1.0, 0.0, 0.0]);
        let q = unpack_rotation((2 << 30) | (512 << 20) | (512 << 10) | 512);
        assert!(q[2] > 0.999 && q[0].abs() < 1e-3 && q[3].abs() < 1e-3);
        assert_eq!(sh_of_byte(0.0), -4.0);
        assert_eq!(sh_of_byte(255.0), 4.0);
        assert!(sh_of_byte(128.0).abs() < 0.02);
    }
}
