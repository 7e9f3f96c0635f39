//! The segmenter: Segment Anything, masks for boxes.

use super::DetectError;
use super::graph::{Graph, Tensor, Values};
use super::image_input::segmenter_image;
use super::library::RuntimeOptions;
use super::mask_logits::{MaskFrame, best_of};
use super::models::{ModelsFolder, SegmenterModel};
use super::nms::BoxPx;
use super::photo::Photo;
use super::runtime::Runtime;
use crate::io::IoError;

/// Boxes that the decoder works on at a time. For each it holds a copy of the photo's embedding and upscaled features, at
/// Segment Anything's size 4 MB (256 channels of 64x64) and 8 MB (32 of 256x256), several of each at once: about 40 MB a
/// box, so 0.6 GB at a time.
const BOXES_AT_A_TIME: usize = 16;

/// A segmenter.
pub struct Segmenter {
    encoder: Graph,
    decoder: Graph,
    model: SegmenterModel,
}

/// A photo as the encoder sees it.
pub struct Embedding {
    tensor: Tensor,
    /// How masks lie in the photo.
    pub frame: MaskFrame,
}

impl Embedding {
    /// The numbers, `[channels, rows, columns]`.
    pub fn values(&self) -> &[f32] {
        &self.tensor.values
    }
}

/// The masks of some boxes; several for each, and which is best is for the scores to say.
#[derive(Clone, Debug, PartialEq)]
pub struct RawMasks {
    /// Masks for each box.
    pub per_box: usize,
    /// `[boxes, per_box]`: how well each mask is thought to fit.
    pub scores: Vec<f32>,
    /// `[boxes, per_box, mask_px, mask_px]`.
    pub logits: Vec<f32>,
}

/// The best mask of a box.
#[derive(Clone, Debug, PartialEq)]
pub struct BoxMask {
    /// How well it is thought to fit.
    pub score: f32,
    /// `[mask_px, mask_px]`; see [`MaskFrame::at_photo`].
    pub logits: Vec<f32>,
}

impl Segmenter {
    /// Compares the files with their checksums, loads the runtime and the graphs.
    ///
    /// # Errors
    /// Files or a runtime library that are missing or something else.
    pub fn open(models: &ModelsFolder, runtime: &RuntimeOptions) -> Result<Self, DetectError> {
        let model = models.segmenter.clone();
        let runtime = Runtime::load(runtime)?;
        let (encoder, decoder) = (models.path(&model.encoder), models.path(&model.decoder));
        models.check_contents(&model.encoder)?;
        let encoder = Graph::open(&runtime, &encoder, &["image"], &["embeddings"])?;
        models.check_contents(&model.decoder)?;
        let decoder = Graph::open(&runtime, &decoder, &["embeddings", "boxes"], &["mask_logits", "scores"])?;
        Ok(Self { encoder, decoder, model })
    }

    /// Reads a photo; once, however many boxes there are.
    ///
    /// # Errors
    /// A graph that cannot be run, or whose output has another shape than `models.json` says.
    pub fn encode(&mut self, photo: &Photo) -> Result<Embedding, IoError> {
        let image = segmenter_image(photo, &self.model);
        let shape = [1, 3, image.height, image.width];
        let mut outputs = self.encoder.run(&[("image", &shape, Values::Floats(&image.values))])?;
        let Some(tensor) = outputs.pop() else { return Err(self.encoder.error("made nothing")) };
        self.encoder.expect("embeddings", &tensor, &[Some(1), None, None, None])?;
        let (mask, side) = (self.model.mask_px as usize, self.model.side_px as usize);
        let frame = MaskFrame { mask, side, resized: image.photo_size, photo: (photo.width, photo.height) };
        Ok(Embedding { tensor, frame })
    }

    /// All masks of boxes in pixels of the photo, in one run. At least one box.
    ///
    /// # Errors
    /// A graph that cannot be run, makes no numbers, or other shapes than `models.json` says.
    pub fn run(&mut self, embedding: &Embedding, boxes: &[BoxPx]) -> Result<RawMasks, IoError> {
        let corners: Vec<f32> = boxes.iter().flat_map(|b| embedding.frame.box_in_input(b)).collect();
        let Tensor { shape, values } = &embedding.tensor;
        let mut outputs = self.decoder.run(&[
            ("embeddings", shape, Values::Floats(values)),
            ("boxes", &[boxes.len(), 4], Values::Floats(&corners)),
        ])?;
        let (Some(scores), Some(logits)) = (outputs.pop(), outputs.pop()) else {
            return Err(self.decoder.error("made nothing"));
        };
        let mask = Some(self.model.mask_px as usize);
        self.decoder.expect("scores", &scores, &[Some(boxes.len()), None])?;
        let per_box = scores.shape[1];
        self.decoder.expect("mask_logits", &logits, &[Some(boxes.len()), Some(per_box), mask, mask])?;
        if per_box == 0 || scores.values.iter().chain(&logits.values).any(|v| v.is_nan()) {
            return Err(self.decoder.error("gave masks without numbers; its file may be damaged"));
        }
        Ok(RawMasks { per_box, scores: scores.values, logits: logits.values })
    }

    /// The best mask of each box in pixels of the photo.
    ///
    /// # Errors
    /// Those of [`Self::run`].
    pub fn masks(&mut self, embedding: &Embedding, boxes: &[BoxPx]) -> Result<Vec<BoxMask>, IoError> {
        let mut out = Vec::with_capacity(boxes.len());
        for boxes in boxes.chunks(BOXES_AT_A_TIME) {
            let raw = self.run(embedding, boxes)?;
            let pixels = embedding.frame.mask * embedding.frame.mask;
            let of_box = raw.scores.chunks_exact(raw.per_box).zip(raw.logits.chunks_exact(raw.per_box * pixels));
            out.extend(of_box.map(|(scores, logits)| {
                let best = best_of(scores);
                BoxMask { score: scores[best], logits: logits[best * pixels..][..pixels].to_vec() }
            }));
        }
        Ok(out)
    }
}
