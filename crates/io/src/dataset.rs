//! The views of a dataset folder, read from whichever camera files it has.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use crate::colmap::{self, Distortion, PosedImage};
use crate::error::IoError;
use crate::masks::{Mask, read_mask};
use crate::nerf;
use instgs_vk::scene::camera::Camera;

/// Unless the dataset defines a split, every eighth view by name is a test view, starting with the first.
const TEST_EVERY: usize = 8;

/// The split that a view belongs to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Split {
    /// Views that are trained on.
    Train,
    /// Held out, only for evaluation.
    Test,
}

/// A photo with its camera.
#[derive(Clone, Debug, PartialEq)]
pub struct View {
    /// The camera of the undistorted image, named after the image file; the name is unique in the dataset.
    pub camera: Camera,
    /// Path of the image; it may not exist.
    pub image_path: PathBuf,
    /// Training or test split.
    pub split: Split,
    /// Lens distortion of the image; `None` for a pinhole image.
    pub distortion: Option<Distortion>,
    /// Path of an image of the same size whose zero pixels are neither trained on nor compared; it may not exist.
    pub mask_path: Option<PathBuf>,
}

/// All views of a folder, sorted by image path.
#[derive(Clone, Debug, PartialEq)]
pub struct Dataset {
    /// All views, in that order.
    pub views: Vec<View>,
    /// What a user should know of how they were read, one line each.
    pub notes: Vec<String>,
}

impl Dataset {
    /// The views of one split, in the dataset's order.
    pub fn split(&self, split: Split) -> impl Iterator<Item = &View> {
        self.views.iter().filter(move |v| v.split == split)
    }
}

/// The files that the cameras of a dataset are read from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum CameraFiles {
    /// Transforms files: of all views; or of the views to train on, and of those that are held out.
    Transforms { train: PathBuf, held_out: Option<PathBuf> },
    /// The folder of a COLMAP model.
    Colmap(PathBuf),
}

impl CameraFiles {
    /// The first of these that a dataset has: `transforms_train.json` with `transforms_test.json` (or
    /// `transforms_val.json`), `transforms.json`, `transforms_train.json` alone, `sparse/0` (or `sparse`).
    pub(crate) fn of(dataset: &Path) -> Option<Self> {
        let single = Some(dataset.join("transforms.json")).filter(|path| path.is_file());
        match (nerf::blender_files(dataset), single) {
            (Some((train, held_out @ Some(_))), _) => Some(Self::Transforms { train, held_out }),
            (_, Some(train)) | (Some((train, None)), None) => Some(Self::Transforms { train, held_out: None }),
            (None, None) => colmap::colmap_folder(dataset).map(Self::Colmap),
        }
    }
}

