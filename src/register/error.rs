//! Why objects could not be registered at all.

use crate::render::RenderError;
use crate::scene::CameraError;

/// What is wrong with the input of [`register`](super::register()); one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum RegisterError {
    /// An array of the cloud has another length than its means call for.
    #[error("the cloud has {len} {array} where {want} fit its means")]
    Cloud {
        /// Which array.
        array: &'static str,
        /// Its length.
        len: usize,
        /// The length that fits.
        want: usize,
    },
    /// There must be one label per Gaussian.
    #[error("{labels} labels for {gaussians} Gaussians: there must be one each")]
    LabelCount {
        /// Labels given.
        labels: usize,
        /// Gaussians of the cloud.
        gaussians: usize,
    },
    /// A camera cannot be used.
    #[error("{0}")]
    Camera(CameraError),
    /// An option is out of range.
    #[error("{option} is {value}, but must be {want}")]
    Option {
        /// Which option.
        option: &'static str,
        /// Its value.
        value: f64,
        /// What it may be.
        want: &'static str,
    },
    /// A view could not be rendered to check poses.
    #[error("view {view}: {error}")]
    View {
        /// The view's name.
        view: String,
        /// What is wrong.
        error: RenderError,
    },
    /// The device failed, or cannot hold an object.
    #[error(transparent)]
    Render(#[from] RenderError),
}
