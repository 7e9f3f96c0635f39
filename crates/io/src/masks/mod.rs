//! Instance masks: one image per view whose pixels are object ids, and the categories of those ids.
//!
//! [`MaskFolder`] is the one way to a data set's masks, whatever form they have: one PNG of ids per photo, one black and white
//! PNG per object and photo, a COCO file, or labelme's files. `docs/masks.md` is its description for users.

pub mod coco;
pub mod drawn;
mod ids;
pub mod labelme;
pub(crate) mod names;
mod object_files;
mod polygon;
mod runs;
mod shape;
mod sources;
#[cfg(test)]
mod tests;

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::camera_file::parse_json;
use crate::error::{IoError, Place};
use crate::json::write_json;
use crate::mask_png::{mask_bytes, parse_mask, parse_named_mask};
use crate::{View, atomic_write, read_bytes, view_resample};
use drawn::wrong_size;
use instgs_vk::math::distortion::Distortion;
use names::Found;
use object_files::draw_files;
use shape::Grid;
use sources::Source;

/// Name of the file beside the masks that maps ids to categories.
pub const CATEGORIES: &str = "categories.json";
/// The object that each pixel shows.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Mask {
    /// Width of the image, pixels.
    pub width: u32,
    /// Height of the image, pixels.
    pub height: u32,
    /// `width * height` object ids, row by row from the top; 0 = none.
    pub ids: Vec<u16>,
}

impl Mask {
    /// The mask at another size, nearest neighbour: each pixel takes the id at its centre, so that no new ids arise.
    pub fn resized(&self, width: u32, height: u32) -> Self {
        if self.ids.is_empty() {
            return Self { width, height, ids: vec![0; width as usize * height as usize] };
        }
        // The position of the centre, (i + 1/2) / new * old, rounded down, in integers.
        let places = |new: u32, old: u32| {
            (0..u64::from(new)).map(move |i| ((2 * i + 1) * u64::from(old) / (2 * u64::from(new))) as usize)
        };
        let columns: Vec<usize> = places(width, self.width).collect();
        let row = |j: usize| &self.ids[j * self.width as usize..][..self.width as usize];
        let ids = places(height, self.height).flat_map(|j| columns.iter().map(move |&i| row(j)[i])).collect();
        Self { width, height, ids }
    }

    /// Distorts a mask that was made for the view's pinhole camera, so that it matches the view's photo with its lens
    /// distortion: the form that [`MaskFolder::of_view`] reads.
    pub fn as_photographed(self, view: &View) -> Self {
        match &view.distortion {
            Some(distortion) => view_resample::distort_ids(&self, &view.camera, distortion),
            None => self,
        }
    }

    /// The ids that occur, except 0, with their number of pixels.
    pub fn ids_present(&self) -> BTreeMap<u16, u64> {
        let mut pixels = BTreeMap::new();
        for run in self.ids.chunk_by(|a, b| a == b).filter(|run| run[0] != 0) {
            *pixels.entry(run[0]).or_default() += run.len() as u64;
        }
        pixels
    }
}

/// Reads a mask: a PNG of grey, whose levels are the ids. With a palette the id is the index of the colour, as segmentation
/// tools write it, unless all colours are greys: then it is the grey level, because programs that optimise PNGs turn a
/// greyscale image into such a palette. In a picture in colour every colour but black is an object (unless all are greys);
/// ids then differ from mask to mask. What is fully transparent beside an alpha channel is no object.
///
/// # Errors
/// The file is missing, not a PNG, damaged, in colours of 16 bits, or has as many colours as a photo.
pub fn read_mask(path: &Path) -> Result<Mask, IoError> {
    parse_mask(&read_bytes(path)?, path)
}

/// Writes a mask as PNG with 16 bits of grey.
///
/// # Errors
/// The mask has no pixels, the number of ids does not match, or the file cannot be written.
pub fn write_mask(path: &Path, mask: &Mask) -> Result<(), IoError> {
    let bytes = mask_bytes(mask, path)?;
    atomic_write(path, |out| out.write_all(&bytes))
}

/// Reads a `categories.json`: an object that maps ids to names. An entry for 0, which is no object, is ignored.
pub fn read_categories(path: &Path) -> Result<BTreeMap<u32, String>, IoError> {
    let serde_json::Value::Object(entries) = parse_json(&read_bytes(path)?, path)? else {
        return Err(IoError::new(path, "is not a JSON object that maps ids to names")
            .advise("for instance {\"1\": \"car\", \"2\": \"car\"}"));
    };
    let mut categories = BTreeMap::new();
    for (key, value) in entries {
        let fail = |what: &str| IoError::new(path, what).at(Place::Field(format!("{key:?}")));
        let id: u16 = key.parse().map_err(|_| fail("is not a mask id, 1 to 65535"))?;
        let name = value.as_str().ok_or_else(|| fail("its name is not a string"))?;
        if categories.insert(u32::from(id), name.to_owned()).is_some() {
            return Err(fail("appears twice"));
        }
    }
    categories.remove(&0);
    Ok(categories)
}

/// Writes a `categories.json`, which maps ids to names.
pub fn write_categories(path: &Path, categories: &BTreeMap<u32, String>) -> Result<(), IoError> {
    if let Some(id) = categories.keys().find(|id| !(1..=u32::from(u16::MAX)).contains(*id)) {
        return Err(IoError::new(path, format!("cannot write: {id} is not a mask id, 1 to 65535")));
    }
    write_json(path, categories)
}

/// The masks of a dataset: of a folder, or of one file of another program.
#[derive(Clone, Debug)]
pub struct MaskFolder {
    /// The folder or the file.
    path: PathBuf,
    /// Names of the ids, from `categories.json` or from what another program calls objects; may be empty.
    pub categories: BTreeMap<u32, String>,
    /// What was ignored, or follows from what the files lack: one line each for the user.
    pub notes: Vec<String>,
    source: Source,
}

