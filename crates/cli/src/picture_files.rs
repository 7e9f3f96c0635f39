//! Writes pictures to files, 8-bit PNG or float KTX2, and chooses their names.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use clap::ValueEnum;

use instgs_console::CliError;
use instgs_io::ktx2::{FloatImage, write_ktx2};
use instgs_io::picture_png::write_png;
use instgs_io::{IoError, MaskFolder, read_views};
use instgs_vk::render::Picture;
use instgs_vk::scene::Camera;

/// File format of the colour pictures.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(super) enum Format {
    /// 8 bits per channel, sRGB
    Png,
    /// 32-bit float sRGB over the background, alpha = 1 - transmittance
    Ktx2,
}

/// File extensions of images that a view's name may still end in.
const IMAGE_ENDINGS: [&str; 8] = ["png", "jpg", "jpeg", "tif", "tiff", "bmp", "webp", "exr"];

/// Writes `folder/name.png` or `.ktx2`, and with `depth` also `name.depth.ktx2`; returns the names of the files.
pub(super) fn write(
    folder: &Path,
    name: &str,
    picture: &Picture,
    format: Format,
    depth: bool,
) -> Result<Vec<String>, CliError> {
    let mut files = Vec::new();
    let float = |channels, values| FloatImage { width: picture.width, height: picture.height, channels, values };
    match format {
        Format::Png => {
            files.push(format!("{name}.png"));
            write_png(&folder.join(&files[0]), &picture.rgb8(), (picture.width, picture.height))?;
        }
        Format::Ktx2 => {
            files.push(format!("{name}.ktx2"));
            write_ktx2(&folder.join(&files[0]), &float(4, picture.colors.as_flattened().to_vec()))?;
        }
    }
    if depth {
        files.push(format!("{name}.depth.ktx2"));
        write_ktx2(&folder.join(&files[1]), &float(1, picture.depths.clone()))?;
    }
    Ok(files)
}

/// The file name for each camera: its name without an image's extension, with folders joined by `_`, or its index if it
/// has no name. Cameras that would share a name keep the extension: `d.png` and `d.jpg` are two photos. Two cameras with the same
/// file name all the same are an error.
pub(super) fn names(cameras: &[Camera]) -> Result<Vec<String>, CliError> {
    let mut uses = BTreeMap::new();
    for (i, camera) in cameras.iter().enumerate() {
        *uses.entry(file_name(stem(&camera.name), i)).or_insert(0) += 1;
    }
    let mut taken = BTreeMap::new();
    let mut names = Vec::with_capacity(cameras.len());
    for (i, camera) in cameras.iter().enumerate() {
        let short = file_name(stem(&camera.name), i);
        let name = if uses[&short] > 1 { file_name(&camera.name, i) } else { short };
        // Depth is written to NAME.depth.ktx2, which must not be the colour file of another camera.
        let depth_clash = taken.insert(format!("{name}.depth"), i).filter(|&first| first != i);
        if let Some(first) = taken.insert(name.clone(), i).or(depth_clash) {
            let what = format!("cameras {first} and {i} would both be written to {name}: give them different names");
            return Err(CliError::msg(what));
        }
        names.push(name);
    }
    Ok(names)
}

/// Fails if one of the files `NAME.png` in `folder` is a photo or a mask of the data set, or one of the masks `more`: pictures have
/// the names of their views.
pub(super) fn check_not_of_data<'a>(
    folder: &Path,
    names: &[String],
    data: &Path,
    more: impl Iterator<Item = &'a Path>,
) -> Result<(), CliError> {
    let canonical = |path: &Path| path.canonicalize().ok();
    let mut inputs: BTreeSet<PathBuf> = more.filter_map(canonical).collect();
    for view in read_views(data)?.views {
        inputs
            .extend([Some(view.image_path), view.mask_path].into_iter().flatten().filter_map(|path| canonical(&path)));
    }
    let masks = MaskFolder::default_for(data).and_then(|masks| canonical(&masks));
    // Masks of objects have their names in this file, wherever they are.
    let is_of_masks = folder.join("categories.json").is_file();
    for file in names.iter().map(|name| folder.join(format!("{name}.png"))) {
        let Some(path) = canonical(&file) else { continue };
        let is_mask = is_of_masks || masks.as_ref().is_some_and(|masks| path.starts_with(masks));
        if is_mask || inputs.contains(&path) {
            let error = IoError::new(&file, format!("is a photo or a mask of the data set {}", data.display()));
            return Err(error.advise("choose another folder by --out").into());
        }
    }
    Ok(())
}

/// A view's name without the extension of an image.
fn stem(name: &str) -> &str {
    let ending = Path::new(name).extension().map(|e| e.to_string_lossy().to_ascii_lowercase());
    match ending {
        Some(ending) if IMAGE_ENDINGS.contains(&ending.as_str()) => &name[..name.len() - ending.len() - 1],
        _ => name,
    }
}

/// A name that every file system takes.
fn file_name(name: &str, index: usize) -> String {
    let safe: String =
        name.chars().map(|c| if c.is_control() || "/\\:*?\"<>|".contains(c) { '_' } else { c }).collect();
    if safe.is_empty() { format!("{index:03}") } else { safe }
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    #[test]
    fn names_lose_image_endings_and_folders_only() {
        let name = |n: &str| file_name(stem(n), 7);
        assert_eq!(name("a.JPG"), "a");
        assert_eq!(name("left/0001.png"), "left_0001");
        assert_eq!(name("../x"), ".._x");
        assert_eq!(name("v1.5"), "v1.5");
        assert_eq!([name(""), name("é.png")], ["007", "é"]);
        let camera = |n: &str| Camera::look_at(n, DVec3::ZERO, DVec3::Z, DVec3::NEG_Y, 1.0, (4, 4));
        assert!(names(&[camera("a"), camera("b")]).is_ok());
        assert!(names(&[camera("a.depth"), camera("a")]).is_err());
        assert!(names(&[camera("a"), camera("a.depth")]).is_err());
        assert!(names(&[camera("a.png"), camera("a.png")]).is_err_and(|e| e.to_string().contains("cameras 0 and 1")));
    }

    /// Two photos may differ in their extension alone; others are named as before.
    #[test]
    fn what_would_be_one_file_keeps_its_extension() -> Result<(), CliError> {
        let camera = |n: &&str| Camera::look_at(n, DVec3::ZERO, DVec3::Z, DVec3::NEG_Y, 1.0, (4, 4));
        let of = |all: &[&str]| names(&all.iter().map(camera).collect::<Vec<_>>());
        assert_eq!(of(&["d.png", "e.png", "d.jpg"])?, ["d.png", "e", "d.jpg"]);
        assert_eq!(of(&["d", "d.jpg", "x/d.jpg"])?, ["d", "d.jpg", "x_d"]);
        assert!(of(&["d.png", "d.jpg", "d.png"]).is_err() && of(&["x/d.png", "x_d.png"]).is_err());
        // The long name of one is the short name of another.
        assert!(of(&["d.png", "d.jpg", "d.png.jpg"]).is_err());
        Ok(())
    }
}
