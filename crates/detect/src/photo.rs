//! The photo of a view as the models see it.

use crate::io::{IoError, View, load_view};

/// The pixels of a photo as it is stored: with its lens distortion, because masks are drawn over the photo.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Photo {
    /// Width in pixels.
    pub width: usize,
    /// Height in pixels.
    pub height: usize,
    /// Red, green, blue in the file's own encoding, row by row from the top.
    pub rgb: Vec<[u8; 3]>,
}

impl Photo {
    /// Reads the photo of a view. Coverage is left out, as the models' own programs do; pixels that training ignores are
    /// looked at like all others.
    ///
    /// # Errors
    /// Those of [`load_view`].
    pub fn load(view: &View) -> Result<Self, IoError> {
        let stored = View { distortion: None, mask_path: None, ..view.clone() };
        let image = load_view(&stored, None)?.image;
        let rgb = image.rgba.iter().map(|&[r, g, b, _]| [r, g, b]).collect();
        Ok(Self { width: image.width as usize, height: image.height as usize, rgb })
    }
}
