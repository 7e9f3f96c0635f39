//! The photo of a view, as the models see it.

use instgs_io::{IoError, View, load_view};

/// Pixels of a stored photo, with its lens distortion, since masks belong to stored photos.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Photo {
    /// Width of the photo, pixels.
    pub width: usize,
    /// Height of the photo, pixels.
    pub height: usize,
    /// Red, green and blue in the file's own encoding, row by row from the top.
    pub rgb: Vec<[u8; 3]>,
}

impl Photo {
    /// Reads the photo of a view. Alpha is dropped, as in the models' own programs; pixels that training ignores are
    /// used like all others.
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
