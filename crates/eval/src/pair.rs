//! A rendered picture beside the photo of the same view.

use crate::error::PairError;

/// Two pictures of one size, row by row from the top, rgb in 0..=1 (sRGB values). Where a pixel is masked, the render
/// holds the photo's pixel, so that no metric sees a difference there.
#[derive(Clone, Debug, PartialEq)]
pub struct PicturePair {
    width: u32,
    height: u32,
    render: Vec<[f32; 3]>,
    target: Vec<[f32; 3]>,
    /// By pixel: true if it counts.
    valid: Vec<bool>,
    valid_pixels: usize,
}

impl PicturePair {
    /// Checks and prepares two pictures of `width * height` pixels: both are clamped to 0..=1, and where `valid` is
    /// false the render is replaced by the target. Without `valid` every pixel counts.
    ///
    /// # Errors
    /// A buffer of another length, a value that is not finite in a pixel that counts, or no pixel that counts.
    pub fn new(
        (width, height): (u32, u32),
        render: &[[f32; 3]],
        target: &[[f32; 3]],
        valid: Option<&[bool]>,
    ) -> Result<Self, PairError> {
        let pixels = width as usize * height as usize;
        let check = |what, len| {
            if len == pixels { Ok(()) } else { Err(PairError::Size { what, len, width, height }) }
        };
        check("render", render.len())?;
        check("target", target.len())?;
        check("mask", valid.map_or(pixels, <[bool]>::len))?;
        let counts = |i: usize| valid.is_none_or(|v| v[i]);
        for (what, picture) in [("render", render), ("target", target)] {
            let bad = |(i, rgb): (usize, &[f32; 3])| counts(i) && !rgb.iter().all(|v| v.is_finite());
            if let Some(i) = picture.iter().enumerate().position(bad) {
                return Err(PairError::NotFinite { what, x: i % width as usize, y: i / width as usize });
            }
        }
        let valid: Vec<bool> = (0..pixels).map(counts).collect();
        let valid_pixels = valid.iter().filter(|&&counts| counts).count();
        if valid_pixels == 0 {
            return Err(PairError::NothingToCompare);
        }
        let target: Vec<_> = target.iter().map(clamped).collect();
        let pick = |i: usize| if counts(i) { clamped(&render[i]) } else { target[i] };
        let render = (0..pixels).map(pick).collect();
        Ok(Self { width, height, render, target, valid, valid_pixels })
    }

    /// The same pictures; only pixels that counted before and are `true` in `part` count.
    ///
    /// # Errors
    /// `part` has another length, or no pixel counts.
    pub fn within(&self, part: &[bool]) -> Result<Self, PairError> {
        let (width, height) = (self.width, self.height);
        if part.len() != self.valid.len() {
            return Err(PairError::Size { what: "part", len: part.len(), width, height });
        }
        let valid: Vec<bool> = self.valid.iter().zip(part).map(|(&counts, &is_in_part)| counts && is_in_part).collect();
        Self::new((width, height), &self.render, &self.target, Some(&valid))
    }

    /// The same photo beside a render of other colours, `color` by pixel.
    #[must_use]
    pub fn recolored(&self, color: impl Fn(usize) -> [f32; 3]) -> Self {
        let pick = |i: usize| if self.valid[i] { clamped(&color(i)) } else { self.target[i] };
        Self { render: (0..self.render.len()).map(pick).collect(), ..self.clone() }
    }

    /// Width of both pictures, pixels.
    pub fn width(&self) -> u32 {
        self.width
    }

    /// Height of both pictures, pixels.
    pub fn height(&self) -> u32 {
        self.height
    }

    /// The rendered picture, 0..=1, with the target's pixels where it is masked.
    pub fn render(&self) -> &[[f32; 3]] {
        &self.render
    }

    /// The photo's pixels, 0..=1.
    pub fn target(&self) -> &[[f32; 3]] {
        &self.target
    }

    /// True if the pixel of this index counts.
    pub fn counts(&self, pixel: usize) -> bool {
        self.valid[pixel]
    }

    /// Number of pixels that count, at least 1.
    pub fn valid_pixels(&self) -> usize {
        self.valid_pixels
    }
}

/// A colour in 0..=1. A NaN is in a pixel that does not count, but SSIM's windows would spread it.
fn clamped(rgb: &[f32; 3]) -> [f32; 3] {
    rgb.map(|v| if v.is_nan() { 0.0 } else { v.clamp(0.0, 1.0) })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clamps_masks_and_checks() -> Result<(), PairError> {
        let render = [[-1.0, 0.5, 2.0], [f32::NAN; 3]];
        let target = [[0.25; 3], [0.75; 3]];
        let pair = PicturePair::new((2, 1), &render, &target, Some(&[true, false]))?;
        assert_eq!(pair.render(), [[0.0, 0.5, 1.0], [0.75; 3]]);
        assert_eq!((pair.target(), pair.valid_pixels()), (&target[..], 1));
        let hole = [[0.25; 3], [f32::NAN; 3]];
        assert_eq!(PicturePair::new((2, 1), &render, &hole, Some(&[true, false]))?.render()[1], [0.0; 3]);
        let error = |size, valid: Option<&[bool]>| PicturePair::new(size, &render, &target, valid).err();
        assert_eq!(error((2, 1), None), Some(PairError::NotFinite { what: "render", x: 1, y: 0 }));
        assert_eq!(error((2, 1), Some(&[false; 2])), Some(PairError::NothingToCompare));
        assert_eq!(error((2, 2), None), Some(PairError::Size { what: "render", len: 2, width: 2, height: 2 }));
        assert!(matches!(error((2, 1), Some(&[true])), Some(PairError::Size { what: "mask", .. })));
        assert_eq!(PicturePair::new((0, 0), &[], &[], None), Err(PairError::NothingToCompare));
        Ok(())
    }

    #[test]
    fn a_part_has_only_pixels_that_counted() -> Result<(), PairError> {
        let (render, target) = ([[0.0; 3], [0.5; 3], [1.0; 3]], [[1.0; 3]; 3]);
        let pair = PicturePair::new((3, 1), &render, &target, Some(&[true, true, false]))?;
        let part = pair.within(&[false, true, true])?;
        assert_eq!((part.render(), part.valid_pixels()), (&[[1.0; 3], [0.5; 3], [1.0; 3]][..], 1));
        assert_eq!(pair.within(&[false, false, true]), Err(PairError::NothingToCompare));
        assert!(matches!(pair.within(&[true; 2]), Err(PairError::Size { what: "part", len: 2, .. })));
        Ok(())
    }
}
