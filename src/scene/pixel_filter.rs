//! How splats are widened so that none falls between pixels.

/// The variance that is added to every projected splat, and what becomes of its opacity. A scene is drawn with the filter
/// that it was trained with: a narrower one shows what is finer than a pixel sharper, in pictures that are that sharp.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PixelFilter {
    /// Added to the projected variances, px^2. A pixel's own square has 1/12.
    pub dilation_px2: f32,
    /// Whether opacity makes up for the dilation (Mip-Splatting), so that a small splat does not get heavier.
    pub antialias: bool,
}

impl Default for PixelFilter {
    /// That of 3DGS: 0.3 px^2, opacity as it is.
    fn default() -> Self {
        Self { dilation_px2: 0.3, antialias: false }
    }
}

impl PixelFilter {
    /// True if the dilation is that of 3DGS, which other viewers draw with.
    pub fn has_usual_dilation(self) -> bool {
        self.dilation_px2 == Self::default().dilation_px2
    }
}

/// What a user asks of the filter instead of the scene's.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct PixelFilterChoice {
    /// The dilation, px^2, if it is not to be the scene's.
    pub dilation_px2: Option<f32>,
    /// The compensation, if it is not to be the scene's.
    pub antialias: Option<bool>,
}

impl PixelFilterChoice {
    /// The filter of a scene, but for what was chosen.
    pub fn over(self, scenes: PixelFilter) -> PixelFilter {
        PixelFilter {
            dilation_px2: self.dilation_px2.unwrap_or(scenes.dilation_px2),
            antialias: self.antialias.unwrap_or(scenes.antialias),
        }
    }
}