/// Reads the views of a dataset folder from the first of these that exists: `transforms_train.json` with
/// `transforms_test.json` (or `transforms_val.json`), `transforms.json`, `transforms_train.json` alone, `sparse/0` (or
/// `sparse`). The split is the pair's, or that of `transforms.json` ([`nerf`]), otherwise the test split is every eighth view
/// by name, from the first one on.
///
/// A `mask_path` is an instance mask (ids of objects, 0 = none) if a `categories.json` is in its folder, in a parent
/// folder within the dataset, or in the dataset's `masks/`, the default folder of instance masks; or if its values are
/// those of ids. Such a mask does not mark valid pixels, and is not used here.
///
/// # Errors
/// No camera file exists, one is damaged, or there are no views.
pub fn read_views(folder: &Path) -> Result<Dataset, IoError> {
    let mut views = Vec::new();
    let mut notes = Vec::new();
    let mut split_given = false;
    let mut unused: Option<PathBuf> = None;
    let mut add = |images: Vec<PosedImage>, root: &Path, given: Option<Split>| {
        let noted = images.iter().filter_map(|image| image.note.clone()).collect::<Vec<_>>();
        if let [first, rest @ ..] = &noted[..] {
            let more = if rest.is_empty() { String::new() } else { format!(" ({} more)", rest.len()) };
            notes.push(format!("{first}{more}"));
        }
        for PosedImage { mut camera, file, distortion, mask, split, note: _ } in images {
            let relative = without_dots(&file_in(root, &file));
            camera.name = colmap::stem(&relative.to_string_lossy());
            let mask_path = mask.map(|m| root.join(without_dots(&file_in(root, &m))));
            let mask_path = mask_path.filter(|mask| match ids_of_objects(folder, mask) {
                None => true,
                Some(Ids::Here) => false,
                Some(Ids::InMasks) => {
                    unused.get_or_insert_with(|| mask.clone());
                    false
                }
            });
            let split = given.or(split);
            split_given |= split.is_some();
            let split = split.unwrap_or(Split::Train);
            let view = View { camera, image_path: root.join(&relative), split, distortion, mask_path };
            views.push((view, relative));
        }
    };
    match CameraFiles::of(folder) {
        Some(CameraFiles::Transforms { train, held_out: Some(held_out) }) => {
            add(nerf::read_transforms(&train)?, folder, Some(Split::Train));
            add(nerf::read_transforms(&held_out)?, folder, Some(Split::Test));
        }
        Some(CameraFiles::Transforms { train, held_out: None }) => add(nerf::read_transforms(&train)?, folder, None),
        Some(CameraFiles::Colmap(model)) => {
            let images = colmap::read_colmap(&model)?;
            let count = images.len();
            add(images, &folder.join("images"), None);
            let unused = photos_without_camera(&folder.join("images"), count);
            notes.extend(colmap::larger_model(folder, &model, count).or(unused));
        }
        None => {
            if let Some(error) = colmap::unusable_model(folder) {
                return Err(error);
            }
            let what = match folder.metadata() {
                Err(_) => "there is no such folder",
                Ok(there) if there.is_dir() => "has no cameras",
                Ok(_) => "is a file, and a dataset is a folder",
            };
            return Err(IoError::new(folder, what)
                .advise("a dataset has transforms.json, or transforms_train.json, or a COLMAP model in sparse/0"));
        }
    }
    if views.is_empty() {
        return Err(IoError::new(folder, "its camera files have no views")
            .advise("find the cameras again, or give a folder whose files list photos"));
    }
    views.sort_by(|a, b| a.0.image_path.cmp(&b.0.image_path));
    if let Some(pair) = views.windows(2).find(|w| w[0].0.image_path == w[1].0.image_path) {
        return Err(IoError::new(
            folder,
            format!("the image {} appears twice in its camera files", pair[0].1.display()),
        )
        .advise("leave one of the two there"));
    }
    notes.extend(fisheye_note(views.iter().map(|(view, _)| view)));
    unique_names(&mut views);
    let mut views: Vec<View> = views.into_iter().map(|(view, _)| view).collect();
    notes.extend(unused.map(|mask| {
        format!(
            "{}: no mask_path is used, since masks/categories.json says that masks hold ids of objects: all pixels are used; \
             --pixel-masks DIR names masks of pixels",
            mask.display()
        )
    }));
    notes.extend(drop_id_masks(&mut views));
    // A single view is a training view.
    if !split_given && views.len() > 1 {
        views.iter_mut().step_by(TEST_EVERY).for_each(|v| v.split = Split::Test);
    }
    Ok(Dataset { views, notes })
}

/// A file that a data set names, relative to `folder`. Backslashes of paths written on Windows become `/`, unless a file of
/// exactly that name exists.
pub(crate) fn file_in(folder: &Path, name: &str) -> String {
    if name.contains('\\') && !folder.join(name).is_file() { name.replace('\\', "/") } else { name.to_owned() }
}

/// A note if photos of fisheye lenses lose much of their sides: as pinhole pictures of the same focal length they show less.
fn fisheye_note<'a>(views: impl Iterator<Item = &'a View>) -> Option<String> {
    let mut fisheye = views.filter(|view| view.distortion.is_some_and(|d| d.fisheye.is_some()));
    let first = fisheye.next()?;
    let (camera, count) = (&first.camera, 1 + fisheye.count());
    let corner = (f64::from(camera.width) / 2.0 / camera.fx).hypot(f64::from(camera.height) / 2.0 / camera.fy);
    let degrees = corner.atan().to_degrees();
    Some(format!(
        "{}: {count} photos of fisheye lenses are undistorted to {degrees:.0} degrees from their axis; what is farther is not used",
        first.image_path.display()
    ))
}

