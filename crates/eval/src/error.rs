//! Why pictures could not be compared.

use crate::lpips::LpipsError;
use crate::io::IoError;
use crate::render::RenderError;

/// An evaluation failed. Its text is one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum EvalError {
    /// A photo could not be read.
    #[error(transparent)]
    Io(#[from] IoError),
    /// A view could not be rendered.
    #[error("view {view}: {error}")]
    Render {
        /// The view's name.
        view: String,
        /// What is wrong.
        error: RenderError,
    },
    /// A view's two pictures cannot be compared.
    #[error("view {view}: {error}")]
    Pair {
        /// The view's name.
        view: String,
        /// What is wrong.
        error: PairError,
    },
    /// The perceptual metric.
    #[error(transparent)]
    Lpips(#[from] LpipsError),
    /// There is nothing to take a mean of.
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
        /// Its pixels.
        len: usize,
        /// Expected width.
        width: u32,
        /// Expected height.
        height: u32,
    },
    /// A value is NaN or infinite.
    #[error("the {what} is not finite at pixel ({x}, {y})")]
    NotFinite {
        /// `render` or `target`.
        what: &'static str,
        /// Column.
        x: usize,
        /// Row.
        y: usize,
    },
    /// The mask leaves no pixel, or the pictures have none.
    #[error("no pixel of the photo counts: its mask excludes all of them; remove the view")]
    NothingToCompare,
}
