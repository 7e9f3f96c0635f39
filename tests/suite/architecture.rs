//! Rules that the compiler does not check: a twin and a test for each kernel, layers that only look down, words that are banned.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn root() -> &'static Path {
    Path::new(env!("CARGO_MANIFEST_DIR"))
}

/// All files below `folder` with the extension.
fn files(folder: &str, extension: &str) -> Vec<PathBuf> {
    let mut out = Vec::new();
    let mut open = vec![root().join(folder)];
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
        let twin = named_after(&head, "Twin: `reference::").unwrap_or_else(|| panic!("{} has a twin", path.display()));
        let test = named_after(&head, "`tests/kernels/").unwrap_or_else(|| panic!("{} has a test", path.display()));
        for needed in [format!("src/reference/{twin}.rs"), format!("tests/kernels/{test}.rs")] {
            assert!(root().join(&needed).exists(), "{} names {needed}", path.display());
        }
    }
}

/// Layer of each module; a module may use its own layer's siblings only where listed, and any lower layer.
const LAYERS: [(&str, u32); 20] = [
    ("math", 0),
    ("gpu", 1),
    ("scene", 1),
    ("reference", 2),
    ("io", 2),
    ("kernels", 2),
    ("render", 3),
    ("optim", 3),
    ("detect", 4),
    ("eval", 4),
    ("template", 4),
    ("segment", 4),
    ("register", 4),
    ("synth", 5),
    ("train", 5),
    ("pipeline", 6),
    ("report", 7),
    ("bench", 8),
    ("player", 6),
    ("cli", 9),
];

#[test]
fn modules_use_only_layers_below_them() {
    let layer = |module: &str| LAYERS.iter().find(|(name, _)| *name == module).map(|(_, layer)| *layer);
    let mut seen = BTreeSet::new();
    for path in files("src", "rs") {
        let relative = path.strip_prefix(root().join("src")).unwrap();
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
fn only_gpu_speaks_vulkan() {
    for path in files("src", "rs") {
        let relative = path.strip_prefix(root().join("src")).unwrap().to_string_lossy().into_owned();
        if !relative.starts_with("gpu") {
            let text = read(&path);
            assert!(!text.contains("ash::") && !text.contains("gpu_allocator"), "{relative}");
        }
    }
}

#[test]
fn banned_words() {
    // Put together here so that this file does not hold them.
    let banned = [["keep in", "sync"].join(" "), ["kept in", "sync"].join(" "), ["FIX", "ME"].concat()];
    for path in [files("src", "rs"), files("tests", "rs"), files("glsl", "comp"), files("glsl", "glsl")].concat() {
        let text = read(&path);
        for word in &banned {
            assert!(!text.contains(word.as_str()), "{}: {word}", path.display());
        }
    }
}
