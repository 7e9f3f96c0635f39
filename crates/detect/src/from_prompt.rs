//! From photos and a prompt to a folder of masks.

use std::path::Path;

use super::DetectError;
use super::boxes::DetectOptions;
use super::library::RuntimeOptions;
use super::prompt::Prompt;
use super::report::{PromptReport, ViewMasks};
use instgs_io::View;

/// File with box, phrase and score of every mask, in the folder of the masks; written last.
pub const BOXES: &str = "boxes.json";

/// Options of [`masks_from_prompt`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PromptOptions {
    /// Thresholds of the detector.
    pub detect: DetectOptions,
    /// How the models are run.
    pub runtime: RuntimeOptions,
}

impl PromptOptions {
    /// Checks the options that do not depend on files.
    ///
    /// # Errors
    /// A threshold outside of 0..=1.
    pub fn check(&self) -> Result<(), DetectError> {
        let DetectOptions { box_threshold, text_threshold, overlap } = self.detect;
        let fractions =
            [("--box-threshold", box_threshold), ("--text-threshold", text_threshold), ("--overlap", overlap)];
        for (option, value) in fractions {
            if !(0.0..=1.0).contains(&value) {
                return Err(DetectError::Option { option, reason: format!("is {value}, but must be from 0 to 1") });
            }
        }
        Ok(())
    }
}

/// Finds the objects named by the prompt in each view's photo. Writes `OUT/NAME.png` per view (16-bit ids, 0 where
/// nothing was found), `OUT/categories.json` (the phrase of each id) and `OUT/boxes.json` (box, phrase and score of
/// each id). An id belongs to one view only: which ids of different views mean the same object is not known. `models`
/// is the folder with `models.json`; `done` is called for each view after its mask was written.
///
/// One view is in memory at a time: its photo, its image of ids, one mask at the photo's size, and the best small mask
/// of each box.
///
/// # Errors
/// Options, model files, the runtime library and the length of the prompt are checked before the first photo. Later, a
/// photo that cannot be read, and more masks than ids. Without the feature `onnx`: always [`DetectError::NotBuilt`].
#[cfg(feature = "onnx")]
pub fn masks_from_prompt(
    views: &[&View],
    prompt: &Prompt,
    models: &Path,
    options: &PromptOptions,
    out: &Path,
    done: &mut dyn FnMut(&str, &ViewMasks),
) -> Result<PromptReport, DetectError> {
    use instgs_io::masks::CATEGORIES;
    use instgs_io::{write_boxes, write_categories, write_mask};
    use instgs_vk::scene::Boxes;

    let mut finder = super::find::Finder::open(models, prompt, options)?;
    instgs_io::run_folder::create(out)?;
    let mut report = PromptReport::new(prompt.phrases());
    let mut boxes = Boxes::default();
    for view in views {
        let name = &view.camera.name;
        let found = finder.find(view)?;
        write_mask(&out.join(format!("{name}.png")), &found.mask)?;
        report.add(name, &found);
        done(name, &found);
        boxes.views.insert(name.clone(), found.boxes);
    }
    let of_ids = boxes.views.values().flatten().filter_map(|b| Some((b.id?, b.category.clone()?)));
    write_categories(&out.join(CATEGORIES), &of_ids.collect())?;
    write_boxes(&out.join(BOXES), &boxes)?;
    Ok(report)
}

/// Without the feature `onnx`: returns an error that says how to build with it.
///
/// # Errors
/// Always [`DetectError::NotBuilt`].
#[cfg(not(feature = "onnx"))]
pub fn masks_from_prompt(
    _views: &[&View],
    _prompt: &Prompt,
    _models: &Path,
    _options: &PromptOptions,
    _out: &Path,
    _done: &mut dyn FnMut(&str, &ViewMasks),
) -> Result<PromptReport, DetectError> {
    Err(DetectError::NotBuilt)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn thresholds_are_fractions() {
        let with = |change: &dyn Fn(&mut DetectOptions)| {
            let mut options = PromptOptions::default();
            change(&mut options.detect);
            options.check().err().map(|e| e.to_string()).unwrap_or_default()
        };
        assert_eq!(with(&|_| {}), "");
        assert_eq!(with(&|o| o.box_threshold = 1.5), "--box-threshold: is 1.5, but must be from 0 to 1");
        assert!(with(&|o| o.text_threshold = -0.1).starts_with("--text-threshold"));
        assert!(with(&|o| o.overlap = f64::NAN).starts_with("--overlap"));
    }
    #[cfg(not(feature = "onnx"))]
    #[test]
    fn without_the_feature_it_says_how_to_build() -> Result<(), DetectError> {
        let prompt = Prompt::parse("car")?;
        let nowhere = Path::new("nowhere");
        let error = masks_from_prompt(&[], &prompt, nowhere, &PromptOptions::default(), nowhere, &mut |_, _| {});
        assert!(error.is_err_and(|e| e.to_string().contains("--features onnx")));
        Ok(())
    }
}
