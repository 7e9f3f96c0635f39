//! How repetitions are looked for.

use crate::register::error::RegisterError;
use crate::register::options::RegisterOptions;

/// Options of [`find_alike`](super::find_alike()).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FindOptions {
    /// Repetitions may be of another size: from this part of the selected one to its inverse. 1 = the same size.
    pub min_scale: f64,
    /// A place is a repetition if the object and what is there agree this well, both ways, 0..=1; or if the object is found
    /// nearly whole beside something else. Of trained cars, chairs, tables, vases and trees right places have 0.73 to 0.99
    /// but for one chair below a table (0.68), wrong ones that stand on something at most 0.74.
    pub min_score: f64,
    /// The same for a part of a wall: its pattern of colours and that of a place correlate by this much, above 0,
    /// at most 1. Of two trained facades nearly all windows have 0.66 to 0.97, what is none at most 0.58.
    pub min_likeness: f64,
    /// How surfaces are made of Gaussians.
    pub surfaces: RegisterOptions,
}

impl Default for FindOptions {
    fn default() -> Self {
        let surfaces = RegisterOptions { max_relative_scale: 0.1, min_opacity: 0.2, ..RegisterOptions::default() };
        Self { min_scale: 1.0, min_score: 0.75, min_likeness: 0.6, surfaces }
    }
}

impl FindOptions {
    /// Repetitions of about half to twice the size.
    pub const SIMILAR: f64 = 0.5;

    /// The usual ones: repetitions of the same size, or, with `other_sizes`, of about half to twice the size.
    pub fn of_sizes(other_sizes: bool) -> Self {
        let same = Self::default();
        Self { min_scale: if other_sizes { Self::SIMILAR } else { same.min_scale }, ..same }
    }

    /// Checks the ranges.
    pub(super) fn validate(&self) -> Result<(), RegisterError> {
        self.surfaces.validate()?;
        let part = |v: f64| v > 0.0 && v <= 1.0;
        for (option, value, is_right) in [
            // Below a tenth a scene's every corner is a repetition.
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
