//! Masks from a prompt against PyTorch and transformers, on tiny models with random weights
//! (`tools/models/make_mask_model_fixtures.py`).

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use instgs_vk::detect::boxes::{DetectOptions, RawDetections, decode};
use instgs_vk::detect::image_input::{ModelImage, detector_image, segmenter_image};
use instgs_vk::detect::mask_logits::best_of;
use instgs_vk::detect::tokens::PromptTokenizer;
use instgs_vk::detect::{
    Detector, ModelsFolder, Photo, Prompt, PromptOptions, PromptReport, Provider, RuntimeOptions, Segmenter,
    masks_from_prompt,
};
use instgs_vk::io::picture_png::write_png;
use instgs_vk::io::{MaskFolder, Split, View, read_boxes, read_mask};
use instgs_vk::math::distortion::Distortion;
use instgs_vk::scene::Camera;
use safetensors::SafeTensors;
use serde::Deserialize;

use crate::common::onnx::{has_onnxruntime, models_folder};

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

/// The tensors of `expected.safetensors`.
struct Tensors(Vec<u8>);

impl Tensors {
    fn read() -> std::io::Result<Self> {
        Ok(Self(std::fs::read(models_folder().join("expected.safetensors"))?))
    }

    fn bytes(&self, name: &str) -> (Vec<usize>, Vec<u8>) {
        let all = SafeTensors::deserialize(&self.0).unwrap();
        let tensor = all.tensor(name).unwrap();
        (tensor.shape().to_vec(), tensor.data().to_vec())
    }

    fn shape(&self, name: &str) -> Vec<usize> {
        self.bytes(name).0
    }

    fn floats(&self, name: &str) -> Vec<f32> {
        self.bytes(name).1.as_chunks::<4>().0.iter().map(|b| f32::from_le_bytes(*b)).collect()
    }

    fn integers(&self, name: &str) -> Vec<i64> {
        self.bytes(name).1.as_chunks::<8>().0.iter().map(|b| i64::from_le_bytes(*b)).collect()
    }

    fn photo(&self) -> Photo {
        let (shape, bytes) = self.bytes("photo");
        Photo { width: shape[1], height: shape[0], rgb: bytes.as_chunks::<3>().0.to_vec() }
    }
}

