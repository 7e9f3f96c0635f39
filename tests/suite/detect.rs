//! Masks from a prompt against PyTorch and transformers, on tiny models with random weights
//! (`tools/models/make_mask_model_fixtures.py`).

use instgs_detect::boxes::{DecodeError, DetectOptions, Detection, Detections, RawDetections, decode};
use instgs_detect::image_input::{ModelImage, detector_image, segmenter_image};
use instgs_detect::mask_logits::best_of;
use instgs_detect::models::DetectorModel;
use instgs_detect::tokens::PromptTokenizer;
use instgs_detect::{Detector, Prompt, Segmenter};
use serde::Deserialize;

use crate::onnx::{Tensors, has_onnxruntime, models, models_folder, runtime};

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// What is allowed against PyTorch: parts of the photo for boxes, scores from 0 to 1, logits of masks.
const TOLERANCE: f64 = 1e-3;

#[derive(Deserialize)]
struct Expected {
    prompts: Vec<Case>,
    texts: Vec<Text>,
}

#[derive(Deserialize)]
struct Case {
    text: String,
    threshold: f64,
    text_threshold: f64,
    labels: Vec<String>,
}

#[derive(Deserialize)]
struct Text {
    text: String,
    ids: Vec<i64>,
}

fn expected() -> Result<Expected, Box<dyn std::error::Error>> {
    Ok(serde_json::from_slice(&std::fs::read(models_folder().join("expected.json"))?)?)
}

/// Largest difference, where minus infinity equals itself.
fn difference(got: &[f32], want: &[f32]) -> f64 {
    assert_eq!(got.len(), want.len());
    let one = |(a, b): (&f32, &f32)| if a == b { 0.0 } else { f64::from((a - b).abs()) };
    got.iter().zip(want).map(one).fold(0.0, f64::max)
}

/// Says what was measured and wants it below the limit; a NaN is not.
fn check(what: &str, difference: f64, limit: f64) {
    println!("{what}: {difference:.1e}");
    assert!(difference <= limit, "{what}: differs by {difference:e}, limit {limit:e}");
}

#[test]
fn photos_become_the_same_pixels_as_in_transformers() -> Outcome {
    let (tensors, models) = (Tensors::read()?, models());
    let photo = tensors.photo();
    let check_image = |name: &str, image: &ModelImage| {
        assert_eq!(tensors.shape(name), [1, 3, image.height, image.width], "{name}");
        // Less than a thousandth of the step from one level of 256 to the next, which is 0.017: the same levels.
        check(name, difference(&image.values, &tensors.floats(name)), 1e-5);
    };
    let image = detector_image(&photo, &models.detector);
    check_image("detector.pixel_values", &image);
    assert!(image.photo_mask().iter().all(|m| *m == 1));
    check_image("segmenter.image", &segmenter_image(&photo, &models.segmenter));
    Ok(())
}

#[test]
fn texts_become_the_same_tokens() -> Outcome {
    let (expected, tensors, models) = (expected()?, Tensors::read()?, models());
    let tokenizer = PromptTokenizer::open(&models.path(&models.detector.tokenizer))?;
    for Text { text, ids } in &expected.texts {
        assert_eq!(tokenizer.ids(text)?, *ids, "{text:?}");
    }
    for (k, case) in expected.prompts.iter().enumerate() {
        let tokens = tokenizer.tokens(&Prompt::parse(&case.text)?, &models.detector)?;
        assert_eq!(tokens.ids, tensors.integers(&format!("detector.{k}.input_ids")), "{}", case.text);
        assert_eq!(tokens.attention, tensors.integers(&format!("detector.{k}.attention_mask")));
    }
    Ok(())
}

#[test]
fn tokens_know_their_phrase() -> Outcome {
    let models = models();
    let tokenizer = PromptTokenizer::open(&models.path(&models.detector.tokenizer))?;
    let prompt = Prompt::parse("Car. a chair with wheels? potted plant, caf\u{e9}")?;
    let tokens = tokenizer.tokens(&prompt, &models.detector)?;
    // car . a chair with wheel ##s . pot ##ted plant , cafe .
    let (a, b, c) = (Some(0), Some(1), Some(2));
    let want = [None, a, None, b, b, b, b, b, None, c, c, c, c, c, None, None];
    assert_eq!(tokens.phrase_of, want, "{:?}", tokens.ids);
    let fixed = DetectorModel { fixed_tokens: Some(20), ..models.detector.clone() };
    let filled = tokenizer.tokens(&prompt, &fixed)?;
    assert_eq!((&filled.ids[..16], &filled.ids[16..]), (&tokens.ids[..], &[0; 4][..]));
    assert_eq!((filled.attention.iter().sum::<i64>(), filled.phrase_of[16..].to_vec()), (16, vec![None; 4]));
    let long = Prompt::parse(&"a chair with wheels, ".repeat(9))?;
    let text = tokenizer.tokens(&long, &models.detector).unwrap_err().to_string();
    assert!(text.contains("has 57 tokens, but the detector reads 48"), "{text}");
    // A letter to Unicode, an accent to the tokenizer, which takes accents away.
    let lost = Prompt::parse("car. \u{345}.")?;
    let text = tokenizer.tokens(&lost, &models.detector).unwrap_err().to_string();
    assert!(text.contains("for which the tokenizer has no tokens"), "{text}");
    Ok(())
}

