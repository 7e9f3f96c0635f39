//! Which kind of masks a folder or a file holds.

use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde::de::IgnoredAny;

use crate::error::IoError;
use crate::text::text_of;
use crate::{View, read_bytes};

use super::CATEGORIES;
use super::coco::parse_coco;
use super::drawn::DrawnMasks;
use super::labelme::read_labelme;
use super::names::NameIndex;
use super::object_files::ObjectFiles;

/// Depth to which subfolders of the masks' folder are searched: `left/8bit/a.png` is found, but a folder that contains
/// a whole dataset is not searched completely.
const FOLDER_DEPTH: usize = 3;

/// The masks, by their kind.
#[derive(Clone, Debug)]
pub(super) enum Source {
    /// One PNG of ids per photo.
    Ids {
        /// The files, sorted.
        files: Vec<PathBuf>,
        /// Their places in that list.
        index: NameIndex,
    },
    /// One PNG per object and photo.
    Objects(ObjectFiles),
    /// Shapes in files of another program.
    Drawn(DrawnMasks),
}

/// A program whose JSON has masks.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Program {
    Coco,
    Labelme,
}

impl Program {
    /// The program that a file is of, by its keys; `None` if it is none of them.
    fn of(path: &Path) -> Result<Option<Self>, IoError> {
        #[derive(Deserialize)]
        struct Keys {
            images: Option<IgnoredAny>,
            annotations: Option<IgnoredAny>,
            shapes: Option<IgnoredAny>,
        }
        let bytes = read_bytes(path)?;
        // What is not JSON is none of theirs; the file that a user names is parsed again, with an error of its own.
        let Some(keys) = text_of(&bytes, path).ok().and_then(|text| serde_json::from_str::<Keys>(text).ok()) else {
            return Ok(None);
        };
        Ok(match keys {
            Keys { images: Some(_), annotations: Some(_), .. } => Some(Self::Coco),
            Keys { shapes: Some(_), .. } => Some(Self::Labelme),
            _ => None,
        })
    }
}

impl Source {
    pub(super) fn open(path: &Path, views: &[View]) -> Result<Self, IoError> {
        if path.is_file() { Self::of_file(path) } else { Self::of_folder(path, views) }
    }

    fn of_file(path: &Path) -> Result<Self, IoError> {
        let is_json = path.extension().is_some_and(|e| e.eq_ignore_ascii_case("json"));
        if !is_json {
            let error = IoError::new(path, "is a file, and masks are a folder or a COCO file");
            return Err(error.advise("give the folder that it is in"));
        }
        match Program::of(path)? {
            Some(Program::Labelme) => {
                let root = path.parent().unwrap_or(path);
                Ok(Self::Drawn(read_labelme(&[path.to_path_buf()], root)?.0))
            }
            // Its reader says what else a file lacks.
            Some(Program::Coco) | None => Ok(Self::Drawn(parse_coco(&read_bytes(path)?, path)?)),
        }
    }

    fn of_folder(folder: &Path, views: &[View]) -> Result<Self, IoError> {
        let (mut files, mut coco, mut labelme) = (Vec::new(), Vec::new(), Vec::new());
        list(folder, "png", FOLDER_DEPTH, &mut files)?;
        let mut others = Vec::new();
        list(folder, "json", FOLDER_DEPTH, &mut others)?;
        others.sort();
        for path in others.into_iter().filter(|path| !path.ends_with(CATEGORIES)) {
            match Program::of(&path)? {
                Some(Program::Coco) => coco.push(path),
                Some(Program::Labelme) => labelme.push(path),
                None => {}
            }
        }
        files.sort();
        let (drawn, photos) = match (&coco[..], &labelme[..]) {
            ([], []) => return Self::of_pngs(folder, files, views),
            ([], files) => read_labelme(files, folder)?,
            ([file], []) => {
                let masks = parse_coco(&read_bytes(file)?, file)?;
                let photos = masks.photos_beside(file);
                (masks, photos)
            }
            ([one, .., other], _) | ([one], [other, ..]) => {
                let error =
                    IoError::new(one, format!("has masks of all photos, and {} has masks too", other.display()));
                return Err(error.advise("give the one that counts with --masks FILE.json"));
            }
        };
        // Photos often lie beside the file that describes them.
        if let (Some(png), Some(json)) =
            (files.iter().find(|file| !photos.contains(file)), coco.iter().chain(&labelme).next())
        {
            let error =
                IoError::new(json, format!("has masks, and the PNG {} beside it may be one too", png.display()));
            return Err(error.advise("keep masks of one kind in a folder, or give a COCO file itself with --masks"));
        }
        Ok(Self::Drawn(drawn))
    }

    fn of_pngs(folder: &Path, files: Vec<PathBuf>, views: &[View]) -> Result<Self, IoError> {
        if files.is_empty() {
            let error = IoError::new(folder, "has no masks");
            return Err(error.advise(
                "a mask is a PNG named like its photo; masks of objects may also be COCO, labelme, or a PNG per object",
            ));
        }
        let mut index = NameIndex::default();
        let mut twice = None;
        for (i, file) in files.iter().enumerate() {
            let other = index.insert_file(file.strip_prefix(folder).unwrap_or(file), i);
            twice = twice.or(other.map(|other| (i, other)));
        }
        if let Some(objects) = ObjectFiles::of(folder, &files, &index, views)? {
            return Ok(Self::Objects(objects));
        }
        if let Some((i, other)) = twice {
            let error = IoError::new(&files[i], format!("is for the same view as {}", files[other].display()));
            return Err(error.advise("keep one of them"));
        }
        Ok(Self::Ids { files, index })
    }
}

/// Adds the files of a folder with this extension and of up to `depth` levels of subfolders. Links to folders are not
/// followed.
fn list(folder: &Path, extension: &str, depth: usize, files: &mut Vec<PathBuf>) -> Result<(), IoError> {
    let fail = |e: std::io::Error| IoError::os(folder, "cannot read", &e);
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        let entry = entry.map_err(fail)?;
        let path = entry.path();
        if entry.file_type().map_err(fail)?.is_dir() {
            if depth > 0 {
                list(&path, extension, depth - 1, files)?;
            }
        } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension)) {
            files.push(path);
        }
    }
    Ok(())
}
