//! Last pass of the image loss: the window along columns, then dL/dpicture.
//!
//! - Reads `row_gradients`, `colors`, `targets`; writes `cotangents` by pixel (rgb, and 0 for alpha) and `error_sums` by
//!   thread (absolute and squared error, for the progress report).
//! - Grid: one thread per strip of a column. Bytes per pixel: 101 read, 16 written.
//! - dL/dx = ((1 - lambda) sign(x - y) - lambda (W g_x + 2 x W g_xx + y W g_xy)) / (3 pixels); sign(0) = 0.
//!
//! Twin: `reference::image_loss`. Test: `tests/kernels/image_loss.rs`.

pub use crate::gpu::interface::image_loss_backward_columns::{Bindings, ImageLossBackwardColumns, Params};
