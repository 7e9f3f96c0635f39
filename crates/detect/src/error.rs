//! Why there are no masks.

use crate::io::IoError;

/// Masks could not be made from a prompt. Its text is one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum DetectError {
    /// A file: a photo, a model, the runtime library, or what was to be written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The prompt says nothing, or more than the detector reads.
    #[error("the prompt {prompt:?} {what}")]
    Prompt {
        /// What was asked for.
        prompt: String,
        /// What is wrong, and what to do.
        what: String,
    },
    /// An option is out of range.
    #[error("{option}: {reason}")]
    Option {
        /// The option's name.
        option: &'static str,
        /// What is wrong, and what is allowed.
        reason: String,
    },
    /// One of the views.
    #[error("view {view}: {error}")]
    View {
        /// The view's name.
        view: String,
        /// What is wrong.
        error: Box<DetectError>,
    },
    /// More masks than ids.
    #[error(
        "view {view} brings the masks of all views to {count}, and there are ids for 65535; raise the box threshold, ask for \
         fewer things, or use fewer views"
    )]
    TooManyMasks {
        /// The view that has no ids left.
        view: String,
        /// Masks up to and with this view.
        count: usize,
    },
    /// Built without the crates that run the models.
    #[error(
        "this program was built without the models that find things by name; build it with: cargo build --release \
         --features onnx"
    )]
    NotBuilt,
}

impl DetectError {
    /// The error of a view.
    #[cfg(feature = "onnx")]
    pub(super) fn in_view(self, view: &str) -> Self {
        Self::View { view: view.into(), error: Box::new(self) }
    }
}
