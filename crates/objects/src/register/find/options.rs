//! Options of the search for repetitions.

use crate::register::error::RegisterError;
use crate::register::options::RegisterOptions;

/// Options of [`find_alike`](super::find_alike()).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FindOptions {
    /// Repetitions may differ in size: from this part of the selected object's size to its inverse. 1 = the same size.
    pub min_scale: f64,
    /// Least score of a repetition, the agreement in both directions, 0..=1; an object found nearly whole beside
    /// something else may have a lower one.
    pub min_score: f64,
    /// For a part of a wall: least correlation of colour patterns, above 0 and at most 1.
    pub min_likeness: f64,
    /// How surfaces are sampled from Gaussians.
    pub surfaces: RegisterOptions,
}

impl Default for FindOptions {
    fn default() -> Self {
        let surfaces = RegisterOptions { max_relative_scale: 0.1, min_opacity: 0.2, ..RegisterOptions::default() };
        Self { min_scale: 1.0, min_score: 0.75, min_likeness: 0.6, surfaces }
    }
}

impl FindOptions {
    /// Value of `min_scale` for repetitions of about half to twice the size.
    pub const SIMILAR: f64 = 0.5;

    /// The default options; with `other_sizes`, repetitions may have about half to twice the size.
    pub fn of_sizes(other_sizes: bool) -> Self {
        let same = Self::default();
        Self { min_scale: if other_sizes { Self::SIMILAR } else { same.min_scale }, ..same }
    }

    /// Checks that all options are in range.
    pub(super) fn validate(&self) -> Result<(), RegisterError> {
        self.surfaces.validate()?;
        let part = |v: f64| v > 0.0 && v <= 1.0;
        for (option, value, is_right) in [
            // Below a tenth every corner of a scene is a repetition.
            ("min_scale", self.min_scale, (0.1..=1.0).contains(&self.min_scale)),
            ("min_score", self.min_score, part(self.min_score)),
            ("min_likeness", self.min_likeness, part(self.min_likeness)),
        ] {
            if !is_right {
                let want = if option == "min_scale" { "from 0.1 to 1" } else { "above 0, at most 1" };
                return Err(RegisterError::Option { option, value, want });
            }
        }
        Ok(())
    }
}
