//! `.splat` (antimatter15): 32 bytes per splat, no header: position and linear scales in f32, RGBA and rotation in
//! bytes.

use std::path::Path;

use crate::error::{IoError, Place};
use crate::{LEAST_LOG_SCALE, logit_of_byte, read_bytes};
use instgs_vk::scene::gaussians::Gaussians;

const BYTES_PER_SPLAT: usize = 32;
const SH_C0: f32 = 0.282_094_79;

/// Reads a `.splat` file as a cloud of SH degree 0.
///
/// # Errors
/// The file cannot be read, or its length is not a multiple of 32.
pub fn read_splat(path: &Path) -> Result<Gaussians, IoError> {
    parse_splat(&read_bytes(path)?, path)
}

/// Parses the bytes of a `.splat` file; `path` is only used in messages.
pub fn parse_splat(bytes: &[u8], path: &Path) -> Result<Gaussians, IoError> {
    if !bytes.len().is_multiple_of(BYTES_PER_SPLAT) {
        let whole = bytes.len() / BYTES_PER_SPLAT * BYTES_PER_SPLAT;
        let what = format!("ends early: a .splat file is a multiple of 32 bytes long, this one has {}", bytes.len());
        return Err(IoError::new(path, what).at(Place::Byte(whole as u64)));
    }
    let mut out = Gaussians::with_capacity(0, bytes.len() / BYTES_PER_SPLAT);
    for splat in bytes.chunks_exact(BYTES_PER_SPLAT) {
        let float = |at: usize| f32::from_le_bytes([splat[at], splat[at + 1], splat[at + 2], splat[at + 3]]);
        out.means.push([float(0), float(4), float(8)]);
        // NaN stays NaN: the loader drops and counts such Gaussians.
        out.log_scales.push(
            [float(12), float(16), float(20)].map(|s| if s < f32::MIN_POSITIVE { LEAST_LOG_SCALE } else { s.ln() }),
        );
        out.sh.push(std::array::from_fn(|k| (f32::from(splat[24 + k]) / 255.0 - 0.5) / SH_C0));
        out.opacity_logits.push(logit_of_byte(splat[27]));
        out.quats.push(std::array::from_fn(|k| (f32::from(splat[28 + k]) - 128.0) / 128.0));
    }
    Ok(out)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reads_one_splat_and_names_where_it_is_cut() {
        let mut bytes = Vec::new();
        [1.0f32, 2.0, 3.0, 1.0, 0.0, 0.5].iter().for_each(|v| bytes.extend_from_slice(&v.to_le_bytes()));
        bytes.extend_from_slice(&[255, 0, 128, 255, 255, 128, 128, 0]);
        let cloud = parse_splat(&bytes, Path::new("a.splat"));
        let Ok(cloud) = cloud else { panic!("{cloud:?}") };
        assert_eq!(cloud.means, [[1.0, 2.0, 3.0]]);
        assert!(cloud.is_finite(0) && cloud.log_scales[0][1] < -80.0 && cloud.opacity_logits[0] > 13.0);
        assert_eq!(cloud.quats[0][3], -1.0);
        assert!((cloud.sh[0][0] * SH_C0 + 0.5 - 1.0).abs() < 1e-6);
        bytes.push(0);
        assert!(parse_splat(&bytes, Path::new("a.splat")).is_err_and(|e| e.to_string().contains("byte 32")));
    }
}