fn models() -> ModelsFolder {
    ModelsFolder::open(&models_folder()).unwrap()
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
    let fixed = instgs_vk::detect::models::DetectorModel { fixed_tokens: Some(20), ..models.detector.clone() };
    let filled = tokenizer.tokens(&prompt, &fixed)?;
    assert_eq!((&filled.ids[..16], &filled.ids[16..]), (&tokens.ids[..], &[0; 4][..]));
    assert_eq!((filled.attention.iter().sum::<i64>(), filled.phrase_of[16..].to_vec()), (16, vec![None; 4]));
    let long = Prompt::parse(&"a chair with wheels, ".repeat(9))?;
    let text = tokenizer.tokens(&long, &models.detector).unwrap_err().to_string();
    assert!(text.contains("makes 57 tokens, and the detector reads 48"), "{text}");
    // A letter to Unicode, an accent to the tokenizer, which takes accents away.
    let lost = Prompt::parse("car. \u{345}.")?;
    let text = tokenizer.tokens(&lost, &models.detector).unwrap_err().to_string();
    assert!(text.contains("of which the tokenizer leaves nothing"), "{text}");
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
        let mut detector = Detector::open(&models, &prompt, &RuntimeOptions::default())?;
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
    decode: impl Fn(&DetectOptions) -> Result<instgs_vk::detect::boxes::Detections, String>,
    all: &[instgs_vk::detect::boxes::Detection],
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
    let mut segmenter = Segmenter::open(&models, &RuntimeOptions::default())?;
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

/// Views of the fixture's photo and of the same upside down, stored as PNG in the folder.
fn views(folder: &Path) -> Result<Vec<View>, Box<dyn std::error::Error>> {
    let photo = Tensors::read()?.photo();
    let size = (photo.width as u32, photo.height as u32);
    let mut views = Vec::new();
    for (name, flip) in [("a", false), ("b.c", true)] {
        let path = folder.join(format!("{name}.png"));
        let pixel = |i: usize| photo.rgb[if flip { photo.rgb.len() - 1 - i } else { i }];
        let rgb: Vec<u8> = (0..photo.rgb.len()).flat_map(pixel).collect();
        write_png(&path, &rgb, size)?;
        let camera = Camera::look_at(name, glam::DVec3::X, glam::DVec3::ZERO, glam::DVec3::Z, 0.8, size);
        views.push(View { camera, image_path: path, split: Split::Train, distortion: None, mask_path: None });
    }
    Ok(views)
}

/// Masks of both views in OUT; thresholds below the fixture's, so that there are some for each phrase.
fn masks_in(out: &Path, views: &[View], prompt: &str) -> Result<PromptReport, Box<dyn std::error::Error>> {
    let detect = DetectOptions { box_threshold: 0.3, text_threshold: 0.3, overlap: 0.8 };
    let options = PromptOptions { detect, ..PromptOptions::default() };
    let mut told = Vec::new();
    let views: Vec<&View> = views.iter().collect();
    let report =
        masks_from_prompt(&views, &Prompt::parse(prompt)?, &models_folder(), &options, out, &mut |name, masks| {
            told.push((name.to_owned(), masks.boxes.len()));
            assert!(out.join(format!("{name}.png")).is_file(), "told after it is written");
        })?;
    assert_eq!(told.iter().map(|(_, masks)| masks).sum::<usize>(), report.masks);
    Ok(report)
}

#[test]
fn a_prompt_becomes_a_folder_of_masks() -> Outcome {
    if !has_onnxruntime() {
        return Ok(());
    }
    let folder = tempfile::tempdir()?;
    let views = views(folder.path())?;
    let out = folder.path().join("out/masks");
    let report = masks_in(&out, &views, "car. chair. potted plant.")?;
    println!("{report:?}");
    assert!(report.masks > 2 && report.views == 2 && report.phrases.len() == 3, "{report:?}");
    let masks = MaskFolder::open(&out)?;
    let boxes = read_boxes(&out.join("boxes.json"))?;
    let mut next = 1;
    for view in &views {
        let mask = masks.of_view(view)?.ok_or("no mask")?;
        let in_view = &boxes.views[&view.camera.name];
        let ids: Vec<u32> = in_view.iter().filter_map(|b| b.id).collect();
        let seen: Vec<u32> = mask.ids_present().keys().map(|id| u32::from(*id)).collect();
        assert_eq!(ids, (next..next + ids.len() as u32).collect::<Vec<_>>());
        assert_eq!(ids, seen);
        next += ids.len() as u32;
        for found in in_view {
            let category = found.id.and_then(|id| masks.categories.get(&id));
            assert!(category.is_some() && category == found.category.as_ref(), "{found:?}");
            let [left, top, right, bottom] = found.box_px;
            assert!(left >= 0.0 && top >= 0.0 && right <= 93.0 && bottom <= 61.0, "{found:?}");
        }
        let scores: Vec<f64> = in_view.iter().filter_map(|b| b.score).collect();
        assert!(scores.is_sorted_by(|a, b| a >= b) && scores.iter().all(|s| *s > 0.3), "{scores:?}");
    }
    assert_eq!((masks.categories.len(), next as usize - 1), (report.masks, report.masks));
    let again = folder.path().join("again");
    assert_eq!(masks_in(&again, &views, " CAR.chair. potted  plant. car")?, report);
    for name in ["a.png", "b.c.png", "categories.json", "boxes.json"] {
        assert_eq!(std::fs::read(out.join(name))?, std::fs::read(again.join(name))?, "{name}");
    }
    Ok(())
}

#[test]
fn masks_are_drawn_over_the_photo_as_it_is_stored() -> Outcome {
    if !has_onnxruntime() {
        return Ok(());
    }
    let folder = tempfile::tempdir()?;
    let mut views = views(folder.path())?;
    let (plain, bent) = (folder.path().join("plain"), folder.path().join("bent"));
    masks_in(&plain, &views, "car. chair.")?;
    for view in &mut views {
        view.distortion = Some(Distortion { k1: 0.2, k2: 0.0, p1: 0.0, p2: 0.0 });
    }
    masks_in(&bent, &views, "car. chair.")?;
    assert_eq!(read_mask(&plain.join("a.png"))?, read_mask(&bent.join("a.png"))?);
    Ok(())
}

#[test]
fn views_and_models_that_cannot_be_used_are_named() -> Outcome {
    if !has_onnxruntime() {
        return Ok(());
    }
    let folder = tempfile::tempdir()?;
    let out = folder.path().join("out");
    let mut views = views(folder.path())?;
    views[1].image_path = folder.path().join("none.png");
    let text = masks_in(&out, &views, "car.").unwrap_err().to_string();
    assert!(text.starts_with("view b.c: ") && text.contains("none.png"), "{text}");
    // Other models than the list says: other bytes, then the wrong graph under the right checksum.
    let own = copied_models(folder.path())?;
    let open = |own: &Path| {
        let opened = Detector::open(&ModelsFolder::open(own)?, &Prompt::parse("car")?, &RuntimeOptions::default());
        opened.map(|_| ()).map_err(Box::<dyn std::error::Error>::from)
    };
    open(&own)?;
    let graph = own.join("grounding_dino.onnx");
    let mut bytes = std::fs::read(&graph)?;
    bytes[1000] ^= 1;
    std::fs::write(&graph, &bytes)?;
    let text = open(&own).unwrap_err().to_string();
    assert!(text.contains("SHA-256") && text.contains("export_grounding_dino.py"), "{text}");
    let list = std::fs::read_to_string(own.join("models.json"))?;
    let mut list: serde_json::Value = serde_json::from_str(&list)?;
    list["detector"]["graph"] = list["segmenter"]["encoder"].clone();
    std::fs::write(own.join("models.json"), list.to_string())?;
    let text = open(&own).unwrap_err().to_string();
    assert!(text.contains("sam_encoder.onnx: makes embeddings of image, and should make logits"), "{text}");
    assert!(!text.contains('\n'));
    Ok(())
}

#[test]
fn other_shapes_than_the_list_says_are_named() -> Outcome {
    if !has_onnxruntime() {
        return Ok(());
    }
    let tensors = Tensors::read()?;
    let mut models = models();
    models.detector.max_tokens = 40;
    models.segmenter.mask_px = 8;
    let mut detector = Detector::open(&models, &Prompt::parse("car")?, &RuntimeOptions::default())?;
    let text = detector.detect(&tensors.photo(), &DetectOptions::default()).unwrap_err().to_string();
    assert!(text.contains("made logits of the shape [1, 12, 48]") && text.contains("models.json"), "{text}");
    let mut segmenter = Segmenter::open(&models, &RuntimeOptions::default())?;
    let embedding = segmenter.encode(&tensors.photo())?;
    let text = segmenter.masks(&embedding, &[[0.0, 0.0, 9.0, 9.0]]).unwrap_err().to_string();
    assert!(text.contains("made mask_logits of the shape [1, 3, 16, 16]"), "{text}");
    // A canvas that the graph was not made for.
    models.segmenter.side_px = 48;
    let text = Segmenter::open(&models, &RuntimeOptions::default())?.encode(&tensors.photo()).err();
    let text = text.map(|e| e.to_string()).unwrap_or_default();
    assert!(text.contains("sam_encoder.onnx: cannot be run") && !text.contains('\n'), "{text}");
    Ok(())
}

#[test]
fn devices_that_the_library_lacks_are_named() {
    if !has_onnxruntime() {
        return;
    }
    // No build has both of these.
    let open = |provider| {
        let options = RuntimeOptions { provider, ..RuntimeOptions::default() };
        Segmenter::open(&models(), &options).err().map(|e| e.to_string()).unwrap_or_default()
    };
    let texts = [open(Provider::CoreMl), open(Provider::DirectMl)];
    let named = texts.iter().find(|t| t.contains("was built without") && t.contains("it has cpu"));
    assert!(named.is_some_and(|t| t.starts_with("--provider: ") && !t.contains('\n')), "{texts:?}");
}

/// A copy of the fixture's models.
fn copied_models(folder: &Path) -> std::io::Result<PathBuf> {
    let copy = folder.join("models");
    std::fs::create_dir(&copy)?;
    for entry in std::fs::read_dir(models_folder())? {
        let entry = entry?;
        std::fs::copy(entry.path(), copy.join(entry.file_name()))?;
    }
    Ok(copy)
}

/// Set in the process that tries a library: which one.
const LIBRARY_TO_TRY: &str = "INSTGS_TEST_LIBRARY";

/// Each library is tried in a process of its own, since a process loads one at most; and because it must neither hang nor
/// panic.
#[test]
fn libraries_that_are_none_are_named() -> Outcome {
    if let Some(library) = std::env::var_os(LIBRARY_TO_TRY) {
        let options = RuntimeOptions { library: Some(library.into()), ..RuntimeOptions::default() };
        let error = Segmenter::open(&models(), &options).err().map(|e| e.to_string());
        println!("ANSWER: {}", error.unwrap_or_else(|| "it could be loaded".into()));
        return Ok(());
    }
    let folder = tempfile::tempdir()?;
    let text = folder.path().join("text.so");
    std::fs::write(&text, "no library")?;
    let empty = folder.path().join("empty.so");
    std::fs::write(&empty, "")?;
    let missing = folder.path().join("missing.so");
    let mut cases = vec![(text, "cannot be loaded"), (empty, "cannot be loaded"), (missing, "is no file")];
    // A library that is another one: the system's own, where it says which it is.
    let maps = std::fs::read_to_string("/proc/self/maps").unwrap_or_default();
    let other = maps.split_whitespace().find(|word| word.contains("/libc.so"));
    cases.extend(other.map(|path| (path.into(), "is a library, but not ONNX Runtime's")));
    for (library, want) in cases {
        let answer = answer_for(&library)?;
        assert!(answer.contains(want) && answer.contains("tools/setup_onnxruntime"), "{}: {answer}", library.display());
        assert!(answer.contains(&library.display().to_string()), "{answer}");
    }
    Ok(())
}

/// What a process of its own says to a library.
fn answer_for(library: &Path) -> Result<String, Box<dyn std::error::Error>> {
    let mut child = Command::new(std::env::current_exe()?)
        .args(["detect::libraries_that_are_none_are_named", "--exact", "--nocapture"])
        .env(LIBRARY_TO_TRY, library)
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()?;
    let start = Instant::now();
    while child.try_wait()?.is_none() {
        if start.elapsed() > Duration::from_secs(120) {
            child.kill()?;
            return Err(format!("{}: hangs", library.display()).into());
        }
        std::thread::sleep(Duration::from_millis(20));
    }
    let output = child.wait_with_output()?;
    let text = String::from_utf8(output.stdout)?;
    let answer = text.lines().find_map(|line| line.split_once("ANSWER: "));
    Ok(answer.ok_or_else(|| format!("{text} {}", String::from_utf8_lossy(&output.stderr)))?.1.to_owned())
}
