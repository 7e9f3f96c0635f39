//! Instance masks: one image per view whose pixels are object ids, and the categories of those ids.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::camera_file::parse_json;
use crate::error::{IoError, Place};
use crate::json::write_json;
use crate::mask_png::{mask_bytes, parse_mask, parse_named_mask};
use crate::{View, atomic_write, read_bytes, view_resample};
use instgs_vk::math::distortion::Distortion;

/// Name of the file beside the masks that maps ids to categories.
pub const CATEGORIES: &str = "categories.json";
/// Depth to which subfolders of the masks' folder are searched: `left/8bit/a.png` is found, but a folder that contains
/// a whole dataset is not searched completely.
const FOLDER_DEPTH: usize = 3;

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
        return Err(IoError::new(path, "is not a JSON object that maps ids to names"));
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

/// The masks of a dataset.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct MaskFolder {
    folder: PathBuf,
    /// Names of the ids, from `categories.json`; empty without that file.
    pub categories: BTreeMap<u32, String>,
    /// Masks by their path within the folder without extension, `/` as `_`: the names of views whose file names are
    /// equal.
    by_path: BTreeMap<String, PathBuf>,
    /// Masks by file name without extension, for views that are named without their folder.
    by_stem: BTreeMap<String, Vec<PathBuf>>,
}

impl MaskFolder {
    /// Lists the PNGs of a folder and its subfolders and reads its categories.
    ///
    /// # Errors
    /// The folder does not exist or has no PNG, two files have one name (`a.png` and `a.PNG`), or the categories are
    /// damaged.
    pub fn open(folder: &Path) -> Result<Self, IoError> {
        let categories = folder.join(CATEGORIES);
        let categories = if categories.is_file() { read_categories(&categories)? } else { BTreeMap::new() };
        let mut files = Vec::new();
        list_pngs(folder, FOLDER_DEPTH, &mut files)?;
        if files.is_empty() {
            let error = IoError::new(folder, "has no masks");
            return Err(error.advise("a mask is a PNG of instance ids named like its view's image"));
        }
        files.sort();
        let mut out = Self { folder: folder.into(), categories, by_path: BTreeMap::new(), by_stem: BTreeMap::new() };
        for file in files {
            let name = |path: &Path| path.with_extension("").to_string_lossy().replace(['/', '\\'], "_");
            let stem = name(Path::new(file.file_name().unwrap_or_default()));
            out.by_stem.entry(stem).or_default().push(file.clone());
            let path = name(file.strip_prefix(folder).unwrap_or(&file));
            if let Some(other) = out.by_path.insert(path, file.clone()) {
                return Err(IoError::new(&file, format!("is for the same view as {}", other.display())));
            }
        }
        Ok(out)
    }

    /// The default folder of a dataset's masks: `masks` in its folder, if it exists.
    pub fn default_for(data: &Path) -> Option<PathBuf> {
        Some(data.join("masks")).filter(|folder| folder.is_dir())
    }

    /// The mask of a view, undistorted to its pinhole camera: masks are aligned with the image, so lens distortion is
    /// removed in the same way. `None` if the view has no mask.
    ///
    /// # Errors
    /// The mask is damaged or has another size than the image; or two subfolders have a file of the view's name, and
    /// neither matches its path.
    pub fn of_view(&self, view: &View) -> Result<Option<Mask>, IoError> {
        let camera = &view.camera;
        let Some(path) = self.path_of(view)? else { return Ok(None) };
        let parse = if self.categories.is_empty() { parse_mask } else { parse_named_mask };
        let mask = parse(&read_bytes(path)?, path)?;
        let (size, want) = ((mask.width, mask.height), (camera.width, camera.height));
        if size != want {
            let what = format!("the mask has {}x{} pixels, and its view {}x{}", size.0, size.1, want.0, want.1);
            return Err(IoError::new(path, what).advise("use the masks that were made from the view's image"));
        }
        let undistorted = |d: &Distortion| view_resample::undistort_ids(&mask, camera, d);
        Ok(Some(view.distortion.as_ref().map(undistorted).unwrap_or(mask)))
    }

