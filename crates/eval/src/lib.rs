//! Picture quality: PSNR, SSIM, LPIPS.
//!
//! A [`PicturePair`] is a rendered picture and its photo, checked, clamped and masked once, so that every metric sees
//! the same pixels: [`psnr`], [`ssim`], and [`Lpips::distance`] if the user has the network's weights. [`evaluate`]
//! renders a dataset's views and compares each with its photo. Pictures are compared as rendered, in f32: clamped to
//! 0..1, never rounded to 8 bits.

pub mod bench;
mod error;
mod exposure;
pub mod lpips;
mod pair;
mod psnr;
mod report;
mod sizes;
mod ssim;
mod views;

pub use error::{EvalError, PairError};
pub use exposure::with_exposures;
pub use lpips::{InputRange, Lpips, LpipsError, Net};
pub use pair::PicturePair;
pub use psnr::{MAX_PSNR_DB, psnr};
pub use report::{EvalReport, Extras, Metrics, ViewMetrics};
pub use sizes::{Bytes, Counts};
pub use ssim::ssim;
pub use views::{Evaluated, SceneOfViews, composited, evaluate, pair_of};
