//! Rules that the compiler does not check: a twin and a test for each kernel, layers that only look down, words that are banned.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::common::repository;

/// All files below `folder` with the extension.
fn files(folder: &str, extension: &str) -> Vec<PathBuf> {
    let mut out = Vec::new();
    let mut open = vec![repository().join(folder)];
    while let Some(path) = open.pop() {
        for entry in std::fs::read_dir(&path).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e == extension) {
                out.push(path);
            }
        }
    }
    out.sort();
    out
}

fn read(path: &Path) -> String {
    std::fs::read_to_string(path).unwrap()
}

/// The first name between `` `before `` and one of the characters that end it, if the text has any.
fn named_after<'a>(text: &'a str, before: &str) -> Option<&'a str> {
    text.split_once(before)?.1.split(['`', ':', '.']).next()
}

#[test]
fn every_shader_names_its_twin_and_its_test() {
    let kernels = files("glsl", "comp");
    assert!(kernels.len() >= 14, "{} kernels", kernels.len());
    for path in kernels {
        let text = read(&path);
        let head: String = text.lines().skip(1).take_while(|l| l.starts_with("//")).collect();
        let twin =
            named_after(&head, "Twin: `instgs_reference::").unwrap_or_else(|| panic!("{} has a twin", path.display()));
        let test = named_after(&head, "`tests/kernels/").unwrap_or_else(|| panic!("{} has a test", path.display()));
        for needed in [format!("dev/reference/src/{twin}.rs"), format!("tests/kernels/{test}.rs")] {
            assert!(repository().join(&needed).exists(), "{} names {needed}", path.display());
        }
    }
}

/// Layer of each module of the engine; a module may use itself and any lower layer. Between crates, Cargo checks this.
const LAYERS: [(&str, u32); 6] = [("math", 0), ("gpu", 1), ("scene", 1), ("kernels", 2), ("render", 3), ("optim", 3)];

#[test]
fn modules_use_only_layers_below_them() {
    let layer = |module: &str| LAYERS.iter().find(|(name, _)| *name == module).map(|(_, layer)| *layer);
    let mut seen = BTreeSet::new();
    for path in files("src", "rs") {
        let relative = path.strip_prefix(repository().join("src")).unwrap();
        let module = relative.iter().next().unwrap().to_string_lossy().into_owned();
        let Some(own) = layer(&module) else { continue };
        seen.insert(module.clone());
        for line in read(&path).lines() {
            for used in line.split("crate::").skip(1) {
                let used: String = used.chars().take_while(|c| c.is_alphanumeric() || *c == '_').collect();
                let Some(other) = layer(&used) else { continue };
                let allowed = used == module || other < own;
                assert!(allowed, "{}: {module} (layer {own}) uses {used} (layer {other})", relative.display());
            }
        }
    }
    assert!(seen.contains("gpu") && seen.contains("render"), "{seen:?}");
}

#[test]
fn only_gpu_and_the_players_window_speak_vulkan() {
    let sources = [files("src", "rs"), files("crates", "rs"), files("dev", "rs")].concat();
    for path in sources {
        let relative = path.strip_prefix(repository()).unwrap().to_string_lossy().into_owned();
        let allowed = ["src/gpu", "crates/player/src/swapchain.rs", "crates/player/src/ui_painter.rs"];
        if !allowed.iter().any(|place| relative.starts_with(place)) {
            // The standard library has a module `hash`.
            let text = read(&path).replace("std::hash::", "");
            assert!(!text.contains("ash::") && !text.contains("gpu_allocator"), "{relative}");
        }
    }
}

/// Where else than in `src/gpu` code is unsafe, and why it has to be.
const UNSAFE: [(&str, &str); 9] = [
    ("src/render/image_frames.rs", "promises of a caller about its Vulkan objects, passed on to src/gpu"),
    ("crates/player/src/swapchain.rs", "Vulkan calls of a window"),
    ("crates/player/src/ui_painter.rs", "Vulkan calls of a window"),
    ("crates/player/src/window/opening.rs", "makes the swapchain, whose window must outlive it"),
    ("crates/eval/src/lpips/layers.rs", "matrixmultiply's sgemm takes pointers"),
    ("crates/console/src/lavapipe.rs", "sets an environment variable before any thread is there"),
    ("crates/cli/src/main.rs", "promises that no thread is there yet"),
    ("crates/player/src/main.rs", "promises that no thread is there yet"),
    ("dev/evidence/src/main.rs", "promises that no thread is there yet"),
];

/// Clippy wants a SAFETY comment at each place; this wants each place to be known.
#[test]
fn unsafe_code_stands_in_few_known_places() {
    let mut found = BTreeSet::new();
    for path in [files("src", "rs"), files("crates", "rs"), files("dev", "rs")].concat() {
        let relative = path.strip_prefix(repository()).unwrap().to_string_lossy().into_owned();
        let is_code = |line: &str| {
            let code = line.split("//").next().unwrap_or_default();
            ["unsafe {", "unsafe fn", "unsafe impl", "unsafe trait"].iter().any(|word| code.contains(word))
        };
        if !relative.starts_with("src/gpu/") && read(&path).lines().any(is_code) {
            found.insert(relative);
        }
    }
    let known: BTreeSet<String> = UNSAFE.iter().map(|(path, _)| (*path).to_owned()).collect();
    assert_eq!(found, known, "code that is unsafe is to be named here with its reason");
}

#[test]
fn banned_words() {
    // Put together here so that this file does not hold them.
    let banned = [["keep in", "sync"].join(" "), ["kept in", "sync"].join(" "), ["FIX", "ME"].concat()];
    for path in ["src", "crates", "dev", "tests"]
        .map(|folder| files(folder, "rs"))
        .into_iter()
        .flatten()
        .chain(files("glsl", "comp"))
        .chain(files("glsl", "glsl"))
    {
        let text = read(&path);
        for word in &banned {
            assert!(!text.contains(word.as_str()), "{}: {word}", path.display());
        }
    }
}
