//! `exposures.json` of a run: the exposure of every training photo, as training found it. No scene needs it; a later phase
//! of the same run starts from it.

use std::path::Path;

use serde::{Deserialize, Serialize};

use crate::IoError;
use crate::json::{read_json, write_json};

/// The exposure of a photo.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct PhotoExposure {
    /// Name of the photo's camera.
    pub view: String,
    /// Rows (M_r, b_r) of the map M rgb + b from the scene's colours to the photo's; sRGB values, 0..=1.
    pub photo_from_scene: [[f32; 4]; 3],
}

/// Writes the exposures of a run.
///
/// # Errors
/// The file cannot be written.
pub fn write_exposures(path: &Path, exposures: &[PhotoExposure]) -> Result<(), IoError> {
    write_json(path, exposures)
}

/// Reads the exposures of a run.
///
/// # Errors
/// The file is missing or damaged, or holds a number that is not finite.
pub fn read_exposures(path: &Path) -> Result<Vec<PhotoExposure>, IoError> {
    let exposures: Vec<PhotoExposure> = read_json(path)?;
    let is_bad = |exposure: &&PhotoExposure| !exposure.photo_from_scene.as_flattened().iter().all(|v| v.is_finite());
    match exposures.iter().find(is_bad) {
        Some(bad) => Err(IoError::new(path, format!("the exposure of {} has a number that is not finite", bad.view))
            .advise("remove the file: exposures then begin unchanged")),
        None => Ok(exposures),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn exposures_come_back_and_bad_ones_are_refused() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("exposures.json");
        let written = [PhotoExposure { view: "a b.png".into(), photo_from_scene: [[1.5, 0.25, -0.125, 1e-3]; 3] }];
        write_exposures(&path, &written)?;
        assert_eq!(read_exposures(&path)?, written);
        let text = std::fs::read_to_string(&path)?.replacen("1.5", "1e39", 1);
        std::fs::write(&path, text)?;
        let message = read_exposures(&path).err().ok_or("read")?.to_string();
        assert!(message.contains("exposures.json"), "{message}");
        Ok(())
    }
}
