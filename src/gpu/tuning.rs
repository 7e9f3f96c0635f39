//! Numbers that replace those that the program picks for a device, to measure which are best.

use std::str::FromStr;
use std::sync::OnceLock;

use super::error::GpuError;

/// The environment variable with the numbers of a program.
const VARIABLE: &str = "INSTGS_TUNING";

/// Names with their numbers; the kernels say which names there are (`kernels::Variant::tuned`).
#[derive(Clone, Debug, Default, PartialEq, Eq, serde::Serialize)]
pub struct Tuning(Vec<(String, u32)>);

impl Tuning {
    /// The tuning of variable `INSTGS_TUNING`, `name=number,...`; empty without it.
    ///
    /// # Errors
    /// [`GpuError::Tuning`], which quotes the first part that is not `name=number`; every later call repeats it.
    pub fn of_environment() -> Result<Self, GpuError> {
        static READ: OnceLock<Result<Tuning, String>> = OnceLock::new();
        let read = READ.get_or_init(|| std::env::var(VARIABLE).map_or(Ok(Tuning::default()), |text| text.parse()));
        read.clone().map_err(GpuError::Tuning)
    }

    /// True if all numbers are those that are picked for the device.
    pub fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// The names with their numbers, in the order given.
    pub fn numbers(&self) -> impl Iterator<Item = (&str, u32)> {
        self.0.iter().map(|(name, number)| (name.as_str(), *number))
    }
}

impl FromStr for Tuning {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let parts = text.split(',').filter(|part| !part.trim().is_empty());
        let number = |part: &str| {
            let (name, number) = part.split_once('=')?;
            Some((name.trim().to_owned(), number.trim().parse().ok()?))
        };
        parts
            .map(|part| number(part).ok_or_else(|| format!("{part:?} is not name=number")))
            .collect::<Result<_, _>>()
            .map(Self)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_of_names_and_numbers_is_read() {
        let tuning: Tuning = "tile_size=16, splats_unrolled=4,".parse().unwrap();
        assert_eq!(tuning.numbers().collect::<Vec<_>>(), [("tile_size", 16), ("splats_unrolled", 4)]);
        assert!(!tuning.is_empty() && "".parse::<Tuning>().unwrap().is_empty());
        for wrong in ["tile_size", "tile_size=", "tile_size=-8", "=,tile_size:8"] {
            assert!(wrong.parse::<Tuning>().is_err(), "{wrong}");
        }
    }
}
