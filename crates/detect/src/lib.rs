//! Masks of objects that a text prompt names, found in photos by two ONNX models: a detector that reads text
//! (Grounding DINO) and a segmenter that takes boxes (Segment Anything).
//!
//! ```text
//!   "Car. office chair."      Prompt::parse        phrases: car, office chair
//!     | tokenizer.json
//!   PromptTokens              PromptTokenizer      numbers of pieces of words, and the phrase of each
//!     |
//!     |   photo               Photo::load          as it is stored, with its lens distortion
//!     |     | detector_image                       shorter side 800, longer at most 1333 pixels
//!     v     v
//!   logits, boxes             Detector::run        per query: a score for each token, and a box in parts of the photo
//!     | decode                                     best token above the box threshold; the phrase of the best token of any
//!     |                                            phrase, above the text threshold; boxes that repeat one phrase dropped
//!   Detections                in pixels of the photo, the best first
//!     |     photo
//!     |     | segmenter_image                      longer side 1024, square
//!     |   Embedding           Segmenter::encode    once per photo
//!     v     v
//!   BoxMask per box           Segmenter::masks     the best of three small masks; those that are one and the same dropped
//!     | MaskFrame::at_photo                        256x256 -> 1024x1024 -> the photo's part -> the photo's size
//!   ids of pixels             MaskPainter          logits above 0; the smaller mask in front
//!     |
//!   OUT/NAME.png, categories.json, boxes.json      masks_from_prompt
//! ```
//!
//! [`masks_from_prompt`] does this for many views, one at a time; [`find::Finder`] for a single view. The models are in
//! a folder with a `models.json` ([`models`]), which the scripts in `tools/models` write. They are run by ONNX Runtime,
//! a library that is loaded on demand ([`library`]) and not linked: without prompts neither is needed. Without the
//! feature `onnx` only the parts without extra crates are built, and [`masks_from_prompt`] returns an error that says
//! how to build with it.
//!
//! # Differences from the original
//!
//! `tests/suite/detect.rs` compares every step with PyTorch and transformers, on tiny models with random weights from
//! the functions of the export scripts; the tolerance is 1e-3, and the differences that were found are in
//! `docs/notes/objects.md`. Trained weights have not been tested.
//!
//! Two steps differ from transformers on purpose. It names a box by all tokens above the text threshold, which may
//! belong to several phrases ("car chair") or be a part of a word ("##ted"); here a box has the phrase of its best
//! token, which is the same where transformers names one phrase. And it keeps every box above the threshold, while here
//! boxes of one phrase that overlap and masks that are the same count once.

pub mod assemble;
pub mod boxes;
#[cfg(feature = "onnx")]
mod checksum;
#[cfg(feature = "onnx")]
pub mod detector;
pub mod error;
#[cfg(feature = "onnx")]
pub mod find;
pub mod from_prompt;
#[cfg(feature = "onnx")]
mod graph;
pub mod image_input;
pub mod library;
pub mod mask_logits;
pub mod models;
pub mod nms;
pub mod photo;
pub mod prompt;
pub mod provider;
pub mod report;
pub mod resize;
#[cfg(feature = "onnx")]
mod runtime;
#[cfg(feature = "onnx")]
pub mod segmenter;
#[cfg(feature = "onnx")]
pub mod tokens;

pub use boxes::DetectOptions;
#[cfg(feature = "onnx")]
pub use detector::Detector;
pub use error::DetectError;
#[cfg(feature = "onnx")]
pub use find::Finder;
pub use from_prompt::{BOXES, PromptOptions, masks_from_prompt};
pub use library::RuntimeOptions;
pub use models::ModelsFolder;
pub use photo::Photo;
pub use prompt::Prompt;
pub use provider::Provider;
pub use report::{PromptReport, ViewMasks};
#[cfg(feature = "onnx")]
pub use segmenter::Segmenter;
