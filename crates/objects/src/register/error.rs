//! Errors of registration.

use instgs_vk::render::RenderError;
use instgs_vk::scene::CameraError;

/// Why [`register`](super::register()) could not run; the text is one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum RegisterError {
    /// An array of the cloud does not have the length that its means require.
    #[error("the cloud has {len} {array} but its means need {want}")]
    Cloud {
        /// Name of the array in the cloud.
        array: &'static str,
        /// Actual length of the array.
        len: usize,
        /// Length that the means require.
        want: usize,
    },
    /// The number of labels is not the number of Gaussians.
    #[error("{labels} labels for {gaussians} Gaussians: there must be one each")]
    LabelCount {
        /// Number of labels given.
        labels: usize,
        /// Number of Gaussians of the cloud.
        gaussians: usize,
    },
    /// A camera is invalid; the text says why.
    #[error("{0}")]
    Camera(CameraError),
    /// An option is out of range.
    #[error("{option} is {value}, but must be {want}")]
    Option {
        /// Name of the option that is out of range.
        option: &'static str,
        /// Value that was given.
        value: f64,
        /// Values that are allowed.
        want: &'static str,
    },
    /// A view could not be rendered to compare poses.
    #[error("view {view}: {error}")]
    View {
        /// Name of the view's camera.
        view: String,
        /// What the renderer reports.
        error: RenderError,
    },
    /// The device failed, or an object does not fit on it.
    #[error(transparent)]
    Render(#[from] RenderError),
}
