//! What the size of a file makes plausible: a few kilobytes must not claim more than some 64 MB of memory.

/// Number of Gaussians that are plausible in any file.
const FREE: u64 = 4096;
/// Gaussians per byte of a file that are plausible beyond those. A real position takes two bytes at least, however it is coded.
const MOST_PER_BYTE: u64 = 16;

/// The most Gaussians that are plausible in so many bytes of compressed data.
pub(crate) fn most_gaussians(bytes: u64) -> u64 {
    bytes.saturating_mul(MOST_PER_BYTE).saturating_add(FREE)
}
