//! Every message of this crate: each has the file, and a place in it or a next step, unless it says itself what to do.

#![allow(clippy::print_stdout, reason = "--nocapture shows the messages, to be read side by side")]

use std::fmt::Write;
use std::path::{Path, PathBuf};

use crate::masks::{coco, labelme};
use crate::{IoError, MaskFolder, Place};
use crate::{boxes, camera_file, checkpoint, colmap, exposures, glb, groups, ktx2, mask_png, nerf, ply, point_cloud};
use crate::{masks, read_bytes, scene_file, sog, splat, spz};

type Outcome = Result<(), Box<dyn std::error::Error>>;

/// A message is a line that a terminal of usual width wraps three times at most.
const LONGEST: usize = 300;

/// Messages without place and next step that need none, and why. Each is the beginning of the text after the path, or a part of
/// the code that makes it.
const SELF_EXPLANATORY: [(&str, &str); 12] = [
    ("cannot read: ", "the system's reason follows: it is missing, or may not be read"),
    ("cannot write: {e}", "the reason of the system or of an encoder follows"),
    ("cannot create the folder: {e}", "the system's reason follows"),
    ("is a folder, not a file", "the user gives a file instead"),
    ("cannot write: an image of ", "a fault of a caller of this library, which no user can mend"),
    ("cannot write: {count} ids do not make", "a fault of a caller of this library"),
    ("cannot write: {} bytes where", "a fault of a caller of this library"),
    ("cannot write: {id} is not a mask id", "a fault of a caller of this library"),
    ("cannot write: the sensitivity was", "a fault of a caller of this library"),
    ("cannot write: Gaussian {i} has a value that is not finite", "which Gaussian is the place"),
    ("cannot write: the up direction", "a fault of a caller of this library"),
    ("cannot write: more than 2^32 splats", "no scene of this size can be had in this format"),
];

/// The code of every `IoError::new(...)` in this crate, with what follows it in its statement.
fn sites() -> Result<Vec<(PathBuf, usize, String)>, std::io::Error> {
    let mut open = vec![Path::new(env!("CARGO_MANIFEST_DIR")).join("src")];
    let mut out = Vec::new();
    while let Some(path) = open.pop() {
        if path.is_dir() {
            for entry in std::fs::read_dir(&path)? {
                open.push(entry?.path());
            }
        } else if path.extension().is_some_and(|e| e == "rs") && !path.to_string_lossy().contains("tests") {
            let text = std::fs::read_to_string(&path)?;
            // What follows the tests' head is no message.
            let code = text.split("#[cfg(test)]\nmod tests {").next().unwrap_or_default();
            for (at, _) in code.match_indices("IoError::new(") {
                let line = 1 + code[..at].matches('\n').count();
                out.push((path.clone(), line, statement(&code[at..]).to_owned()));
            }
        }
    }
    out.sort();
    Ok(out)
}

/// A statement and the next one if that goes on with the error: up to an empty line or the end of a block.
fn statement(code: &str) -> &str {
    let ends = ["\n\n", "\n}\n", "\n    }\n"].iter().filter_map(|end| code.find(end)).min();
    &code[..ends.unwrap_or(code.len())]
}

#[test]
fn every_message_in_the_code_has_a_place_or_a_next_step() -> Outcome {
    let (mut all, mut faults) = (String::new(), String::new());
    let sites = sites()?;
    for (path, line, code) in &sites {
        let one_line = code.split_whitespace().collect::<Vec<_>>().join(" ");
        let shown: String = one_line.chars().take(160).collect();
        let place = format!("{}:{line}", path.strip_prefix(env!("CARGO_MANIFEST_DIR")).unwrap_or(path).display());
        writeln!(all, "{place}: {shown}")?;
        let helps = [".at(", ".advise("].iter().any(|call| one_line.contains(call));
        let explains = SELF_EXPLANATORY.iter().any(|(text, _)| one_line.contains(text));
        if !helps && !explains {
            writeln!(faults, "{place}: {shown}")?;
        }
    }
    println!("{all}");
    assert!(sites.len() > 100 && faults.is_empty(), "neither a place nor a next step:\n{faults}");
    Ok(())
}

/// What is wrong with a message, if anything is.
fn fault(error: &IoError) -> Option<&'static str> {
    let text = error.to_string();
    let explains = SELF_EXPLANATORY.iter().any(|(start, _)| error.what.starts_with(start));
    match () {
        () if !text.starts_with(&error.path.display().to_string()) => Some("does not begin with the file"),
        () if text.contains(['\n', '\r']) => Some("has a line break"),
        () if text.chars().count() > LONGEST => Some("is too long"),
        () if error.place == Place::File && error.advice.is_none() && !explains => {
            Some("has neither a place nor a next step")
        }
        () => None,
    }
}

