//! The results of a scene as they are kept in its folder, with what they were made by.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::origin::Origin;
use crate::results::SceneResult;
use instgs_io::IoError;
use instgs_io::json::{read_json, write_json};

/// File in the folder of a scene.
const RESULT: &str = "result.json";

/// A result, with what it was made by.
#[derive(Serialize, Deserialize)]
pub(super) struct Kept {
    pub(super) made_by: MadeBy,
    pub(super) result: SceneResult,
}

impl Kept {
    /// The result in a scene's folder; `None` if there is none that this program can read.
    pub(super) fn read(folder: &Path) -> Option<Self> {
        read_json(&folder.join(RESULT)).ok()
    }

    pub(super) fn write(&self, folder: &Path) -> Result<(), IoError> {
        write_json(&folder.join(RESULT), self)
    }
}

/// Everything that a result depends on.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(super) struct MadeBy {
    /// The scene with its size, seeds and configuration, as text.
    pub(super) settings: String,
    /// Which rivals and ablations were measured, as text.
    pub(super) rows: String,
    /// Network, weights and range of LPIPS; `None` without it.
    pub(super) lpips: Option<String>,
    /// The program and the device.
    pub(super) origin: Origin,
}

impl MadeBy {
    /// Why a result made by this must not be in one table with those that are made by `now`; `None` if it may. More or fewer rows
    /// leave cells empty, and the head of the tables names all devices.
    pub(super) fn difference_beside(&self, now: &Self) -> Option<&'static str> {
        let both_have_lpips = self.lpips.is_some() && now.lpips.is_some();
        if self.origin.program != now.origin.program {
            Some("another build of the program")
        } else if self.settings != now.settings {
            Some("other settings")
        } else if both_have_lpips && self.lpips != now.lpips {
            Some("another LPIPS")
        } else {
            None
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn made_by() -> MadeBy {
        let origin = Origin { program: "0.1.0 (a)".into(), device: "A".into() };
        MadeBy { settings: "s".into(), rows: "r".into(), lpips: Some("alex".into()), origin }
    }

    /// A result is taken for one of now only if nothing that it depends on differs.
    #[test]
    fn a_result_of_anything_else_is_not_of_now() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        assert!(Kept::read(folder.path()).is_none());
        let result = SceneResult { name: "a".into(), origin: made_by().origin, ..SceneResult::default() };
        Kept { made_by: made_by(), result: result.clone() }.write(folder.path())?;
        let kept = Kept::read(folder.path()).ok_or("nothing is there")?;
        assert_eq!((&kept.made_by, &kept.result), (&made_by(), &result));
        type Change = fn(&mut MadeBy);
        let changes: [(Change, Option<&str>); 6] = [
            (|m| m.settings.push('x'), Some("other settings")),
            (|m| m.origin.program = "0.1.0 (b)".into(), Some("another build of the program")),
            (|m| m.lpips = Some("vgg".into()), Some("another LPIPS")),
            (|m| m.lpips = None, None),
            (|m| m.rows.push('x'), None),
            (|m| m.origin.device = "B".into(), None),
        ];
        for (change, beside) in changes {
            let mut now = made_by();
            change(&mut now);
            assert_ne!(kept.made_by, now, "{now:?}");
            assert_eq!(kept.made_by.difference_beside(&now), beside, "{now:?}");
        }
        // What older versions wrote is of another program.
        std::fs::write(folder.path().join(RESULT), r#"{"made_by": "text", "result": {}}"#)?;
        assert!(Kept::read(folder.path()).is_none());
        Ok(())
    }
}
