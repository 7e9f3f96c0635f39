//! Writes the files of a data set.

use std::collections::BTreeMap;
use std::fs;
use std::path::Path;

use super::frame::Frame;
use instgs_io::dataset::Split;
use instgs_io::ktx2::{FloatImage, write_ktx2};
use instgs_io::masks::{Mask, write_categories, write_mask};
use instgs_io::picture_png::write_png;
use instgs_io::{IoError, remove_if_there, write_transforms};
use instgs_vk::scene::{Camera, PosedGroup};

/// File that marks a folder as a data set of this command, with the options that made it.
pub(super) const MARK: &str = "synth.json";
/// One in this many views, starting with the first, is a test view.
pub(super) const TEST_EVERY: usize = 8;
/// Folders, with the extension of their files.
const FOLDERS: [(&str, &str); 3] = [("images", "png"), ("masks", "png"), ("depth", "ktx2")];
/// The files of cameras: of all views, and of each split. Written last.
const CAMERAS: [&str; 3] = ["transforms.json", "transforms_train.json", "transforms_test.json"];
/// Prefix of the names of views.
pub(super) const VIEW_PREFIX: &str = "view_";

/// Split that a view belongs to.
pub(super) fn split_of(view: usize) -> Split {
    if view.is_multiple_of(TEST_EVERY) { Split::Test } else { Split::Train }
}

/// Creates the folders and removes the views of an earlier data set. Fails for a folder with any other content.
pub(super) fn prepare(out: &Path) -> Result<(), IoError> {
    let fail = |e: std::io::Error| IoError::new(out, format!("cannot make the folder: {e}"));
    let taken = fs::read_dir(out).is_ok_and(|mut entries| entries.next().is_some());
    if taken && !out.join(MARK).is_file() {
        return Err(IoError::new(out, "is not empty and was not made by this command").advise("choose another folder"));
    }
    // First: with cameras a folder counts as a whole data set.
    CAMERAS.iter().try_for_each(|name| remove_if_there(&out.join(name)))?;
    for (folder, ending) in FOLDERS {
        let folder = out.join(folder);
        fs::create_dir_all(&folder).map_err(fail)?;
        for entry in fs::read_dir(&folder).map_err(fail)? {
            let path = entry.map_err(fail)?.path();
            let name = path.file_name().unwrap_or_default().to_string_lossy().into_owned();
            if name.starts_with(VIEW_PREFIX) && path.extension().is_some_and(|e| e == ending) {
                fs::remove_file(&path).map_err(|e| IoError::new(&path, format!("cannot remove it: {e}")))?;
            }
        }
    }
    Ok(())
}

/// Writes image, mask and depth of one view.
pub(super) fn write_view(out: &Path, camera: &Camera, frame: Frame) -> Result<(), IoError> {
    let (width, height, name) = (camera.width, camera.height, &camera.name);
    write_png(&out.join("images").join(format!("{name}.png")), &frame.colors, (width, height))?;
    write_mask(&out.join("masks").join(format!("{name}.png")), &Mask { width, height, ids: frame.ids })?;
    let depth = FloatImage { width, height, channels: 1, values: frame.depths };
    write_ktx2(&out.join("depth").join(format!("{name}.ktx2")), &depth)
}

/// Writes `transforms.json` with all views, and the pair of files with the split.
pub(super) fn write_cameras(out: &Path, cameras: &[Camera]) -> Result<(), IoError> {
    let views = |wanted: Option<Split>| -> Vec<(&Camera, String)> {
        let of_split = |i: usize| wanted.is_none_or(|split| split_of(i) == split);
        let chosen = cameras.iter().enumerate().filter(|(i, _)| of_split(*i));
        chosen.map(|(_, camera)| (camera, format!("images/{}.png", camera.name))).collect()
    };
    for (file, split) in CAMERAS.into_iter().zip([None, Some(Split::Train), Some(Split::Test)]) {
        write_transforms(&out.join(file), &views(split), Some("points3d.ply"))?;
    }
    Ok(())
}

/// Writes the name of each id to `masks/categories.json`.
pub(super) fn write_names(out: &Path, groups: &[PosedGroup]) -> Result<(), IoError> {
    let mut names = BTreeMap::new();
    for group in groups {
        let name = group.name.clone().unwrap_or_default();
        names.extend(group.instances.iter().map(|i| (i.id, name.clone())));
    }
    write_categories(&out.join("masks").join("categories.json"), &names)
}
