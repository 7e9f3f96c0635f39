//! The pages for people: links that lead somewhere, commands that exist, and a README that stays short.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::common::program::{program, repository};

/// The README, the other pages beside it, and all of `docs/`.
fn pages() -> Vec<PathBuf> {
    let mut out = Vec::new();
    let mut open = vec![repository().join("docs")];
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(folder).unwrap() {
            let path = entry.unwrap().path();
            if path.is_dir() { open.push(path) } else { out.push(path) }
        }
    }
    out.extend(std::fs::read_dir(repository()).unwrap().map(|entry| entry.unwrap().path()));
    out.retain(|path| path.extension().is_some_and(|ending| ending == "md"));
    out.sort();
    out
}

/// The text without blocks of code and without code between backticks, in which brackets are no links.
fn prose(text: &str) -> String {
    let is_fence = |line: &str| line.trim_start().starts_with("```");
    let mut is_code = false;
    let outside = |line: &&str| {
        is_code ^= is_fence(line);
        !is_code && !is_fence(line)
    };
    let lines: Vec<&str> = text.lines().filter(outside).collect();
    lines.join("\n").split('`').step_by(2).collect()
}

/// Targets of `[text](target)` and `![text](target)`.
fn links(text: &str) -> Vec<String> {
    let prose = prose(text);
    prose.split("](").skip(1).filter_map(|rest| Some(rest.split_once(')')?.0.to_owned())).collect()
}

/// The anchors of a page's headings, as GitHub makes them.
fn anchors(text: &str) -> BTreeSet<String> {
    let mut is_code = false;
    let mut out = BTreeSet::new();
    for line in text.lines() {
        is_code ^= line.trim_start().starts_with("```");
        if let Some(heading) = line.strip_prefix('#').filter(|_| !is_code) {
            let kept = |c: &char| c.is_alphanumeric() || " -_".contains(*c);
            let words: String = heading.trim_start_matches('#').trim().to_lowercase().chars().filter(kept).collect();
            out.insert(words.replace(' ', "-"));
        }
    }
    out
}

/// What is wrong with the links of a page; empty if all lead somewhere.
fn broken(page: &Path, text: &str) -> Vec<String> {
    let of = |link: String| {
        let (file, anchor) = link.split_once('#').unwrap_or((&link, ""));
        if link.contains("://") {
            return None;
        }
        let target = if file.is_empty() { page.to_path_buf() } else { page.parent()?.join(file) };
        if !target.exists() {
            return Some(format!("{}: {link}: there is no such file", page.display()));
        }
        let has_anchor = || anchors(&std::fs::read_to_string(&target).unwrap()).contains(anchor);
        let is_missing = !anchor.is_empty() && !has_anchor();
        is_missing.then(|| format!("{}: {link}: there is no such heading", page.display()))
    };
    links(text).into_iter().filter_map(of).collect()
}

#[test]
fn every_link_leads_to_a_file_and_a_heading() {
    let (mut seen, mut wrong) = (0, Vec::new());
    for page in pages() {
        let text = std::fs::read_to_string(&page).unwrap();
        seen += links(&text).len();
        wrong.extend(broken(&page, &text));
    }
    assert!(seen > 40, "{seen} links");
    assert!(wrong.is_empty(), "{}", wrong.join("\n"));
}

#[test]
fn a_link_to_nothing_is_found() {
    let page = repository().join("README.md");
    let text = "# A b, c\n[a](#a-b-c) `[x](y)` [b](docs/none.md) [c](docs/glossary.md#scene) [d](docs/glossary.md#none)\n\
        [e](https://example.org/x)\n```\n[f](no)\n```\n[g](#none)";
    assert!(anchors(text).contains("a-b-c"));
    let found: Vec<String> =
        broken(&page, text).iter().map(|line| line.rsplit_once(": there").unwrap().0.into()).collect();
    let want =
        ["#a-b-c", "docs/none.md", "docs/glossary.md#none", "#none"].map(|link| format!("{}: {link}", page.display()));
    // "#a-b-c" is a heading of the text here, not of the file.
    assert_eq!(found, want);
}

#[test]
fn the_readme_is_short_and_its_pictures_are_small() {
    let text = std::fs::read_to_string(repository().join("README.md")).unwrap();
    assert!(text.lines().count() < 180, "{} lines", text.lines().count());
    let pictures = links(&text).into_iter().filter(|link| link.contains("docs/pictures/"));
    let sizes: Vec<(String, u64)> =
        pictures.map(|link| (link.clone(), std::fs::metadata(repository().join(&link)).unwrap().len())).collect();
    assert!(sizes.len() == 2 && sizes[0].1 <= 250_000 && sizes[1].1 <= 800_000, "{sizes:?}");
}

/// Every `instgs-vk COMMAND` in blocks of code is a command of the program, and every `--flag` there is one of it.
#[test]
fn commands_of_the_pages_exist() {
    let mut helps = std::collections::BTreeMap::new();
    let mut help = |command: &str| -> String {
        let of = || {
            let output = program().args([command, "--help"]).output().unwrap();
            String::from_utf8_lossy(&output.stdout).into_owned()
        };
        helps.entry(command.to_owned()).or_insert_with(of).clone()
    };
    let mut seen = 0;
    for page in ["README.md", "docs/guide.md", "docs/player.md"] {
        let text = std::fs::read_to_string(repository().join(page)).unwrap();
        for line in code_lines(&text) {
            let words: Vec<&str> = line.split('#').next().unwrap_or("").split_whitespace().collect();
            let [first, command, rest @ ..] = words.as_slice() else { continue };
            if *first != "instgs-vk" {
                continue;
            }
            seen += 1;
            let help = help(command);
            assert!(help.contains("Usage:"), "{page}: {line}: no such command");
            for flag in rest.iter().filter(|word| word.starts_with("--")) {
                assert!(help.contains(flag), "{page}: {line}: {flag} is no flag of {command}");
            }
        }
    }
    assert!(seen > 15, "{seen} commands");
}

/// The lines of blocks of code, each command with its continuations on one line.
fn code_lines(text: &str) -> Vec<String> {
    let mut is_code = false;
    let mut out = Vec::new();
    for line in text.replace("\\\n", " ").lines() {
        if line.trim_start().starts_with("```") {
            is_code = !is_code;
        } else if is_code {
            out.push(line.trim().to_owned());
        }
    }
    out
}