/// A note if far more photos lie in a folder than have cameras: at least a quarter of them is not used.
fn photos_without_camera(images: &Path, cameras: usize) -> Option<String> {
    let photos = count_photos(images, 2);
    (4 * cameras < 3 * photos).then(|| {
        format!("{}: {cameras} of its {photos} photos have a camera; the others are not used", images.display())
    })
}

/// The number of photos in a folder and `depth` levels of subfolders.
fn count_photos(folder: &Path, depth: usize) -> usize {
    let Ok(entries) = std::fs::read_dir(folder) else { return 0 };
    let count = |entry: std::fs::DirEntry| {
        let path = entry.path();
        let is_photo =
            path.extension().is_some_and(|e| ["png", "jpg", "jpeg"].iter().any(|photo| e.eq_ignore_ascii_case(photo)));
        match entry.file_type() {
            Ok(kind) if kind.is_dir() && depth > 0 => count_photos(&path, depth - 1),
            Ok(kind) if !kind.is_dir() && is_photo => 1,
            _ => 0,
        }
    };
    entries.flatten().map(count).sum()
}

/// Masks that are looked at to tell ids from valid pixels.
const LOOKED_AT: usize = 5;

/// Leaves out masks of valid pixels whose values are ids of objects, which would ignore all but the objects. The note names
/// one of them.
fn drop_id_masks(views: &mut [View]) -> Option<String> {
    let mut masks: Vec<&PathBuf> = views.iter().filter_map(|view| view.mask_path.as_ref()).collect();
    masks.sort();
    masks.dedup();
    let every = masks.len().div_ceil(LOOKED_AT).max(1);
    let first = masks.into_iter().step_by(every).find(|path| read_mask(path).is_ok_and(|mask| has_ids(&mask)))?.clone();
    views.iter_mut().for_each(|view| view.mask_path = None);
    Some(format!(
        "{}: mask_path names ids of objects, not pixels that count: all pixels are used; masks of pixels are 0 and 255",
        first.display()
    ))
}

/// True if a mask has values between none (0) and all (255, or 65535 of 16 bits), and never all, as soft edges have.
fn has_ids(mask: &Mask) -> bool {
    let is_all = |id: u16| id == u16::from(u8::MAX) || id == u16::MAX;
    let present = mask.ids_present();
    present.keys().any(|&id| id > 1 && !is_all(id)) && !present.keys().any(|&id| is_all(id))
}

/// Which photos may be missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum MissingPhotos {
    /// Up to half of them; more look like a wrong folder.
    Few,
    /// Any number that leaves a view.
    Skip,
}

/// Leaves out views whose photos are missing, and returns a note about them.
///
/// # Errors
/// More are missing than may be; the error names a photo of nearly the same name, if there is one.
pub fn leave_out_missing(views: &mut Vec<View>, may_be_missing: MissingPhotos) -> Result<Option<String>, IoError> {
    let all = views.len();
    let missing: Vec<&View> = views.iter().filter(|view| !view.image_path.is_file()).collect();
    let Some(first) = missing.first() else { return Ok(None) };
    let (count, path) = (missing.len(), first.image_path.clone());
    let near = near_name(&path).map(|near| format!("; {} is there", near.display())).unwrap_or_default();
    let too_many = match may_be_missing {
        MissingPhotos::Few => 2 * count > all,
        MissingPhotos::Skip => count == all,
    };
    if too_many {
        let more =
            if count == 1 { String::new() } else { format!(", as are {} of the other {} photos", count - 1, all - 1) };
        let error = IoError::new(&path, format!("is missing{more}{near}"));
        return Err(error.advise(match may_be_missing {
            MissingPhotos::Few if count < all => "put it there, or go on without such photos with --skip-missing",
            _ => "put the photos there",
        }));
    }
    views.retain(|view| view.image_path.is_file());
    let left_out = if count == 1 {
        format!("1 view of {all} without a photo is left out")
    } else {
        format!("{count} views of {all} without a photo are left out")
    };
    Ok(Some(format!("{} is missing{near}: {left_out}", path.display())))
}

