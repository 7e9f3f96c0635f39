//! Masks that a file of another program draws: polygons and runs, by photo.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use instgs_vk::scene::camera::MAX_IMAGE_SIDE;

use crate::View;
use crate::error::{IoError, Place};

use super::Mask;
use super::names::{Found, NameIndex};
use super::shape::{Grid, Shape, draw};

/// The objects of a photo as a file has them.
#[derive(Clone, Debug)]
pub(super) struct DrawnPhoto {
    /// The file that has them.
    pub(super) file: PathBuf,
    /// The photo's path there.
    pub(super) given: PathBuf,
    /// The photo's path within the folder that all have in common.
    pub(super) name: PathBuf,
    /// Width and height that the shapes were drawn for, pixels; `None` if the file does not say it.
    pub(super) size: Option<(u32, u32)>,
    /// Ids and shapes.
    pub(super) objects: Vec<(u16, Shape)>,
}

/// The objects of all photos, drawn when they are asked for.
#[derive(Clone, Debug, Default)]
pub struct DrawnMasks {
    pub(super) photos: Vec<DrawnPhoto>,
    index: NameIndex,
    pub(super) categories: BTreeMap<u32, String>,
    /// What was ignored or follows from what the files lack, one line each.
    pub(super) notes: Vec<String>,
}

impl DrawnMasks {
    /// Photos by their paths within a folder, which are their names without the extension.
    ///
    /// # Errors
    /// Two photos of one name.
    pub(super) fn new(
        photos: Vec<DrawnPhoto>,
        categories: BTreeMap<u32, String>,
        notes: Vec<String>,
    ) -> Result<Self, IoError> {
        let mut index = NameIndex::default();
        for (i, photo) in photos.iter().enumerate() {
            if let Some(other) = index.insert_file(&photo.name, i) {
                let what = format!("is for the same view as {}", photos[other].name.display());
                let error = IoError::new(&photo.file, what).at(photo.place());
                return Err(error.advise("keep one of them"));
            }
        }
        // A file may have the photos of one folder alone, by paths that begin with it.
        for (i, photo) in photos.iter().enumerate().filter(|(_, photo)| photo.given != photo.name) {
            index.insert_file(&photo.given, i);
        }
        Ok(Self { photos, index, categories, notes })
    }

    /// The photos that would lie beside a file that names them.
    pub(super) fn photos_beside(&self, file: &Path) -> Vec<PathBuf> {
        let folder = file.parent().unwrap_or(file);
        self.photos.iter().map(|photo| folder.join(&photo.given)).collect()
    }

    /// The photo of a view.
    ///
    /// # Errors
    /// Two photos may be it.
    pub(super) fn photo_of(&self, view: &View) -> Result<Option<&DrawnPhoto>, IoError> {
        match self.index.find(view) {
            Found::Nothing => Ok(None),
            Found::One(i) => Ok(self.photos.get(i)),
            Found::Two(i, j) => {
                let (name, other) = (&view.camera.name, self.photos[j].name.display());
                let what = format!("may be the photo of the view {name}, and so may {other}");
                let error = IoError::new(&self.photos[i].file, what).at(self.photos[i].place());
                Err(error.advise("name photos there by their paths, as the cameras do"))
            }
        }
    }

    /// Draws the mask of every photo at its own size, or `most` pixels squared if that is smaller or unknown: for tests
    /// of damaged files.
    ///
    /// # Errors
    /// The same errors as for a view of that size.
    pub fn draw_all(&self, most: u32) -> Result<Vec<Mask>, IoError> {
        let small = |size: &(u32, u32)| size.0 <= most && size.1 <= most;
        self.photos.iter().map(|photo| photo.draw(photo.size.filter(small).unwrap_or((most, most)))).collect()
    }
}

impl DrawnPhoto {
    fn place(&self) -> Place {
        let name = self.name.to_string_lossy();
        if self.file.ends_with(&self.name) { Place::File } else { Place::Field(format!("photo {:?}", name)) }
    }

    /// The mask at the size of the view's photo.
    ///
    /// # Errors
    /// The photo has another size than the shapes were drawn for.
    pub(super) fn draw(&self, view_size: (u32, u32)) -> Result<Mask, IoError> {
        let size = self.size.unwrap_or(view_size);
        if size.0.max(size.1) > MAX_IMAGE_SIDE {
            let what = format!("has {}x{} pixels, and no photo has a side above {MAX_IMAGE_SIDE}", size.0, size.1);
            let error = IoError::new(&self.file, what).at(self.place());
            return Err(error.advise("draw the masks on the photos that are trained on"));
        }
        let grid =
            Grid::new(size, view_size).ok_or_else(|| wrong_size(&self.file, size, view_size).at(self.place()))?;
        let other = self.objects.iter().find_map(|(_, shape)| match shape {
            Shape::Runs(runs) if runs.size() != size => Some(runs.size()),
            _ => None,
        });
        if let Some((width, height)) = other {
            let what = format!("has runs of {width}x{height} pixels, and its photo has {}x{}", size.0, size.1);
            let error = IoError::new(&self.file, what).at(self.place());
            return Err(error.advise("the size of runs is [height, width], that of the image"));
        }
        Ok(draw(self.objects.iter().map(|(id, shape)| (*id, shape)), grid))
    }
}

/// The error for masks whose size is not that of their view's photo.
pub(super) fn wrong_size(path: &Path, size: (u32, u32), want: (u32, u32)) -> IoError {
    let what = format!("the mask has {}x{} pixels, and its view {}x{}", size.0, size.1, want.0, want.1);
    IoError::new(path, what).advise("use the masks of the view's photo, at its size or a whole multiple of it")
}