/// Text and bytes that are no file of any kind, and beginnings of files.
fn bad_inputs() -> Vec<Vec<u8>> {
    let texts = [
        "",
        "x",
        "{",
        "[",
        "[]",
        "{}",
        "null",
        "{\"a\":1,}",
        "[{}]",
        "ply\n",
        "ply\nformat ascii 1.0\nend_header\n",
        "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nend_header\n1\n",
        "ply\nformat ascii 9.0\nelement vertex 1\nend_header\n",
        "1 PINHOLE 2 2 1 1 1\n",
        "1 SPHERE 2 2 1\n",
        "1 1 0 0\n",
        "{\"frames\":[]}",
        "{\"frames\":[{}]}",
        "{\"images\":[],\"annotations\":[]}",
        "{\"images\":[{}],\"annotations\":[]}",
        "{\"images\":[],\"annotations\":[{\"id\":1}]}",
        "{\"shapes\":[{}]}",
        "{\"shapes\":[]}",
        "{\"objects\":[{}]}",
        "[{\"template_id\":1,\"instances\":[]}]",
        "{\"version\":2,\"count\":3}",
        "{\"7\":1}",
        "NGSP",
        "glTF",
    ];
    let mut out: Vec<Vec<u8>> = texts.iter().map(|text| text.as_bytes().to_vec()).collect();
    out.extend([
        vec![0; 64],
        vec![255; 64],
        b"\xFF\xFE{\0}\0".to_vec(),
        b"a\xE9b".to_vec(),
        b"\x1f\x8b\x08\0junk".to_vec(),
    ]);
    out.push([&b"NGSP"[..], &3u32.to_le_bytes(), &[255; 40]].concat());
    out.push([&b"glTF"[..], &2u32.to_le_bytes(), &200u32.to_le_bytes(), &[9; 20]].concat());
    out.push([&b"\x89PNG\r\n\x1a\n"[..], &[0; 30]].concat());
    out.push([&b"PK\x03\x04"[..], &[7; 40]].concat());
    out.push([&b"\xABKTX 20\xBB\r\n\x1A\n"[..], &[1; 90]].concat());
    out.push([&9u64.to_le_bytes()[..], &[1; 90]].concat());
    out
}

type Reader = fn(&[u8], &Path) -> Result<(), IoError>;

/// Every reader of bytes, and those of folders and files by their paths.
fn readers() -> Vec<(&'static str, Reader)> {
    const CAMERAS: &[u8] = b"1 PINHOLE 20 10 9 9 10 5\n";
    vec![
        ("ply", |b, p| ply::parse_ply(b, p).map(|_| ())),
        ("points ply", |b, p| point_cloud::parse_points_ply(b, p).map(|_| ())),
        ("points3D.bin", |b, p| point_cloud::parse_points_bin(b, p).map(|_| ())),
        ("points3D.txt", |b, p| point_cloud::parse_points_txt(b, p).map(|_| ())),
        ("spz", |b, p| spz::parse_spz(b, p).map(|_| ())),
        ("sog", |b, p| sog::parse_sog(b, p).map(|_| ())),
        ("splat", |b, p| splat::parse_splat(b, p).map(|_| ())),
        ("glb", |b, p| glb::parse_glb(b, p).map(|_| ())),
        ("instgs", |b, p| scene_file::parse_scene_file(b, p).map(|_| ())),
        ("checkpoint", |b, p| checkpoint::parse(b, p).map(|_| ())),
        ("ktx2", |b, p| ktx2::parse_ktx2(b, p).map(|_| ())),
        ("mask", |b, p| mask_png::parse_mask(b, p).map(|_| ())),
        ("cameras", |b, p| camera_file::parse_cameras(b, p).map(|_| ())),
        ("transforms", |b, p| nerf::parse_transforms(b, p).map(|_| ())),
        ("groups", |b, p| groups::parse_groups(b, p).map(|_| ())),
        ("coco", |b, p| coco::parse_coco(b, p).map(|_| ())),
        ("labelme", |b, p| labelme::parse_labelme(b, p).map(|_| ())),
        ("cameras.bin", |b, p| colmap::parse_colmap_bin(b, b, p).map(|_| ())),
        ("cameras.txt", |b, p| colmap::parse_colmap_txt(b, b"", p).map(|_| ())),
        ("images.txt", |b, p| colmap::parse_colmap_txt(CAMERAS, b, p).map(|_| ())),
        ("boxes", |b, p| std::fs::write(p, b).map_or(Ok(()), |()| boxes::read_boxes(p).map(|_| ()))),
        ("exposures", |b, p| std::fs::write(p, b).map_or(Ok(()), |()| exposures::read_exposures(p).map(|_| ()))),
        ("categories", |b, p| std::fs::write(p, b).map_or(Ok(()), |()| masks::read_categories(p).map(|_| ()))),
        ("missing", |_, p| read_bytes(&p.with_extension("none")).map(|_| ())),
        ("folder", |_, p| read_bytes(p.parent().unwrap_or(p)).map(|_| ())),
        ("masks", |_, p| MaskFolder::open(p.parent().unwrap_or(p), &[]).map(|_| ())),
        ("masks in a file", |b, p| std::fs::write(p, b).map_or(Ok(()), |()| MaskFolder::open(p, &[]).map(|_| ()))),
    ]
}

#[test]
fn messages_of_bad_files_are_one_line_with_a_place_or_a_next_step() -> Outcome {
    let folder = tempfile::tempdir()?;
    let path = folder.path().join("file.json");
    let (mut count, mut all, mut faults) = (0, String::new(), String::new());
    for (name, reader) in readers() {
        let mut errors: Vec<IoError> =
            bad_inputs().into_iter().filter_map(|bytes| reader(&bytes, &path).err()).collect();
        errors.sort_by_key(ToString::to_string);
        errors.dedup();
        assert!(!errors.is_empty(), "{name} refuses nothing");
        for error in errors {
            count += 1;
            let short = error.to_string().replace(&folder.path().display().to_string(), "");
            writeln!(all, "{name:<16} {short}")?;
            if let Some(fault) = fault(&error) {
                writeln!(faults, "{name}: {fault}: {short}")?;
            }
        }
    }
    println!("{all}");
    assert!(count > 100 && faults.is_empty(), "of {count} messages:\n{faults}");
    Ok(())
}