#[test]
fn boxes_are_those_of_transformers() -> Outcome {
    if !has_onnxruntime() {
        return Ok(());
    }
    let (expected, tensors, models) = (expected()?, Tensors::read()?, models());
    let photo = tensors.photo();
    let size = (photo.width, photo.height);
    for (k, case) in expected.prompts.iter().enumerate() {
        let prompt = Prompt::parse(&case.text)?;
        let mut detector = Detector::open(&models, &prompt, &runtime())?;
        let output = detector.run(&detector_image(&photo, &models.detector))?;
        let named = |what: &str| format!("detector.{k}.{what}");
        check(&named("logits"), difference(&output.logits, &tensors.floats(&named("logits"))), TOLERANCE);
        check(&named("pred_boxes"), difference(&output.boxes, &tensors.floats(&named("pred_boxes"))), TOLERANCE);
        let raw = RawDetections { logits: &output.logits, columns: output.columns, boxes: &output.boxes };
        let phrase_of = &detector.tokens().phrase_of;
        // Every box has a name, and none covers another.
        let all = DetectOptions { box_threshold: case.threshold, text_threshold: 0.0, overlap: 1.0 };
        let found = decode(raw, phrase_of, size, &all)?;
        let scores = tensors.floats(&named("scores"));
        let mut order: Vec<usize> = (0..scores.len()).collect();
        order.sort_by(|a, b| scores[*b].total_cmp(&scores[*a]));
        let boxes = tensors.floats(&named("boxes"));
        assert_eq!((found.found.len(), found.unnamed, found.repeated), (scores.len(), 0, 0));
        let (mut worst_score, mut worst_box): (f64, f64) = (0.0, 0.0);
        for (got, &k) in found.found.iter().zip(&order) {
            worst_score = worst_score.max((got.score - f64::from(scores[k])).abs());
            let parts = [size.0, size.1, size.0, size.1];
            let errors = (0..4).map(|i| (got.box_px[i] - f64::from(boxes[4 * k + i])).abs() / parts[i] as f64);
            worst_box = errors.fold(worst_box, f64::max);
        }
        check(&named("scores"), worst_score, TOLERANCE);
        check(&named("boxes"), worst_box, TOLERANCE);
        check_labels(case, &order, &prompt, |options| decode(raw, phrase_of, size, options), &found.found)?;
    }
    Ok(())
}

/// transformers names a box by all tokens above the text threshold, whatever phrases they are of. Where they are of one
/// phrase it is ours; where they are of none, ours has no name.
fn check_labels(
    case: &Case,
    order: &[usize],
    prompt: &Prompt,
    decode: impl Fn(&DetectOptions) -> Result<Detections, DecodeError>,
    all: &[Detection],
) -> Outcome {
    let pieces = |label: &str| label.replace("##", "").replace(['.', ' '], "");
    let mut with_name = 0;
    for (found, &k) in all.iter().zip(order) {
        let label = pieces(&case.labels[k]);
        let phrase = prompt.phrases()[found.phrase].replace(' ', "");
        let one = prompt.phrases().iter().filter(|p| label.chars().count() > 0 && p.replace(' ', "").contains(&label));
        if one.count() == 1 {
            assert!(phrase.contains(&label), "{label:?} is {phrase:?}");
        }
        with_name += usize::from(!label.is_empty());
    }
    let options = DetectOptions { box_threshold: case.threshold, text_threshold: case.text_threshold, overlap: 1.0 };
    let found = decode(&options)?;
    assert_eq!((found.found.len(), found.unnamed), (with_name, all.len() - with_name), "{}", case.text);
    Ok(())
}

#[test]
fn masks_are_those_of_transformers() -> Outcome {
    if !has_onnxruntime() {
        return Ok(());
    }
    let (tensors, models) = (Tensors::read()?, models());
    let photo = tensors.photo();
    let mut segmenter = Segmenter::open(&models, &runtime())?;
    let embedding = segmenter.encode(&photo)?;
    check("embeddings", difference(embedding.values(), &tensors.floats("segmenter.embeddings")), TOLERANCE);
    let boxes: Vec<[f64; 4]> =
        tensors.floats("segmenter.boxes_photo").as_chunks::<4>().0.iter().map(|b| b.map(f64::from)).collect();
    let corners: Vec<f32> = boxes.iter().flat_map(|b| embedding.frame.box_in_input(b)).collect();
    check("boxes", difference(&corners, &tensors.floats("segmenter.boxes")), TOLERANCE);
    let raw = segmenter.run(&embedding, &boxes)?;
    check("mask_logits", difference(&raw.logits, &tensors.floats("segmenter.mask_logits")), TOLERANCE);
    check("scores", difference(&raw.scores, &tensors.floats("segmenter.scores")), TOLERANCE);
    let best: Vec<i64> = raw.scores.chunks(raw.per_box).map(|scores| best_of(scores) as i64).collect();
    assert_eq!(best, tensors.integers("segmenter.best"));
    let at_photo = segmenter.masks(&embedding, &boxes)?;
    let at_photo: Vec<f32> = at_photo.iter().flat_map(|m| embedding.frame.at_photo(&m.logits)).collect();
    check("photo_logits", difference(&at_photo, &tensors.floats("segmenter.photo_logits")), TOLERANCE);
    // More boxes than are run at a time, and each alone: a mask hangs on its box only.
    let many: Vec<[f64; 4]> = (0..19).map(|i| boxes[i % boxes.len()]).collect();
    let together = segmenter.masks(&embedding, &many)?;
    for (i, mask) in together.iter().enumerate() {
        let alone = segmenter.masks(&embedding, &many[i..=i])?;
        assert!(difference(&alone[0].logits, &mask.logits) < 1e-4, "{i}");
    }
    Ok(())
}
