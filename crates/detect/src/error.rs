//! Errors of making masks from a prompt.

use instgs_io::IoError;

/// Why masks could not be made from a prompt; the text is one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum DetectError {
    /// A file: a photo, a model, the runtime library, or an output.
    #[error(transparent)]
    Io(#[from] IoError),
    /// The prompt is empty, or longer than the detector reads.
    #[error("the prompt {prompt:?} {what}")]
    Prompt {
        /// Text of the prompt as given.
        prompt: String,
        /// What is wrong, and what to do.
        what: String,
    },
    /// An option is out of range.
    #[error("{option}: {reason}")]
    Option {
        /// Name of the option on the command line.
        option: &'static str,
        /// What is wrong with the value, and what is allowed.
        reason: String,
    },
    /// An error in one of the views.
    #[error("view {view}: {error}")]
    View {
        /// Name of the view's camera.
        view: String,
        /// What is wrong with the view.
        error: Box<DetectError>,
    },
    /// There are more masks than 16-bit ids.
    #[error(
        "view {view} brings the masks of all views to {count}, but there are 65535 ids; raise the box threshold, \
         ask for fewer things, or use fewer views"
    )]
    TooManyMasks {
        /// Name of the view without ids left.
        view: String,
        /// Number of masks up to and including this view.
        count: usize,
    },
    /// The program was built without the crates that run the models.
    #[error(
        "this program was built without text-prompt detection; build it with: cargo build --release \
         --features onnx"
    )]
    NotBuilt,
}

impl DetectError {
    /// Adds the name of a view to the error.
    #[cfg(feature = "onnx")]
    pub(super) fn in_view(self, view: &str) -> Self {
        Self::View { view: view.into(), error: Box::new(self) }
    }
}
