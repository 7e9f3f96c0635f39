//! Whole runs of masks from a prompt, on tiny models with random weights, and what cannot be used.

use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

use instgs_detect::{
    DetectOptions, Detector, ModelsFolder, Prompt, PromptOptions, PromptReport, Provider, RuntimeOptions, Segmenter,
    masks_from_prompt,
};
use instgs_io::picture_png::write_png;
use instgs_io::{MaskFolder, Split, View, read_boxes, read_mask};
use instgs_vk::math::distortion::Distortion;
use instgs_vk::scene::Camera;

use crate::onnx::{Tensors, has_onnxruntime, models, models_folder, runtime};

type Outcome = Result<(), Box<dyn std::error::Error>>;

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
    let options = PromptOptions { detect, runtime: runtime() };
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
    let masks = MaskFolder::open(&out, &views)?;
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
        view.distortion = Some(Distortion { k1: 0.2, k2: 0.0, p1: 0.0, p2: 0.0, k3: 0.0, fisheye: None });
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
        let opened = Detector::open(&ModelsFolder::open(own)?, &Prompt::parse("car")?, &runtime());
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
    assert!(
        text.contains("sam_encoder.onnx: has the outputs embeddings for the inputs image, and should have logits"),
        "{text}"
    );
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
    let mut detector = Detector::open(&models, &Prompt::parse("car")?, &runtime())?;
    let text = detector.detect(&tensors.photo(), &DetectOptions::default()).unwrap_err().to_string();
    assert!(text.contains("gave logits the shape [1, 12, 48]") && text.contains("models.json"), "{text}");
    let mut segmenter = Segmenter::open(&models, &runtime())?;
    let embedding = segmenter.encode(&tensors.photo())?;
    let text = segmenter.masks(&embedding, &[[0.0, 0.0, 9.0, 9.0]]).unwrap_err().to_string();
    assert!(text.contains("gave mask_logits the shape [1, 3, 16, 16]"), "{text}");
    // A canvas that the graph was not made for.
    models.segmenter.side_px = 48;
    let text = Segmenter::open(&models, &runtime())?.encode(&tensors.photo()).err();
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
        let options = RuntimeOptions { provider, ..runtime() };
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
    // A download that ended early, which the system's loader would die of.
    let cut = folder.path().join("cut.so");
    let whole = std::fs::read(std::env::current_exe()?)?;
    std::fs::write(&cut, &whole[..whole.len() / 2])?;
    cases.extend(cfg!(target_os = "linux").then_some((cut, "is truncated")));
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
        .args(["detect_runs::libraries_that_are_none_are_named", "--exact", "--nocapture"])
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
