//! No text that a person reads stands elsewhere.

use std::path::{Path, PathBuf};

/// Files without texts of the window: texts themselves, the command line with the errors that it shares with the window, and the
/// language of scripts.
const OTHER: [&str; 7] = ["texts.rs", "keys.rs", "questions.rs", "program.rs", "main.rs", "error.rs", "script.rs"];
/// What stands before a literal that nobody reads: ids of widgets, endings and names of files, parts of other texts' errors.
const BEFORE: [&str; 25] = [
    "with(",
    "Grid::new(",
    "Id::new(",
    "Id::new((",
    "Area::new(",
    "from_id_salt(",
    "GpuError::vulkan(",
    "free_name(",
    "free_names([",
    "rescued(",
    "join(",
    "with_extension(",
    "with_file_name(",
    "var_os(",
    "look_at(",
    "Command::new(",
    "arg(",
    "feature: ",
    "last_pass: ",
    "what: ",
    "kernel: ",
    "file_of_user(",
    "let feature = ",
    "for_readback(&self.gpu, ",
    "PlayerError::Script(format!(",
];
/// Further literals that nobody reads, or that are names everywhere.
const NAMES: [&str; 36] = [
    "instgs",
    "ply",
    "spz",
    "sog",
    "splat",
    "glb",
    "mp4",
    "usda",
    "usdc",
    "html",
    "INSTGS_PLAYER_CONFIG",
    "hide",
    "show",
    "lock",
    "unlock",
    "interface",
    "view",
    "submissions",
    "waits",
    "drains",
    "-y",
    "-loglevel",
    "error",
    "-framerate",
    "-i",
    "-vf",
    "-pix_fmt",
    "yuv420p",
    "pad=ceil(iw/2)*2:ceil(ih/2)*2",
    "too few pixels",
    "a script's lose",
    "user interface",
    "failed",
    "ffmpeg: {error}",
    "ffmpeg: {}",
    "{:05}.png",
];

/// The literals of a program's text with what stands before each on its line; without comments, attributes and tests.
fn literals(source: &str) -> Vec<(String, String)> {
    let source = source.split("#[cfg(test)]\nmod tests").next().unwrap_or_default();
    let mut found = Vec::new();
    let (mut before, mut rest) = (String::new(), source);
    while let Some(c) = rest.chars().next() {
        if rest.starts_with("//") || rest.starts_with("#[") {
            rest = rest.find('\n').map_or("", |end| &rest[end..]);
        } else if rest.starts_with("'\"'") {
            rest = &rest[3..];
        } else if c == '"' {
            let mut escaped = false;
            let end = rest[1..].find(|c| {
                c == '"' && !escaped || {
                    escaped = c == '\\' && !escaped;
                    false
                }
            });
            let end = 1 + end.expect("a literal ends");
            found.push((before.trim_start().to_owned(), rest[1..end].to_owned()));
            before.push_str(&rest[..=end]);
            rest = &rest[end + 1..];
        } else {
            if c == '\n' {
                before.clear();
            } else {
                before.push(c);
            }
            rest = &rest[c.len_utf8()..];
        }
    }
    found
}

/// The literal without the names of its parameters, if it has letters then.
fn words(literal: &str) -> bool {
    let mut depth = 0;
    literal.chars().any(|c| {
        depth += i32::from(c == '{') - i32::from(c == '}');
        depth == 0 && c.is_alphabetic()
    })
}

/// Literals of a program's text that a person may read.
fn read_by_people(source: &str) -> Vec<String> {
    let is_free = |(before, literal): &(String, String)| {
        !words(literal) || NAMES.contains(&literal.as_str()) || BEFORE.iter().any(|end| before.ends_with(end))
    };
    literals(source)
        .into_iter()
        .filter(|found| !is_free(found))
        .map(|(before, text)| format!("{before}{text:?}"))
        .collect()
}

fn sources(folder: &Path, out: &mut Vec<PathBuf>) {
    for entry in folder.read_dir().unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        if path.is_dir() {
            sources(&path, out);
        } else if name != "tests.rs" && name != "test_screen.rs" && !OTHER.contains(&name.as_str()) {
            out.push(path);
        }
    }
}

#[test]
fn every_text_of_the_window_is_here() {
    let mut files = Vec::new();
    sources(&Path::new(env!("CARGO_MANIFEST_DIR")).join("src"), &mut files);
    assert!(files.len() > 40, "{files:?}");
    let all = files.iter().flat_map(|file| {
        let source = std::fs::read_to_string(file).unwrap();
        read_by_people(&source).into_iter().map(move |text| format!("{}: {text}", file.display()))
    });
    assert_eq!(all.collect::<Vec<String>>(), Vec::<String>::new());
}

#[test]
fn a_text_elsewhere_is_noticed() {
    let source = "fn f() {\n // ui.label(\"no\");\n ui.label(\"Seed\"); ui.label(texts::SEED); id.with(\"seed\"); \
                  format!(\"{name} {count}\"); format!(\"{count} \\\"Gaussians\\\"\") }\n#[cfg(test)]\nmod tests { \"x y\" }";
    let found = read_by_people(source);
    assert!(found.len() == 2 && found[0].ends_with("(\"Seed\"") && found[1].contains("Gaussians"), "{found:?}");
}
