//! Masks of one object each, as SAM and its tools save them: `masks/PHOTO/OBJECT.png` or `masks/OBJECT/PHOTO.png`, black and
//! white.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::error::IoError;
use crate::mask_png::parse_mask;
use crate::{View, read_bytes};

use super::drawn::wrong_size;
use super::ids::{Seen, last_number, number, without_number};
use super::names::{Found, NameIndex};
use super::shape::{Grid, Shape, draw};
use super::{Mask, no_single_mask};

/// Names that say of no object what it is.
const NO_KINDS: [&str; 9] = ["mask", "masks", "object", "obj", "instance", "inst", "segment", "seg", "id"];

/// The files of all photos.
#[derive(Clone, Debug, Default)]
pub(super) struct ObjectFiles {
    /// By photo: ids and files.
    photos: Vec<Vec<(u16, PathBuf)>>,
    index: NameIndex,
    pub(super) categories: BTreeMap<u32, String>,
}

/// A photo's files by the names of their objects.
type Named = Vec<(String, PathBuf)>;

/// A reading of a folder: its photos' names and files.
struct Reading {
    photos: Vec<Named>,
    index: NameIndex,
}

impl Reading {
    /// Groups files by photo; `parts` gives a file's photo and its object.
    fn new(
        folder: &Path,
        files: &[PathBuf],
        parts: fn(&Path) -> Option<(PathBuf, String)>,
        insert: fn(&mut NameIndex, &Path, usize) -> Option<usize>,
    ) -> Self {
        let mut by_photo: BTreeMap<PathBuf, Named> = BTreeMap::new();
        for file in files {
            if let Some((photo, object)) = file.strip_prefix(folder).ok().and_then(parts) {
                by_photo.entry(photo).or_default().push((object, file.clone()));
            }
        }
        let (mut photos, mut index) = (Vec::new(), NameIndex::default());
        for (photo, named) in by_photo {
            match insert(&mut index, &photo, photos.len()) {
                // `a` and `a.jpg` of two objects are one photo.
                Some(same) => {
                    let photo: &mut Named = &mut photos[same];
                    photo.extend(named);
                }
                None => photos.push(named),
            }
        }
        Self { photos, index }
    }

    /// The first file of a view's photo, if it has at least so many.
    fn example(&self, view: &View, least: usize) -> Option<&Path> {
        let (Found::One(photo) | Found::Two(photo, _)) = self.index.find(view) else { return None };
        let files = self.photos.get(photo).filter(|files| files.len() >= least)?;
        files.first().map(|(_, file)| file.as_path())
    }
}

/// A folder that is named like a photo, and a file that is named like an object.
fn photo_first(path: &Path) -> Option<(PathBuf, String)> {
    let folder = path.parent().filter(|folder| !folder.as_os_str().is_empty())?;
    Some((folder.into(), path.file_stem()?.to_string_lossy().into_owned()))
}

/// A folder that is named like an object, and in it a file that is named like a photo.
fn object_first(path: &Path) -> Option<(PathBuf, String)> {
    let mut parts = path.components();
    let object = parts.next()?.as_os_str().to_string_lossy().into_owned();
    let photo = parts.as_path();
    (!photo.as_os_str().is_empty()).then(|| (photo.into(), object))
}

