//! Third pass of the image loss: the window along rows, over the derivatives of SSIM (a symmetric window with zero padding
//! is its own adjoint).
//!
//! - Reads `ssim_gradients` (81 bytes a pixel), writes `row_gradients` (36 bytes), by pixel.
//! - Grid: one thread per strip of a row.
//!
//! Twin: `reference::image_loss`. Test: `tests/kernels/image_loss.rs`.

pub use crate::gpu::interface::image_loss_backward_rows::{Bindings, ImageLossBackwardRows, Params};
