//! The detector, Grounding DINO: boxes for phrases.

use super::DetectError;
use super::boxes::{DetectOptions, Detections, RawDetections, decode};
use super::graph::{Graph, Values};
use super::image_input::{ModelImage, detector_image};
use super::library::RuntimeOptions;
use super::models::{DetectorModel, ModelsFolder};
use super::photo::Photo;
use super::prompt::Prompt;
use super::runtime::Runtime;
use super::tokens::{PromptTokenizer, PromptTokens};
use instgs_io::IoError;

const INPUTS: [&str; 5] = ["pixel_values", "pixel_mask", "input_ids", "token_type_ids", "attention_mask"];

/// A detector for the phrases of one prompt.
pub struct Detector {
    graph: Graph,
    model: DetectorModel,
    tokens: PromptTokens,
}

/// Output of the graph for one photo, as in [`RawDetections`].
#[derive(Clone, Debug, PartialEq)]
pub struct DetectorOutput {
    /// `[queries, columns]` before the sigmoid.
    pub logits: Vec<f32>,
    /// Number of columns of `logits`.
    pub columns: usize,
    /// `[queries, 4]`: centre x, centre y, width and height as parts of the photo's size.
    pub boxes: Vec<f32>,
}

impl Detector {
    /// Tokenises the prompt, checks the files' checksums, and loads the runtime and the graph.
    ///
    /// # Errors
    /// A prompt that is too long; model files or a runtime library that are missing or wrong.
    pub fn open(models: &ModelsFolder, prompt: &Prompt, runtime: &RuntimeOptions) -> Result<Self, DetectError> {
        let model = models.detector.clone();
        models.check_contents(&model.tokenizer)?;
        let tokens = PromptTokenizer::open(&models.path(&model.tokenizer))?.tokens(prompt, &model)?;
        let runtime = Runtime::load(runtime)?;
        models.check_contents(&model.graph)?;
        let graph = Graph::open(&runtime, &models.path(&model.graph), &INPUTS, &["logits", "pred_boxes"])?;
        Ok(Self { graph, model, tokens })
    }

    /// The tokens of the prompt.
    pub fn tokens(&self) -> &PromptTokens {
        &self.tokens
    }

    /// Finds the boxes in a photo.
    ///
    /// # Errors
    /// A graph that cannot be run or returns NaN.
    pub fn detect(&mut self, photo: &Photo, options: &DetectOptions) -> Result<Detections, DetectError> {
        let output = self.run(&detector_image(photo, &self.model))?;
        let raw = RawDetections { logits: &output.logits, columns: output.columns, boxes: &output.boxes };
        let size = (photo.width, photo.height);
        Ok(decode(raw, &self.tokens.phrase_of, size, options).map_err(|error| self.graph.error(error.to_string()))?)
    }

    /// Runs the graph on one image.
    ///
    /// # Errors
    /// A graph that cannot be run, or whose output has other shapes than `models.json` states.
    pub fn run(&mut self, image: &ModelImage) -> Result<DetectorOutput, IoError> {
        let PromptTokens { ids, attention, .. } = &self.tokens;
        let kinds = vec![0; ids.len()];
        let (plane, row) = ([1, image.height, image.width], [1, ids.len()]);
        let mut outputs = self.graph.run(&[
            ("pixel_values", &[1, 3, image.height, image.width], Values::Floats(&image.values)),
            ("pixel_mask", &plane, Values::Integers(&image.photo_mask())),
            ("input_ids", &row, Values::Integers(ids)),
            ("token_type_ids", &row, Values::Integers(&kinds)),
            ("attention_mask", &row, Values::Integers(attention)),
        ])?;
        let (Some(boxes), Some(logits)) = (outputs.pop(), outputs.pop()) else {
            return Err(self.graph.error("made nothing"));
        };
        let columns = self.model.max_tokens;
        self.graph.expect("logits", &logits, &[Some(1), None, Some(columns)])?;
        self.graph.expect("pred_boxes", &boxes, &[Some(1), Some(logits.shape[1]), Some(4)])?;
        Ok(DetectorOutput { logits: logits.values, columns, boxes: boxes.values })
    }
}
