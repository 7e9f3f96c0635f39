//! The segmenter, Segment Anything: masks for boxes.

use super::DetectError;
use super::graph::{Graph, Tensor, Values};
use super::image_input::segmenter_image;
use super::library::RuntimeOptions;
use super::mask_logits::{MaskFrame, best_of};
use super::models::{ModelsFolder, SegmenterModel};
use super::nms::BoxPx;
use super::photo::Photo;
use super::runtime::Runtime;
use instgs_io::IoError;

/// Boxes in one run of the decoder. For each box it holds several copies of the photo's embedding (256 channels of
/// 64x64, 4 MB) and upscaled features (32 channels of 256x256, 8 MB): about 40 MB a box, 0.6 GB in all.
const BOXES_AT_A_TIME: usize = 16;

/// A segmenter with its two graphs.
pub struct Segmenter {
    encoder: Graph,
    decoder: Graph,
    model: SegmenterModel,
}

/// A photo after the encoder.
pub struct Embedding {
    tensor: Tensor,
    /// Placement of the masks in the photo.
    pub frame: MaskFrame,
}

impl Embedding {
    /// Values of the embedding, `[channels, rows, columns]`.
    pub fn values(&self) -> &[f32] {
        &self.tensor.values
    }
}

/// Several masks for each of some boxes, with scores.
#[derive(Clone, Debug, PartialEq)]
pub struct RawMasks {
    /// Number of masks for each box.
    pub per_box: usize,
    /// `[boxes, per_box]`: predicted quality of each mask.
    pub scores: Vec<f32>,
    /// `[boxes, per_box, mask_px, mask_px]`; a pixel belongs to the mask if its logit is above 0.
    pub logits: Vec<f32>,
}

/// The best mask of one box.
#[derive(Clone, Debug, PartialEq)]
pub struct BoxMask {
    /// Predicted quality of the mask.
    pub score: f32,
    /// `[mask_px, mask_px]`; see [`MaskFrame::at_photo`].
    pub logits: Vec<f32>,
}

impl Segmenter {
    /// Checks the files' checksums, and loads the runtime and the graphs.
    ///
    /// # Errors
    /// Model files or a runtime library that are missing or wrong.
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

    /// Encodes a photo, once for all of its boxes.
    ///
    /// # Errors
    /// A graph that cannot be run, or whose output has another shape than `models.json` states.
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

    /// All masks of at least one box, given in pixels of the photo, in one run.
    ///
    /// # Errors
    /// A graph that cannot be run, returns NaN, or other shapes than `models.json` states.
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
            return Err(self.decoder.error("gave no masks, or NaN; its file may be damaged"));
        }
        Ok(RawMasks { per_box, scores: scores.values, logits: logits.values })
    }

    /// The best mask of each box, given in pixels of the photo.
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
