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
    /// The number of bytes does not match width and height in pixels, or the picture has no pixels.
    #[error("{0} bytes are no picture of {1}x{2} pixels")]
    Size(usize, u32, u32),
    /// The picture has more pixels than memory can address.
    #[error("is too large")]
    TooLarge,
    /// Photo and rendering of a view differ in size; each is width and height in pixels.
    #[error("the photograph has {}x{} pixels, the rendering {}x{}", .0[0], .0[1], .1[0], .1[1])]
    SizesDiffer([u32; 2], [u32; 2]),
    /// The encoder of the file format failed.
    #[error(transparent)]
    Encoder(#[from] ImageError),
    /// A picture of a page, named by what it shows and its caption.
    #[error("{0}: {1}")]
    OnPage(String, Box<PictureError>),
}