/// A file in the folder of a missing one whose name differs from it in case or ending only.
fn near_name(path: &Path) -> Option<PathBuf> {
    let lower = |path: &Path| path.file_stem().map(|stem| stem.to_string_lossy().to_lowercase());
    let mut near: Vec<PathBuf> = std::fs::read_dir(path.parent()?)
        .ok()?
        .flatten()
        .map(|entry| entry.path())
        .filter(|other| lower(other) == lower(path))
        .collect();
    near.sort();
    near.into_iter().next()
}

/// The path `./a/b` as `a/b`, so that each path has one spelling.
pub(crate) fn without_dots(file: &str) -> PathBuf {
    Path::new(file).components().filter(|c| !matches!(c, std::path::Component::CurDir)).collect()
}

/// What says that a mask holds ids of objects.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Ids {
    /// The categories in its folder, or in one above it.
    Here,
    /// Those of the dataset's `masks/`, where it does not lie.
    InMasks,
}

/// Whether `mask`, of a dataset in `folder`, holds ids of objects; `None` if nothing says so. If there are ids in `masks/`, no mask
/// of the dataset is taken for one of valid pixels: `masks_2/` may hold the same ids at half the size, and to ignore every pixel
/// without an object would silently spoil the training.
fn ids_of_objects(folder: &Path, mask: &Path) -> Option<Ids> {
    let has_categories = |folder: &Path| folder.join("categories.json").is_file();
    // Absolute paths, since a file may name its masks by absolute paths.
    let absolute = |path: &Path| std::path::absolute(path).unwrap_or_else(|_| path.into());
    let (folder, mask) = (absolute(folder), absolute(mask));
    let mut within = mask.ancestors().skip(1).take_while(|above| above.starts_with(&folder));
    if mask.parent().is_some_and(has_categories) || within.any(has_categories) {
        return Some(Ids::Here);
    }
    has_categories(&folder.join("masks")).then_some(Ids::InMasks)
}

/// Makes view names unique. Views whose file names without extension are equal are named after their path instead:
/// `left/0001.jpg` is `left_0001`; if that is taken too (`a.png` beside `a.jpg`), the extension is appended. Folders
/// that all photos share are omitted, such as `images` before `left`, so that masks are found in `masks/left`. Those that are
/// still equal (`a/b.png` beside `a_b.png`) get a number that makes a name which no other view has, but for the first of them.
fn unique_names(views: &mut [(View, PathBuf)]) {
    let shared = shared_folders(views.iter().map(|(_, relative)| relative.as_path()));
    for round in 0..2 {
        let mut count: BTreeMap<String, usize> = BTreeMap::new();
        views.iter().for_each(|(v, _)| *count.entry(v.camera.name.clone()).or_default() += 1);
        for (view, relative) in views.iter_mut().filter(|(v, _)| count[&v.camera.name] > 1) {
            let relative: PathBuf = relative.components().skip(shared).collect();
            let path = if round == 0 { relative.with_extension("") } else { relative };
            view.camera.name = path.to_string_lossy().replace(['/', '\\'], "_");
        }
    }
    let taken: BTreeSet<String> = views.iter().map(|(view, _)| view.camera.name.clone()).collect();
    let mut numbers: BTreeMap<String, usize> = BTreeMap::new();
    for (view, _) in views {
        let name = view.camera.name.clone();
        let number = numbers.entry(name.clone()).or_default();
        *number += 1;
        if *number == 1 {
            continue;
        }
        // Numbered names differ from each other: in what is before the last number, or in the number.
        let mut free = format!("{name}_{number}");
        while taken.contains(&free) {
            *number += 1;
            free = format!("{name}_{number}");
        }
        view.camera.name = free;
    }
}

/// Number of leading folders that all paths have in common.
pub(crate) fn shared_folders<'a>(mut paths: impl Iterator<Item = &'a Path>) -> usize {
    let folders = |path: &'a Path| path.parent().unwrap_or(path).components().collect::<Vec<_>>();
    let first = paths.next().map(folders).unwrap_or_default();
    let shared = |most: usize, path| first[..most].iter().zip(folders(path)).take_while(|(a, b)| *a == b).count();
    paths.fold(first.len(), shared)
}

#[cfg(test)]
mod tests {
    use super::*;

    const POSE: &str = "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]";

