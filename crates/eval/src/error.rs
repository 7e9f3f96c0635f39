//! Why pictures could not be compared.

use crate::lpips::LpipsError;
use instgs_io::IoError;
use instgs_vk::render::RenderError;

/// An evaluation failed. Its text is one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// A photo could not be read.
    #[error(transparent)]
    Io(#[from] IoError),
    /// A view could not be rendered.
    #[error("view {view}: {error}")]
    Render {
        /// Name of the failed view.
        view: String,
        /// The renderer's error.
        error: RenderError,
    },
    /// A view's two pictures cannot be compared.
    #[error("view {view}: {error}")]
    Pair {
        /// Name of the failed view.
        view: String,
        /// Why the pair cannot be compared.
        error: PairError,
    },
    /// LPIPS could not be computed.
    #[error(transparent)]
    Lpips(#[from] LpipsError),
    /// The dataset has no views, so there is no mean.
    #[error("no views to evaluate")]
    NoViews,
}

/// Two pictures that cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PairError {
    /// A buffer's length is not width x height.
    #[error("the {what} has {len} pixels, not {width}x{height}")]
    Size {
        /// `render`, `target` or `mask`.
        what: &'static str,
        /// Number of pixels of the buffer.
        len: usize,
        /// Expected width, pixels.
        width: u32,
        /// Expected height, pixels.
        height: u32,
    },
    /// A value is NaN or infinite.
    #[error("the {what} is not finite at pixel ({x}, {y})")]
    NotFinite {
        /// `render` or `target`.
        what: &'static str,
        /// Column of the first such pixel.
        x: usize,
        /// Row of the first such pixel.
        y: usize,
    },
    /// The mask excludes every pixel, or the pictures have none.
    #[error("no pixel of the photo counts: its mask excludes all of them; remove the view")]
    NothingToCompare,
}
