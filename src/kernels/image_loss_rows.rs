//! First pass of the image loss: the 11x11 SSIM window along rows.
//!
//! The loss is `(1 - lambda) L1 + lambda (1 - SSIM)`, SSIM with a Gaussian window of sigma 1.5, zero padding, mean over
//! pixels and channels (INRIA's). Its four passes are separable: rows and columns of five moments, then rows and columns
//! of the three derivatives. A thread makes `STRIP` = 8 neighbouring pixels, so that it reads 18 for 8 instead of 11
//! for each: loads are what a CPU driver pays for.
//!
//! - Reads `colors` (rgb over the background) and `targets` (RGBA of 8 bits; its last byte is 0 for a pixel that does
//!   not count, else 1 + 254 times its coverage, and the target is blended over the background).
//! - Writes `row_moments` by pixel: windowed means of picture, target, their squares and product.
//! - Grid: one thread per strip of a row. Bytes per pixel: 45 read (2.25 times 20), 60 written.
//! - A pixel that does not count shows the target in both pictures: no error, no gradient, and its neighbours do not see
//!   what was rendered there.
//!
//! Twin: `reference::image_loss`. Test: `tests/kernels/image_loss.rs`.

pub use crate::gpu::interface::image_loss_rows::{Bindings, ImageLossRows, Params};
