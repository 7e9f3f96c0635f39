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
//! A file with weights in other files lists those under `data`.

use std::path::{Path, PathBuf};

use serde::Deserialize;

use instgs_io::IoError;
use instgs_io::error::Place;
use instgs_io::json::read_json;

/// Name of the list of models in their folder.
pub const MANIFEST: &str = "models.json";
/// Value of `format` in the files that this program reads.
const FORMAT: &str = "instgs-models/1";
/// Largest side of a model's picture, pixels: a larger number means a damaged file.
const LARGEST_SIDE_PX: u32 = 16384;
/// Command that exports a detector.
const DETECTOR_COMMAND: &str = "python3 tools/models/export_grounding_dino.py --out";
/// Command that exports a segmenter.
const SEGMENTER_COMMAND: &str = "python3 tools/models/export_sam.py --out";

/// A file of a model, with its checksum.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct ModelFile {
    /// Name of the file in the folder.
    pub file: String,
    /// Length of the file, bytes.
    pub bytes: u64,
    /// SHA-256 of the file, hexadecimal.
    pub sha256: String,
    /// Files in the same folder with its weights.
    #[serde(default)]
    pub data: Vec<ModelFile>,
}

/// A detector: finds boxes for phrases.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct DetectorModel {
    /// Kind of the model: "grounding-dino".
    pub kind: String,
    /// Name of the checkpoint that it was exported from.
    pub source: String,
    /// File of the ONNX graph.
    pub graph: ModelFile,
    /// File of its `tokenizer.json`.
    pub tokenizer: ModelFile,
    /// Length of a photo's shorter side in the input, pixels, ...
    pub shortest_px: u32,
    /// ... unless the longer side would exceed this, pixels.
    pub longest_px: u32,
    /// Height and width of the input if they are fixed, pixels.
    pub canvas_px: Option<[u32; 2]>,
    /// Means of red, green and blue, for values in 0..=1.
    pub mean: [f64; 3],
    /// Standard deviations of red, green and blue.
    pub std: [f64; 3],
    /// Largest number of tokens in a prompt, and the number of columns of the logits.
    pub max_tokens: usize,
    /// Number of tokens of all prompts if it is fixed; shorter ones are padded.
    pub fixed_tokens: Option<usize>,
}

/// A segmenter: makes masks for boxes.
#[derive(Clone, Debug, PartialEq, Deserialize)]
pub struct SegmenterModel {
    /// Kind of the model: "sam", which includes MobileSAM.
    pub kind: String,
    /// Name of the checkpoint that it was exported from.
    pub source: String,
    /// File of the ONNX graph that encodes a photo.
    pub encoder: ModelFile,
    /// File of the ONNX graph that decodes boxes to masks.
    pub decoder: ModelFile,
    /// Width and height of the input, pixels.
    pub side_px: u32,
    /// Width and height of the masks, pixels.
    pub mask_px: u32,
    /// Means of red, green and blue, for values in 0..=1.
    pub mean: [f64; 3],
    /// Standard deviations of red, green and blue.
    pub std: [f64; 3],
}

#[derive(Deserialize)]
struct Manifest {
    format: String,
    detector: Option<DetectorModel>,
    segmenter: Option<SegmenterModel>,
}

/// A folder with both models. The contents of files are only checked before a model is loaded.
#[derive(Clone, Debug, PartialEq)]
pub struct ModelsFolder {
    folder: PathBuf,
    /// Model that finds boxes for phrases.
    pub detector: DetectorModel,
    /// Model that makes masks for boxes.
    pub segmenter: SegmenterModel,
}

impl ModelsFolder {
    /// Reads `models.json`, and checks its values and the length of every file it names.
    ///
    /// # Errors
    /// A missing folder or list; a missing model, with the command that exports it; values out of range; files that are
    /// missing or of another length.
    pub fn open(folder: &Path) -> Result<Self, IoError> {
        let path = folder.join(MANIFEST);
        if !path.is_file() {
            let at = folder.display();
            let advice = format!("make the models with: {DETECTOR_COMMAND} {at} and {SEGMENTER_COMMAND} {at}");
            return Err(IoError::new(&path, "is missing: there are no models in this folder").advise(advice));
        }
        let manifest: Manifest = read_json(&path)?;
        if manifest.format != FORMAT {
            let what = format!("has the format {:?}, but this program reads {FORMAT:?}", manifest.format);
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

    /// Path of a file in the folder.
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
            let what = format!("has {} bytes, but {MANIFEST} says {}", data.len(), file.bytes);
            return Err(IoError::new(&path, what));
        }
        file.data.iter().try_for_each(|beside| self.check_lengths(beside))
    }

    /// Compares the checksums of a file and of those with its weights.
    ///
    /// # Errors
    /// A file that cannot be read or has another checksum.
    #[cfg(feature = "onnx")]
    pub fn check_contents(&self, file: &ModelFile) -> Result<(), IoError> {
        let path = self.path(file);
        let found = super::checksum::sha256(&path)?;
        if !found.eq_ignore_ascii_case(&file.sha256) {
            let what = format!("has the SHA-256 {found}, but {MANIFEST} says {}", file.sha256);
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
    // A prompt has at least the start, the end, one word and its full stop.
    if !(4..=65536).contains(&model.max_tokens) {
        return Err(("max_tokens", format!("is {}, but prompts have 4 to 65536", model.max_tokens)));
    }
    match model.fixed_tokens {
        Some(fixed) if !(4..=model.max_tokens).contains(&fixed) => {
            Err(("fixed_tokens", format!("is {fixed}, but prompts have 4 to {}", model.max_tokens)))
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
        false => Err(("kind", format!("is {kind:?}, but this program can use {known:?}"))),
    }
}

fn check_side(field: &'static str, side: u32) -> Result<(), Fault> {
    match (1..=LARGEST_SIDE_PX).contains(&side) {
        true => Ok(()),
        false => Err((field, format!("is {side}, but pictures have 1 to {LARGEST_SIDE_PX} pixels a side"))),
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
