//! The folder of models and its `models.json`, as the scripts in `tools/models` write it.
//!
//! ```json
//! {"format": "instgs-models/1",
//!  "detector": {"kind": "grounding-dino", "source": "...", "opset": 20,
//!               "graph": {"file": "grounding_dino.onnx", "bytes": 1, "sha256": "..."}, "tokenizer": {...},
//!               "shortest_px": 800, "longest_px": 1333, "canvas_px": null,
//!               "mean": [0.485, 0.456, 0.406], "std": [0.229, 0.224, 0.225], "max_tokens": 256, "fixed_tokens": null},
//!  "segmenter": {"kind": "sam", "source": "...", "opset": 20, "encoder": {...}, "decoder": {...},
//!                "side_px": 1024, "mask_px": 256, "mean": [...], "std": [...]}}
//! ```
//!
//! A file whose weights lie beside it lists them under `data`.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use crate::io::IoError;
use crate::io::error::Place;
use crate::io::json::read_json;

/// Name of the list of models in their folder.
pub const MANIFEST: &str = "models.json";
/// What `format` says for the files this program reads.
const FORMAT: &str = "instgs-models/1";
/// No photo is made larger than this for a model, in pixels: a number beyond it is a damaged file, not a model.
const LARGEST_SIDE_PX: u32 = 16384;
/// How detectors are made.
const DETECTOR_COMMAND: &str = "python3 tools/models/export_grounding_dino.py --out";
/// How segmenters are made.
const SEGMENTER_COMMAND: &str = "python3 tools/models/export_sam.py --out";

/// A file of a model.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct ModelFile {
    /// Its name in the folder.
    pub file: String,
    /// Its length.
    pub bytes: u64,
    /// SHA-256 of it, hexadecimal.
    pub sha256: String,
    /// Files beside it that it takes its weights from.
    #[serde(default)]
    pub data: Vec<ModelFile>,
}

/// A detector: boxes for phrases.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct DetectorModel {
    /// "grounding-dino".
    pub kind: String,
    /// The checkpoint it was made from.
    pub source: String,
    /// The ONNX graph.
    pub graph: ModelFile,
    /// Its `tokenizer.json`.
    pub tokenizer: ModelFile,
    /// The shorter side of a photo is made this long, pixels,
    pub shortest_px: u32,
    /// unless the longer one would be longer than this.
    pub longest_px: u32,
    /// Height and width of its input if they are fixed.
    pub canvas_px: Option<[u32; 2]>,
    /// Means of red, green, blue, which are 0..=1.
    pub mean: [f64; 3],
    /// Their standard deviations.
    pub std: [f64; 3],
    /// The longest prompt it reads, and the columns of its logits.
    pub max_tokens: usize,
    /// The length of all prompts if it is fixed; shorter ones are filled up.
    pub fixed_tokens: Option<usize>,
}

/// A segmenter: masks for boxes.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct SegmenterModel {
    /// "sam", which MobileSAM is, too.
    pub kind: String,
    /// The checkpoint it was made from.
    pub source: String,
    /// The ONNX graph that reads a photo, once.
    pub encoder: ModelFile,
    /// The one that reads boxes.
    pub decoder: ModelFile,
    /// Width and height of its input, pixels.
    pub side_px: u32,
    /// Width and height of its masks.
    pub mask_px: u32,
    /// Means of red, green, blue, which are 0..=1.
    pub mean: [f64; 3],
    /// Their standard deviations.
    pub std: [f64; 3],
}

#[derive(Deserialize)]
struct Manifest {
    format: String,
    detector: Option<DetectorModel>,
    segmenter: Option<SegmenterModel>,
}

/// A folder with both models. What is not looked at yet are the files' contents.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelsFolder {
    folder: PathBuf,
    /// Finds boxes.
    pub detector: DetectorModel,
    /// Makes masks of boxes.
    pub segmenter: SegmenterModel,
}

impl ModelsFolder {
    /// Reads `models.json` and checks that it makes sense and that every file it names has the right length.
    ///
    /// # Errors
    /// No such folder or list, a model that is missing, with the command that makes it; numbers that no model has; files
    /// that are missing or cut.
    pub fn open(folder: &Path) -> Result<Self, IoError> {
        let path = folder.join(MANIFEST);
        if !path.is_file() {
            let at = folder.display();
            let advice = format!("make the models with: {DETECTOR_COMMAND} {at} and {SEGMENTER_COMMAND} {at}");
            return Err(IoError::new(&path, "is missing: no models to find things with").advise(advice));
        }
        let manifest: Manifest = read_json(&path)?;
        if manifest.format != FORMAT {
            let what = format!("is of the format {:?}, and this program reads {FORMAT:?}", manifest.format);
            return Err(IoError::new(&path, what).at(Place::Field("format".into())));
        }
        let missing = |name: &str, command: &str| {
            let error = IoError::new(&path, "is missing").at(Place::Field(name.into()));
            error.advise(format!("make it with: {command} {}", folder.display()))
        };
        let detector = manifest.detector.ok_or_else(|| missing("detector", DETECTOR_COMMAND))?;
        let segmenter = manifest.segmenter.ok_or_else(|| missing("segmenter", SEGMENTER_COMMAND))?;
        check_detector(&detector).map_err(|(field, what)| bad(&path, "detector", field, what))?;
        check_segmenter(&segmenter).map_err(|(field, what)| bad(&path, "segmenter", field, what))?;
        let models = Self { folder: folder.into(), detector, segmenter };
        let files = [
            (&models.detector.graph, DETECTOR_COMMAND),
            (&models.detector.tokenizer, DETECTOR_COMMAND),
            (&models.segmenter.encoder, SEGMENTER_COMMAND),
            (&models.segmenter.decoder, SEGMENTER_COMMAND),
        ];
        for (file, command) in files {
            models.check_lengths(file).map_err(|e| e.advise(models.remake(command)))?;
        }
        Ok(models)
    }

