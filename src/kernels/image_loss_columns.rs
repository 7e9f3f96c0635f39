//! Second pass of the image loss: the window along columns, SSIM, and its derivatives by the moments.
//!
//! - Reads `row_moments` by pixel (135 bytes a pixel: 2.25 times 60). Writes `ssim_gradients` by pixel (36 bytes) and
//!   `ssim_sums` by thread.
//! - Grid: one thread per strip of 8 pixels of a column, neighbouring threads in neighbouring columns.
//! - With a1 = 2 x y + C1, a2 = 2 (xy - x y) + C2, b1 = x^2 + y^2 + C1, b2 = var x + var y + C2: SSIM = a1 a2 / (b1 b2),
//!   and the derivatives treat the means of x, x^2 and xy as independent.
//!
//! Twin: `reference::image_loss`. Test: `tests/kernels/image_loss.rs`.

pub use crate::gpu::interface::image_loss_columns::{Bindings, ImageLossColumns, Params};
