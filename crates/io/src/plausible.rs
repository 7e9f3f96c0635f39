//! What the size of a file makes plausible: a few kilobytes must not claim more than some 64 MB of memory.

use std::path::Path;

use crate::error::IoError;

/// What to do about a file that claims more Gaussians than its bytes make plausible.
pub(crate) const AS_PLY: &str = "write it as .ply with the program that it is from";
/// Number of Gaussians that are plausible in any file.
const FREE: u64 = 4096;
/// Gaussians per byte of a file that are plausible beyond those. A real position takes two bytes or more, so this leaves room for
/// clouds on a grid and for many equal Gaussians.
const MOST_PER_BYTE: u64 = 16;
/// Records of offsets of positions per byte that are plausible beyond [`FREE`]: of instances that hardly differ nearly all are zero.
const MOST_OFFSETS_PER_BYTE: u64 = 64;

/// The most Gaussians that are plausible in so many bytes of compressed data.
pub(crate) fn most_gaussians(bytes: u64) -> u64 {
    bytes.saturating_mul(MOST_PER_BYTE).saturating_add(FREE)
}

/// The most records of offsets that are plausible in so many bytes of coded offsets of positions.
pub(crate) fn most_offsets(bytes: u64) -> u64 {
    bytes.saturating_mul(MOST_OFFSETS_PER_BYTE).saturating_add(FREE)
}

/// Checks that readers will not refuse a file that is written.
///
/// # Errors
/// There are more Gaussians than are plausible in its bytes.
pub(crate) fn check_written(gaussians: usize, bytes: usize, path: &Path) -> Result<(), IoError> {
    if gaussians as u64 <= most_gaussians(bytes as u64) {
        return Ok(());
    }
    let what = format!(
        "cannot write: {gaussians} Gaussians in {bytes} bytes are nearly all equal, and readers would refuse them"
    );
    Err(IoError::new(path, what).advise("use .ply or .instgs"))
}
