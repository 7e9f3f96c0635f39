//! A rendered image on the host.

/// Colour, alpha and depth of one view, row by row from the top.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Picture {
    /// Width of the picture, pixels.
    pub width: u32,
    /// Height of the picture, pixels.
    pub height: u32,
    /// rgb blended over the background, and alpha = 1 - T. Same encoding as the training images (sRGB values).
    pub colors: Vec<[f32; 4]>,
    /// Expected view depth: weighted mean of the blended splats' depths, 0 where nothing was blended.
    pub depths: Vec<f32>,
}

impl Picture {
    /// 8-bit rgb, rounded to nearest; values outside 0..1 are clamped.
    pub fn rgb8(&self) -> Vec<u8> {
        let quantise = |v: f32| (v.clamp(0.0, 1.0) * 255.0 + 0.5) as u8;
        self.colors.iter().flat_map(|c| [quantise(c[0]), quantise(c[1]), quantise(c[2])]).collect()
    }
}