    /// The file of a view's mask. It is not read.
    ///
    /// # Errors
    /// Two subfolders have a file of that name, as for [`Self::of_view`].
    pub fn file_of(&self, view: &View) -> Result<Option<&Path>, IoError> {
        self.path_of(view)
    }

    /// True if there is a mask for the view. No file is read.
    ///
    /// # Errors
    /// Two subfolders have a file of that name, as for [`Self::of_view`].
    pub fn has_view(&self, view: &View) -> Result<bool, IoError> {
        Ok(self.path_of(view)?.is_some())
    }

    /// The mask of a view: named as the view is, or as its photo with its ending (`a.jpg.png`, as COLMAP wants masks).
    fn path_of(&self, view: &View) -> Result<Option<&Path>, IoError> {
        let name = &view.camera.name;
        if let Some(path) = self.by_path.get(name) {
            return Ok(Some(path));
        }
        let photo = view.image_path.file_name().map(|name| name.to_string_lossy().into_owned()).unwrap_or_default();
        let whole = view.image_path.extension().map(|ending| format!("{name}.{}", ending.to_string_lossy()));
        if let Some(path) = whole.as_ref().and_then(|whole| self.by_path.get(whole)) {
            return Ok(Some(path));
        }
        // Views of a rig have the names of their paths: the same photo of another camera is none of theirs.
        let is_alone = view.image_path.file_stem().is_some_and(|stem| stem.to_string_lossy() == *name);
        let by_photo = || self.by_stem.get(&photo).filter(|_| is_alone);
        match self.by_stem.get(name).or_else(by_photo).map(Vec::as_slice) {
            None | Some([]) => Ok(None),
            Some([one]) => Ok(Some(one)),
            Some([first, second, ..]) => {
                let what = format!("may be the mask of the view {name}, and so may {}", second.display());
                Err(IoError::new(first, what).advise("keep one of them, or name the folder that holds only one kind"))
            }
        }
    }

    /// One of the masks, to be named in a message.
    pub fn any_file(&self) -> Option<&Path> {
        self.by_path.values().next().map(PathBuf::as_path)
    }
}

