//! Which mask belongs to a view, by the names of both: one rule for every kind of masks.

use std::collections::BTreeMap;
use std::path::Path;

use crate::View;

/// What is named like a view.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Found {
    /// Nothing.
    Nothing,
    /// The entry with this number.
    One(usize),
    /// Two entries in different folders, of which neither has the view's path.
    Two(usize, usize),
}

/// Numbered entries, found by the names of views.
#[derive(Clone, Debug, Default)]
pub(super) struct NameIndex {
    /// By path without extension, `/` as `_`: the names of views whose file names are equal.
    by_path: BTreeMap<String, usize>,
    /// By file name without extension, for views that are named without their folder.
    by_stem: BTreeMap<String, Vec<usize>>,
}

impl NameIndex {
    /// Adds the entry of a file, by its path within the folder of all entries. Returns the entry that has this name
    /// already; the new one is then not added.
    pub(super) fn insert_file(&mut self, relative: &Path, entry: usize) -> Option<usize> {
        self.insert(&relative.with_extension(""), entry)
    }

    /// Adds the entry of a folder that is named like a photo, with or without its ending.
    pub(super) fn insert_folder(&mut self, relative: &Path, entry: usize) -> Option<usize> {
        self.insert(relative, entry)
    }

    fn insert(&mut self, named: &Path, entry: usize) -> Option<usize> {
        let name = |path: &Path| path.to_string_lossy().replace(['/', '\\'], "_");
        let path = name(named);
        if let Some(&other) = self.by_path.get(&path) {
            return Some(other);
        }
        self.by_path.insert(path, entry);
        self.by_stem.entry(name(Path::new(named.file_name().unwrap_or_default()))).or_default().push(entry);
        None
    }

    /// The entry whose path has the view's name, or that of its photo with its ending (`a.jpg.png`, as COLMAP wants
    /// masks).
    pub(super) fn by_path(&self, view: &View) -> Option<usize> {
        let name = &view.camera.name;
        let whole = || view.image_path.extension().map(|ending| format!("{name}.{}", ending.to_string_lossy()));
        self.by_path.get(name).or_else(|| self.by_path.get(&whole()?)).copied()
    }

    /// The entry whose path, with a folder, is the end of that of the view's photo, without its ending or with it: a part of a data
    /// set may have one camera of a rig, whose views are then not named by their folder.
    fn by_end_of_path(&self, view: &View) -> Option<usize> {
        ends_of_path(&view.image_path).iter().find_map(|end| self.by_path.get(&end.replace('/', "_")).copied())
    }

    /// The entry of a view: by the end of its photo's path with a folder, else by its name, else by its file name if only one folder
    /// has it. A block that has the photos of one folder alone names its views without it, as photos outside of folders are named.
    pub(super) fn find(&self, view: &View) -> Found {
        if let Some(entry) = self.by_end_of_path(view).or_else(|| self.by_path(view)) {
            return Found::One(entry);
        }
        let name = &view.camera.name;
        let photo = view.image_path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        // Views of a rig have the names of their paths: the same photo of another camera is none of theirs.
        let is_alone = view.image_path.file_stem().is_some_and(|stem| stem.to_string_lossy() == *name);
        let by_photo = || self.by_stem.get(&photo).filter(|_| is_alone);
        match self.by_stem.get(name).or_else(by_photo).map(Vec::as_slice) {
            None | Some([]) => Found::Nothing,
            Some([one]) => Found::One(*one),
            Some([first, second, ..]) => Found::Two(*first, *second),
        }
    }
}

/// The ends of a photo's path that have a folder, the longest first, each without the file's ending and with it; `/` between parts.
pub(crate) fn ends_of_path(photo: &Path) -> Vec<String> {
    let parts_of = |path: &Path| path.iter().map(|part| part.to_string_lossy().into_owned()).collect::<Vec<_>>();
    let (bare, whole) = (parts_of(&photo.with_extension("")), parts_of(photo));
    let folders = bare.len().saturating_sub(1);
    (0..folders).flat_map(|skipped| [&bare, &whole].map(|parts| parts[skipped..].join("/"))).collect()
}