impl MaskFolder {
    /// Opens masks: a folder with one PNG of ids per photo, or one black and white PNG per object and photo
    /// (`PHOTO/OBJECT.png`, `OBJECT/PHOTO.png`), or labelme's JSON per photo, or a COCO file; or a COCO file itself. Which
    /// of them it is follows from the files and from the names of `views`, of which any that are at hand may be given.
    ///
    /// # Errors
    /// The folder does not exist or has no masks; it has masks of two kinds, or names that match the photos in two ways;
    /// two files have one name (`a.png` and `a.PNG`); or the categories or the file of another program are damaged.
    pub fn open(path: &Path, views: &[View]) -> Result<Self, IoError> {
        let names = path.join(CATEGORIES);
        let given = if names.is_file() { read_categories(&names)? } else { BTreeMap::new() };
        let source = Source::open(path, views)?;
        let (named, notes) = match &source {
            Source::Ids { .. } => (BTreeMap::new(), Vec::new()),
            Source::Objects(files) => (files.categories.clone(), Vec::new()),
            Source::Drawn(masks) => (masks.categories.clone(), masks.notes.clone()),
        };
        Ok(Self { path: path.into(), categories: if given.is_empty() { named } else { given }, notes, source })
    }

    /// The default folder of a dataset's masks: `masks` in its folder, if it exists.
    pub fn default_for(data: &Path) -> Option<PathBuf> {
        Some(data.join("masks")).filter(|folder| folder.is_dir())
    }

    /// The mask of a view, undistorted to its pinhole camera: masks are aligned with the image, so lens distortion is
    /// removed in the same way. A mask that is larger than the image by a whole factor is reduced. `None` if the view has no
    /// mask.
    ///
    /// # Errors
    /// The mask is damaged or has another size than the image; or two subfolders have a file of the view's name, and
    /// neither matches its path.
    pub fn of_view(&self, view: &View) -> Result<Option<Mask>, IoError> {
        let camera = &view.camera;
        let size = (camera.width, camera.height);
        let mask = match &self.source {
            Source::Ids { .. } => match self.id_file(view)? {
                Some(path) => self.id_mask(path, size)?,
                None => return Ok(None),
            },
            Source::Objects(files) => match files.files_of(view)? {
                Some(files) => draw_files(files, size)?,
                None => return Ok(None),
            },
            Source::Drawn(masks) => match masks.photo_of(view)? {
                Some(photo) => photo.draw(size)?,
                None => return Ok(None),
            },
        };
        let undistorted = |d: &Distortion| view_resample::undistort_ids(&mask, camera, d);
        Ok(Some(view.distortion.as_ref().map(undistorted).unwrap_or(mask)))
    }

    /// A PNG of ids at the size of its view's photo.
    fn id_mask(&self, path: &Path, (width, height): (u32, u32)) -> Result<Mask, IoError> {
        let parse = if self.categories.is_empty() { parse_mask } else { parse_named_mask };
        let mask = parse(&read_bytes(path)?, path)?;
        let size = (mask.width, mask.height);
        if size == (width, height) {
            return Ok(mask);
        }
        Grid::new(size, (width, height)).ok_or_else(|| wrong_size(path, size, (width, height)))?;
        Ok(mask.resized(width, height))
    }

    /// The file of a view's mask of pixels or ids. It is not read.
    ///
    /// # Errors
    /// Two subfolders have a file of that name, as for [`Self::of_view`]; or the masks are not one PNG per photo.
    pub fn file_of(&self, view: &View) -> Result<Option<&Path>, IoError> {
        match &self.source {
            Source::Ids { .. } => self.id_file(view),
            Source::Objects(_) | Source::Drawn(_) => {
                let error = IoError::new(&self.path, "holds masks of objects, which do not say which pixels count");
                Err(error.advise("a mask of pixels is one PNG per photo, black where pixels do not count"))
            }
        }
    }

    /// True if there is a mask for the view. No file is read.
    ///
    /// # Errors
    /// Two subfolders have a file of that name, as for [`Self::of_view`].
    pub fn has_view(&self, view: &View) -> Result<bool, IoError> {
        Ok(match &self.source {
            Source::Ids { .. } => self.id_file(view)?.is_some(),
            Source::Objects(files) => files.files_of(view)?.is_some(),
            Source::Drawn(masks) => masks.photo_of(view)?.is_some(),
        })
    }

    /// The PNG of ids that is named like a view.
    fn id_file(&self, view: &View) -> Result<Option<&Path>, IoError> {
        let Source::Ids { files, index } = &self.source else { return Ok(None) };
        match index.find(view) {
            Found::Nothing => Ok(None),
            Found::One(i) => Ok(files.get(i).map(PathBuf::as_path)),
            Found::Two(i, j) => Err(no_single_mask(view, &files[i], &files[j])),
        }
    }

    /// A file with masks, to be named in a message.
    pub fn any_file(&self) -> Option<&Path> {
        match &self.source {
            Source::Ids { files, .. } => files.first().map(PathBuf::as_path),
            Source::Objects(files) => files.any_file(),
            Source::Drawn(masks) => masks.photos.first().map(|photo| photo.file.as_path()),
        }
    }
}

/// The error for two files that may be the mask of a view.
fn no_single_mask(view: &View, one: &Path, other: &Path) -> IoError {
    let what = format!("may be the mask of the view {}, and so may {}", view.camera.name, other.display());
    IoError::new(one, what).advise("keep one of them, or name the folder that holds only one kind")
}