/// Adds the PNGs of a folder and of up to `depth` levels of subfolders. Links to folders are not followed.
fn list_pngs(folder: &Path, depth: usize, files: &mut Vec<PathBuf>) -> Result<(), IoError> {
    let fail = |e: std::io::Error| IoError::os(folder, "cannot read", &e);
    for entry in std::fs::read_dir(folder).map_err(fail)? {
        let entry = entry.map_err(fail)?;
        let path = entry.path();
        if entry.file_type().map_err(fail)?.is_dir() {
            if depth > 0 {
                list_pngs(&path, depth - 1, files)?;
            }
        } else if path.extension().is_some_and(|e| e.eq_ignore_ascii_case("png")) {
            files.push(path);
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Split;
    use instgs_vk::scene::Camera;

    type Outcome = Result<(), Box<dyn std::error::Error>>;

    /// A view of `width` pixels in one row.
    fn view(name: &str, width: u32) -> View {
        let view_from_world = [[1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0]];
        let (cx, cy) = (0.5 * f64::from(width), 0.5);
        let camera = Camera { name: name.into(), width, height: 1, fx: 1.0, fy: 1.0, cx, cy, view_from_world };
        View { camera, image_path: PathBuf::new(), split: Split::Train, distortion: None, mask_path: None }
    }

    fn mask() -> Mask {
        Mask { width: 3, height: 2, ids: vec![0, 1, 65535, 256, 0, 1] }
    }

    #[test]
    fn resizing_takes_the_pixel_at_the_centre() {
        let double = mask().resized(6, 4);
        assert_eq!(double.ids[..6], [0, 0, 1, 1, 65535, 65535]);
        assert_eq!((double.ids.len(), double.ids[12], double.ids[23]), (24, 256, 1));
        assert_eq!(double.resized(3, 2), mask());
        // Centres of one pixel over three (1.5), and of two over three (0.75 and 2.25).
        assert_eq!(mask().resized(1, 1).ids, [0]);
        assert_eq!(mask().resized(2, 1).ids, [256, 1]);
        assert_eq!(mask().resized(0, 5).ids, [0u16; 0]);
        assert_eq!(Mask::default().resized(2, 1).ids, [0, 0]);
    }

    #[test]
    fn ids_are_counted_without_zero() {
        assert_eq!(mask().ids_present(), BTreeMap::from([(1, 2), (256, 1), (65535, 1)]));
    }

    #[test]
    fn views_find_their_masks() -> Outcome {
        let folder = tempfile::tempdir()?;
        let root = folder.path().join("masks");
        assert_eq!(MaskFolder::default_for(folder.path()), None);
        std::fs::create_dir_all(root.join("left"))?;
        std::fs::create_dir_all(root.join("right"))?;
        assert_eq!(MaskFolder::default_for(folder.path()), Some(root.clone()));
        assert!(MaskFolder::open(&root).is_err_and(|e| e.to_string().contains("has no masks")));
        let of = |id: u16| Mask { width: 1, height: 1, ids: vec![id] };
        for (id, name) in [(1, "a.b.PNG"), (2, "left/1.png"), (3, "right/1.png"), (4, "right/2.png")] {
            write_mask(&root.join(name), &of(id))?;
        }
        std::fs::write(root.join("notes.txt"), "not a mask")?;
        let masks = MaskFolder::open(&root)?;
        assert!(masks.categories.is_empty());
        for (id, name) in [(1, "a.b"), (2, "left_1"), (3, "right_1"), (4, "2"), (4, "right_2")] {
            assert_eq!(masks.of_view(&view(name, 1))?, Some(of(id)), "{name}");
        }
        assert_eq!(masks.of_view(&view("a", 1))?, None);
        let has = |name| masks.has_view(&view(name, 1));
        assert!(has("left_1")? && has("2")? && !has("a")?);
        // As COLMAP names masks: after the whole name of the photo.
        write_mask(&root.join("left/7.jpg.png"), &of(5))?;
        let photo = View { image_path: "images/left/7.jpg".into(), ..view("left_7", 1) };
        assert_eq!(MaskFolder::open(&root)?.of_view(&photo)?, Some(of(5)));
        let alone = View { image_path: "images/left/7.jpg".into(), ..view("7", 1) };
        assert_eq!(MaskFolder::open(&root)?.of_view(&alone)?, Some(of(5)));
        assert!(masks.of_view(&view("1", 1)).is_err_and(|e| e.to_string().contains("view 1")));
        let text = masks.of_view(&view("2", 3)).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text.contains("2.png") && text.contains("1x1") && text.contains("3x1"), "{text}");
        std::fs::write(root.join("a.b.png"), "")?;
        // If names differ in more than case, they are two files for one view.
        if std::fs::read_dir(&root)?.count() == 5 {
            assert!(MaskFolder::open(&root).is_err_and(|e| e.to_string().contains("same view")));
        }
        assert!(MaskFolder::open(&root.join("none")).is_err());
        Ok(())
    }

    #[test]
    fn categories_name_ids() -> Outcome {
        let folder = tempfile::tempdir()?;
        write_mask(&folder.path().join("a.png"), &mask())?;
        let path = folder.path().join(CATEGORIES);
        let categories = BTreeMap::from([(1, "chair".to_owned()), (65535, "a \"vase\"".to_owned())]);
        write_categories(&path, &categories)?;
        assert_eq!(MaskFolder::open(folder.path())?.categories, categories);
        std::fs::write(&path, r#"{"0": "background", "7": "table"}"#)?;
        assert_eq!(read_categories(&path)?, BTreeMap::from([(7, "table".to_owned())]));
        for (text, want) in [
            ("[]", "not a JSON object"),
            (r#"{"65536": "x"}"#, "\"65536\": is not a mask id"),
            (r#"{"chair": "1"}"#, "\"chair\": is not a mask id"),
            (r#"{"1": 2}"#, "not a string"),
            (r#"{"1": "a", "01": "b"}"#, "twice"),
            ("{", "not valid JSON"),
        ] {
            std::fs::write(&path, text)?;
            let text = MaskFolder::open(folder.path()).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(text.contains(want), "{text} lacks {want}");
        }
        assert!(write_categories(&path, &BTreeMap::from([(0, "x".to_owned())])).is_err());
        Ok(())
    }
}