    fn transforms(names: &[&str]) -> String {
        let frames: Vec<_> =
            names.iter().map(|n| format!(r#"{{"file_path":"{n}","transform_matrix":{POSE}}}"#)).collect();
        format!(r#"{{"w":2,"h":2,"fl_x":1,"frames":[{}]}}"#, frames.join(","))
    }

    #[test]
    fn precedence_split_and_names() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let root = folder.path();
        assert!(read_views(root).is_err_and(|e| e.to_string().contains("no cameras")));
        std::fs::create_dir_all(root.join("sparse/0"))?;
        std::fs::write(root.join("sparse/0/cameras.txt"), "1 PINHOLE 2 2 1 1 1 1\n")?;
        std::fs::write(root.join("sparse/0/images.txt"), "1 1 0 0 0 0 0 0 1 z.jpg\n\n")?;
        let colmap = read_views(root)?;
        assert_eq!(
            (colmap.views[0].image_path.clone(), colmap.views[0].split),
            (root.join("images/z.jpg"), Split::Train),
            "a single one"
        );

        let names: Vec<String> = (0..18).rev().map(|i| format!("images/{i:02}.jpg")).collect();
        std::fs::write(
            root.join("transforms.json"),
            transforms(&names.iter().map(String::as_str).collect::<Vec<_>>()),
        )?;
        let single = read_views(root)?;
        let test: Vec<_> = single.split(Split::Test).map(|v| v.camera.name.as_str()).collect();
        assert_eq!((single.views.len(), test), (18, vec!["00", "08", "16"]));

        std::fs::write(root.join("transforms_train.json"), transforms(&["./left/1.jpg", "right/1.jpg"]))?;
        std::fs::write(root.join("transforms_test.json"), transforms(&["2.jpg"]))?;
        let pair = read_views(root)?;
        let got: Vec<_> = pair.views.iter().map(|v| (v.camera.name.as_str(), v.split)).collect();
        assert_eq!(got, [("2", Split::Test), ("left_1", Split::Train), ("right_1", Split::Train)]);
        assert_eq!(pair.views[1].image_path, root.join("left/1.jpg"));

        // Mask folders are named in this way: masks/left/1.png.
        std::fs::write(root.join("transforms_train.json"), transforms(&["images/left/1.jpg", "./images/right/1.jpg"]))?;
        std::fs::write(root.join("transforms_test.json"), transforms(&["images/left/2.jpg"]))?;
        let rig = read_views(root)?;
        let names: Vec<_> = rig.views.iter().map(|v| v.camera.name.as_str()).collect();
        assert_eq!(names, ["left_1", "2", "right_1"], "without the folder that all are in");
        Ok(())
    }

    /// A folder and a part of a file name make the same name, with the extension, too; and so does the first number.
    #[test]
    fn names_that_paths_do_not_tell_apart_get_a_number() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let names = |files: &[&str]| -> Result<Vec<String>, Box<dyn std::error::Error>> {
            std::fs::write(folder.path().join("transforms.json"), transforms(files))?;
            Ok(read_views(folder.path())?.views.into_iter().map(|v| v.camera.name).collect())
        };
        let three = ["a/b.png", "c/b.png", "a_b.png"];
        assert_eq!(names(&three)?, ["a_b.png", "a_b.png_2", "c_b"]);
        let four = ["a_b.png_2.png", "a_b.png", "c/b.png", "a/b.png"];
        assert_eq!(names(&four)?, ["a_b.png", "a_b.png_3", "a_b.png_2", "c_b"]);
        let more = ["a/b/c.png", "a/b_c.png", "a_b/c.png", "d/c.png"];
        assert_eq!(names(&more)?, ["a_b_c.png", "b_c", "a_b_c.png_2", "d_c"]);
        // What the paths tell apart has no number.
        assert_eq!(names(&["a/b.png", "c/b.png", "d.png", "d.jpg"])?, ["a_b", "c_b", "d.jpg", "d.png"]);
        Ok(())
    }

    #[test]
    fn instance_masks_ignore_no_pixels() -> Result<(), Box<dyn std::error::Error>> {
        // Folder of the mask, folder of categories.json (relative to the dataset's parent), and whether the mask is
        // used.
        for (mask, categories, used) in [
            ("masks", "", true),
            ("masks", "data/masks", false),
            ("masks/left/8bit", "data/masks", false),
            ("masks/left/8bit", "data/masks/left", false),
            ("masks/left/8bit", "data/masks/left/8bit", false),
            ("masks/left/8bit", "data/masks/right", true),
            ("masks_2", "data/masks", false),
            ("ids/left", "data/ids", false),
            ("ids/left", "data", false),
            ("ids/left", "data/images", true),
            // A file outside the dataset is ignored.
            ("masks", ".", true),
            ("../elsewhere", "elsewhere", false),
        ] {
            let folder = tempfile::tempdir()?;
            let root = folder.path().join("data");
            std::fs::create_dir(&root)?;
            if !categories.is_empty() {
                std::fs::create_dir_all(folder.path().join(categories))?;
                std::fs::write(folder.path().join(categories).join("categories.json"), "{}")?;
            }
            for mask_path in [format!("./{mask}/a.png"), root.join(mask).join("a.png").display().to_string()] {
                let frame = format!(r#"{{"file_path":"a.png","mask_path":{mask_path:?},"transform_matrix":{POSE}}}"#);
                let text = format!(r#"{{"w":2,"h":2,"fl_x":1,"frames":[{frame}]}}"#);
                std::fs::write(root.join("transforms.json"), text)?;
                let dataset = read_views(&root)?;
                let used_mask = dataset.views[0].mask_path.clone();
                assert_eq!(used_mask, used.then(|| root.join(mask).join("a.png")), "{mask_path} {categories}");
                // What only the folder masks/ says is told.
                let told = dataset.notes.iter().any(|note| note.contains("no mask_path is used"));
                assert_eq!(told, mask == "masks_2", "{mask_path} {categories}: {:?}", dataset.notes);
            }
        }
        Ok(())
    }

    #[test]
    fn nerfstudio_masks_and_filenames() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let root = folder.path();
        let frame =
            |n: &str| format!(r#"{{"file_path":"./i/{n}.png","mask_path":"./m/{n}.png","transform_matrix":{POSE}}}"#);
        let frames = ["a", "b", "c", "d"].map(frame).join(",");
        let read = |lists: &str| {
            let text = format!(r#"{{"w":2,"h":2,"fl_x":1,{lists}"frames":[{frames}]}}"#);
            std::fs::write(root.join("transforms.json"), text)?;
            Ok::<_, std::io::Error>(read_views(root))
        };
        let names = |dataset: &Dataset, split| dataset.split(split).map(|v| v.camera.name.clone()).collect::<String>();
        for (lists, train, test) in [
            ("", "bcd", "a"),
            (r#""test_filenames":["i/c.png"],"#, "abd", "c"),
            // Views for validation are not trained on, even if they are not the test split.
            (r#""test_filenames":["i/c.png"],"val_filenames":["./i/b.png"],"#, "ad", "c"),
            (r#""train_filenames":["i/a.png","i/b.png"],"val_filenames":["./i/b.png"],"test_filenames":[],"#, "a", "b"),
            (r#""train_filenames":["i/a.png","i/b.png"],"#, "ab", "cd"),
        ] {
            let dataset = read(lists)??;
            assert_eq!(
                (names(&dataset, Split::Train), names(&dataset, Split::Test)),
                (train.into(), test.into()),
                "{lists}"
            );
            assert!(dataset.views[0].mask_path.as_ref().is_some_and(|m| m.starts_with(root.join("m"))));
        }
        let error = |lists| Ok::<_, std::io::Error>(read(lists)?.err().map(|e| e.to_string()).unwrap_or_default());
        assert!(
            error(r#""val_filenames":["i/c.png","i/x.png"],"#)?
                .contains("val_filenames[1]: no frame has the file i/x.png")
        );
        assert!(error(r#""val_filenames":[3],"#)?.contains("val_filenames[0]: is not a string"));
        assert!(
            error(r#""train_filenames":["i/a.png"],"val_filenames":["i/a.png"],"#)?.contains("no view to train on")
        );
        std::fs::create_dir(root.join("m"))?;
        std::fs::write(root.join("m/categories.json"), "{}")?;
        assert_eq!(read("")??.views[0].mask_path, None);
        Ok(())
    }
}