    /// Where a file lies.
    pub fn path(&self, file: &ModelFile) -> PathBuf {
        self.folder.join(&file.file)
    }

    fn remake(&self, command: &str) -> String {
        format!("make it again with: {command} {}", self.folder.display())
    }

    fn check_lengths(&self, file: &ModelFile) -> Result<(), IoError> {
        let path = self.path(file);
        let data = std::fs::metadata(&path).map_err(|e| IoError::new(&path, format!("cannot be used: {e}")))?;
        if data.len() != file.bytes {
            let what = format!("has {} bytes, and {MANIFEST} says {}", data.len(), file.bytes);
            return Err(IoError::new(&path, what));
        }
        file.data.iter().try_for_each(|beside| self.check_lengths(beside))
    }

    /// Compares the contents of a file, and of those that hold its weights, with their checksums.
    ///
    /// # Errors
    /// A file that cannot be read or has other contents than when it was made.
    #[cfg(feature = "onnx")]
    pub fn check_contents(&self, file: &ModelFile) -> Result<(), IoError> {
        let path = self.path(file);
        let found = super::checksum::sha256(&path)?;
        if !found.eq_ignore_ascii_case(&file.sha256) {
            let what = format!("has the SHA-256 {found}, and {MANIFEST} says {}", file.sha256);
            let is_segmenter = [&self.segmenter.encoder, &self.segmenter.decoder].contains(&file);
            let command = if is_segmenter { SEGMENTER_COMMAND } else { DETECTOR_COMMAND };
            return Err(IoError::new(&path, what).advise(format!("copy it again, or {}", self.remake(command))));
        }
        file.data.iter().try_for_each(|beside| self.check_contents(beside))
    }
}

fn bad(path: &Path, model: &str, field: &str, what: String) -> IoError {
    IoError::new(path, what).at(Place::Field(format!("{model}.{field}")))
}

type Fault = (&'static str, String);

fn check_detector(model: &DetectorModel) -> Result<(), Fault> {
    check_kind(&model.kind, "grounding-dino")?;
    check_normalisation(model.mean, model.std)?;
    check_side("shortest_px", model.shortest_px)?;
    check_side("longest_px", model.longest_px)?;
    if model.shortest_px > model.longest_px {
        return Err(("shortest_px", format!("is {}, above longest_px, {}", model.shortest_px, model.longest_px)));
    }
    model.canvas_px.iter().flatten().try_for_each(|&side| check_side("canvas_px", side))?;
    // The start, the end, one word and its full stop.
    if !(4..=65536).contains(&model.max_tokens) {
        return Err(("max_tokens", format!("is {}, and prompts have 4 to 65536", model.max_tokens)));
    }
    match model.fixed_tokens {
        Some(fixed) if !(4..=model.max_tokens).contains(&fixed) => {
            Err(("fixed_tokens", format!("is {fixed}, and prompts have 4 to {}", model.max_tokens)))
        }
        _ => Ok(()),
    }
}

fn check_segmenter(model: &SegmenterModel) -> Result<(), Fault> {
    check_kind(&model.kind, "sam")?;
    check_normalisation(model.mean, model.std)?;
    check_side("side_px", model.side_px)?;
    check_side("mask_px", model.mask_px)
}

fn check_kind(kind: &str, known: &str) -> Result<(), Fault> {
    match kind == known {
        true => Ok(()),
        false => Err(("kind", format!("is {kind:?}, and this program can use {known:?}"))),
    }
}

fn check_side(field: &'static str, side: u32) -> Result<(), Fault> {
    match (1..=LARGEST_SIDE_PX).contains(&side) {
        true => Ok(()),
        false => Err((field, format!("is {side}, and pictures have 1 to {LARGEST_SIDE_PX} pixels a side"))),
    }
}

fn check_normalisation(mean: [f64; 3], std: [f64; 3]) -> Result<(), Fault> {
    if !mean.iter().all(|m| m.is_finite()) {
        return Err(("mean", format!("is {mean:?}, which is not finite")));
    }
    match std.iter().all(|s| s.is_finite() && *s > 0.0) {
        true => Ok(()),
        false => Err(("std", format!("is {std:?}, which is not above 0"))),
    }
}

#[cfg(test)]
#[path = "models_tests.rs"]
mod tests;