impl ObjectFiles {
    /// The files of a folder that holds a mask for each object and photo; `None` if it holds masks of ids. `plain` are its
    /// files as masks of ids.
    ///
    /// # Errors
    /// Names that match the photos in more than one way, or more objects than ids.
    pub(super) fn of(
        folder: &Path,
        files: &[PathBuf],
        plain: &NameIndex,
        views: &[View],
    ) -> Result<Option<Self>, IoError> {
        let by_photo = Reading::new(folder, files, photo_first, NameIndex::insert_folder);
        let by_object = Reading::new(folder, files, object_first, NameIndex::insert_file);
        let as_ids =
            views.iter().find_map(|view| Some((view, plain.by_path(view).and_then(|i| files.get(i))?.as_path())));
        let photo_named = views.iter().find_map(|view| Some((view, by_photo.example(view, 1)?)));
        // A photo of one mask is found as one of ids, too.
        let object_named = views.iter().find_map(|view| Some((view, by_object.example(view, 2)?)));
        let ambiguous = |(view, one): (&View, &Path), (_, other): (&View, &Path)| {
            let name = &view.camera.name;
            let what = format!("may be a mask of the photo {name}, and {} of another kind too", other.display());
            let error = IoError::new(one, what);
            Err(error.advise(
                "masks are NAME.png, NAME/OBJECT.png or OBJECT/NAME.png: keep one kind, with names that differ",
            ))
        };
        let chosen = match (as_ids, photo_named, object_named) {
            (Some(one), Some(other), _) => return ambiguous(one, other),
            (None, Some(one), Some(other)) => return ambiguous(one, other),
            (None, Some(_), None) => by_photo,
            (None, None, Some(_)) => by_object,
            (_, None, _) => return Ok(None),
        };
        let seen = |(object, _): &(String, PathBuf)| {
            let kind = without_number(object);
            let is_kind = !kind.is_empty() && !NO_KINDS.iter().any(|no| kind.eq_ignore_ascii_case(no));
            Seen { object: Some(object.clone()), category: is_kind.then(|| kind.to_owned()) }
        };
        let seen: Vec<Vec<Seen>> = chosen.photos.iter().map(|named| named.iter().map(seen).collect()).collect();
        let numbered = number(&seen, last_number)
            .map_err(|what| IoError::new(folder, what).advise("leave only the masks of repeated objects there"))?;
        let with_ids = |(named, ids): (Named, Vec<u16>)| ids.into_iter().zip(named.into_iter().map(|n| n.1)).collect();
        let photos = chosen.photos.into_iter().zip(numbered.ids).map(with_ids).collect();
        Ok(Some(Self { photos, index: chosen.index, categories: numbered.categories }))
    }

    /// One of the files.
    pub(super) fn any_file(&self) -> Option<&Path> {
        self.photos.iter().flatten().next().map(|(_, file)| file.as_path())
    }

    /// The files of a view's photo.
    ///
    /// # Errors
    /// Two photos may be it.
    pub(super) fn files_of(&self, view: &View) -> Result<Option<&[(u16, PathBuf)]>, IoError> {
        match self.index.find(view) {
            Found::Nothing => Ok(None),
            Found::One(i) => Ok(self.photos.get(i).map(Vec::as_slice)),
            Found::Two(i, j) => {
                let first =
                    |photo: usize| self.photos.get(photo).and_then(|files| files.first()).map(|f| f.1.as_path());
                let (one, other) = (first(i).unwrap_or(Path::new("")), first(j).unwrap_or(Path::new("")));
                Err(no_single_mask(view, one, other))
            }
        }
    }
}

/// The mask of a photo from the files of its objects.
///
/// # Errors
/// A file is damaged, has more than one id, or has another size than the photo.
pub(super) fn draw_files(files: &[(u16, PathBuf)], view_size: (u32, u32)) -> Result<Mask, IoError> {
    let mut objects = Vec::with_capacity(files.len());
    let mut common: Option<Grid> = None;
    for (id, path) in files {
        let mask = parse_mask(&read_bytes(path)?, path)?;
        let size = (mask.width, mask.height);
        let grid = Grid::new(size, view_size).ok_or_else(|| wrong_size(path, size, view_size))?;
        if *common.get_or_insert(grid) != grid {
            let error =
                IoError::new(path, format!("has {}x{} pixels, and its photo's other masks have not", size.0, size.1));
            return Err(error.advise("save all masks of a photo at one size"));
        }
        if mask.ids_present().len() > 1 {
            let error = IoError::new(path, "has several ids, where the mask of one object is black and white");
            return Err(
                error.advise("save it without soft edges; of masks of ids give the folder that has one per photo")
            );
        }
        objects.push((*id, Shape::of_mask(&mask, (0, 0))));
    }
    let none =
        || Mask { width: view_size.0, height: view_size.1, ids: vec![0; view_size.0 as usize * view_size.1 as usize] };
    Ok(common.map_or_else(none, |grid| draw(objects.iter().map(|(id, shape)| (*id, shape)), grid)))
}
