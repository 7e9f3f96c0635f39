//! The errors of the pictures of a run.

use image::ImageError;
use instgs_io::IoError;
use instgs_vk::render::RenderError;

/// Each error is one line for the user.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// A file of the run or of its data set is missing or damaged, or a file cannot be written.
    #[error(transparent)]
    Io(#[from] IoError),
    /// A picture cannot be rendered.
    #[error(transparent)]
    Render(#[from] RenderError),
}

/// A picture cannot be encoded or compared with another one.
#[derive(Debug, thiserror::Error)]
pub enum PictureError {
    /// The number of bytes does not match the size, or the picture has no pixels.
    #[error("{bytes} bytes are no picture of {width}x{height} pixels")]
    Size {
        /// Number of bytes of the picture.
        bytes: usize,
        /// Width of the picture, pixels.
        width: u32,
        /// Height of the picture, pixels.
        height: u32,
    },
    /// The picture has more pixels than memory can address.
    #[error("is too large")]
    TooLarge,
    /// Photo and rendering of a view differ in size; each is width and height in pixels.
    #[error("the photograph has {}x{} pixels, the rendering {}x{}", photo.0, photo.1, rendering.0, rendering.1)]
    SizesDiffer {
        /// Size of the photo.
        photo: (u32, u32),
        /// Size of the rendering.
        rendering: (u32, u32),
    },
    /// The encoder of the file format failed.
    #[error(transparent)]
    Encoder(#[from] ImageError),
    /// A picture of a page.
    #[error("{of}, {caption}: {error}")]
    OnPage {
        /// What the picture shows.
        of: String,
        /// Caption of the picture.
        caption: String,
        /// What is wrong with it.
        error: Box<PictureError>,
    },
}
