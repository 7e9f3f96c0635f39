//! `.sog` (PlayCanvas, version 2): quantised clouds as images of one pixel per Gaussian.
//!
//! A ZIP archive, or a folder, of `meta.json` and lossless WebP images that it names. Pixel i, counted by rows from the top
//! left, belongs to Gaussian i; pixels beyond `count` are ignored.
//!
//! - `means`, two images: low and high bytes of 16-bit numbers q for x, y and z. n = min + (max - min) q / 65535 by axis,
//!   the coordinate is sign(n) (e^|n| - 1).
//! - `quats`: alpha 252 to 255 names the component of (w, x, y, z) that is largest in magnitude, and positive; red, green
//!   and blue are the others in that order, as bytes over -1/sqrt 2..1/sqrt 2.
//! - `scales`: indices into a codebook of log scales.
//! - `sh0`: indices into a codebook of SH coefficients 0; alpha is the opacity.
//! - `shN`, optional: an image of up to 65536 palette entries, 64 a row, each a run of 3, 8 or 15 pixels (SH degree 1, 2, 3),
//!   a pixel being red, green and blue of a coefficient as indices into a codebook; and an image of labels, the low byte of
//!   the entry's number in red, the high one in green.
//!
//! Codebooks have 256 values. Axes, order and signs of SH are those of INRIA's `.ply`, as in all known writers. Opacity
//! compensation is `antialias` in the specification and `"model": "antialiased"` in files of splat-transform from 3.2 on;
//! both are read and written.

mod archive;
mod codebook;
mod folder;
mod image;
mod meta;
mod palette;
mod read;
#[cfg(test)]
mod tests;
mod write;

use instgs_vk::scene::Gaussians;

pub use folder::write_sog_folder;
pub use read::{is_unpacked, parse_sog, read_sog};
pub use write::{WrittenSog, sog_bytes, write_sog};

/// The contents of a `.sog` file or folder.
#[derive(Clone, Debug, PartialEq)]
pub struct SogCloud {
    /// The Gaussians, in the order of the file.
    pub gaussians: Gaussians,
    /// Whether the cloud was trained with opacity compensation.
    pub antialias: bool,
    /// Length of the file, or of `meta.json` and the images that it names, bytes.
    pub file_bytes: u64,
}
