//! L4: masks of things that a user names, found in photos by two ONNX models: a detector that reads text (Grounding DINO)
//! and a segmenter that takes boxes (Segment Anything).
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
//! [`masks_from_prompt`] is all of that for many views, one at a time; [`find::Finder`] for one view after the other.
//! The models lie in a folder with a `models.json` ([`models`]), which the scripts in `tools/models` make. They are run by
//! ONNX Runtime, a library that is loaded when it is needed ([`library`]): nothing is linked, and who asks for no masks
//! needs neither. Without the feature `onnx` only what needs no crate of its own is here, and [`masks_from_prompt`] says
//! how to build with it.
//!
//! # How near it is to the original
//!
//! `tests/suite/detect.rs` compares every step with PyTorch 2.15 and transformers 5.23, on tiny models with random weights
//! that the export scripts' own functions made. Allowed is 1e-3; measured on a processor with ONNX Runtime 1.32, largest
//! differences: pixels 0, tokens 0, logits of the detector 3.3e-6, scores 3.8e-7, boxes 2.2e-7 of the photo; embeddings
//! 1.7e-6, logits of masks 2.6e-6, their scores 1.3e-6, and 2.1e-6 at the photo's size. Trained weights were never there
//! to be tried.
//!
//! Two steps differ from transformers on purpose. It names a box by all tokens above the text threshold, which may be of
//! several phrases ("car chair") or a part of one ("##ted"); here a box has the phrase of its best token, which is the
//! same where transformers names one phrase. And it keeps every box above the threshold: here one phrase has a box once,
//! and one mask has one box.

use instgs_io as io;
use instgs_vk::scene;

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
