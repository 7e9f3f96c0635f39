//! COLMAP models (`sparse/0`, binary or text): cameras and image poses.
//!
//! COLMAP's axes are the same as here (OpenCV, pixel centres at +0.5). Observations of points are skipped; `points3D`
//! is read by [`crate::point_cloud`].

use std::collections::BTreeMap;
use std::io::Read;
use std::path::{Path, PathBuf};

use glam::{DMat3, DQuat, DVec3};

use crate::bytes::Cursor;
use crate::dataset::Split;
use crate::error::{IoError, Place};
use crate::read_bytes;
use crate::text::text_of;
pub use instgs_vk::math::distortion::Distortion;
use instgs_vk::scene::camera::{Camera, rigid_rows};

/// A camera with its image's name in the file, before it becomes a view of a dataset.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedImage {
    /// The pinhole camera, named after the image file without its extension.
    pub camera: Camera,
    /// Image path as written in the file, relative to `images/` (COLMAP) or to the file's folder (transforms.json).
    pub file: String,
    /// Lens distortion of the image; `None` for a pinhole image.
    pub distortion: Option<Distortion>,
    /// Path of a mask of valid pixels, as written in the file; only transforms.json has it.
    pub mask: Option<String>,
    /// The split that the file assigns. Either all views of a file have one or none has.
    pub split: Option<Split>,
    /// What a user should know of how the image was read, one line.
    pub note: Option<String>,
}

struct Intrinsics {
    size: [u32; 2],
    focal: [f64; 2],
    centre: [f64; 2],
    distortion: Option<Distortion>,
}

/// The folder of the COLMAP model of a dataset, if it has one: `sparse/0`, else `sparse`.
pub fn colmap_folder(dataset: &Path) -> Option<PathBuf> {
    places(dataset).into_iter().find(|folder| kind_of(folder).is_some())
}

/// Where the model of a dataset may be, the first place first.
fn places(dataset: &Path) -> [PathBuf; 2] {
    [dataset.join("sparse/0"), dataset.join("sparse")]
}

/// What is in `sparse`, models and other things, in order of names.
fn in_sparse(dataset: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(dataset.join("sparse")).into_iter().flatten().flatten();
    let mut paths: Vec<PathBuf> = entries.map(|entry| entry.path()).collect();
    paths.sort();
    paths
}

/// The ending of the files of a model, of which both cameras and images are there: `bin`, else `txt`.
fn kind_of(model: &Path) -> Option<&'static str> {
    let has = |ending: &str| ["cameras", "images"].iter().all(|f| model.join(format!("{f}.{ending}")).is_file());
    ["bin", "txt"].into_iter().find(|ending| has(ending))
}

/// The number of images of a model; of a binary one as it claims, without reading it.
fn count_images(model: &Path) -> Option<usize> {
    if kind_of(model)? == "txt" {
        return read_colmap(model).ok().map(|images| images.len());
    }
    let mut count = [0; 8];
    std::fs::File::open(model.join("images.bin")).ok()?.read_exact(&mut count).ok()?;
    usize::try_from(u64::from_le_bytes(count)).ok()
}

/// What a user should know of the choice of this model of a dataset: that another one has more images.
pub(crate) fn larger_model(dataset: &Path, used: &Path, images: usize) -> Option<String> {
    let others = in_sparse(dataset);
    let counted = others.iter().filter(|other| other.as_path() != used);
    let counted = counted.filter_map(|other| Some((count_images(other)?, other)));
    let (count, other) = counted.max_by_key(|(count, other)| (*count, std::cmp::Reverse((*other).clone())))?;
    (count > images).then(|| {
        format!(
            "{} has {count} images, {}, which is used, {images}: to use the other, exchange the names of the two folders",
            other.display(),
            used.display()
        )
    })
}

/// The error for a dataset whose COLMAP models cannot be used: one that lacks a file, or that lies in another folder than the one
/// that is read. `None` if it has none.
pub(crate) fn unusable_model(dataset: &Path) -> Option<IoError> {
    let (models, places) = (in_sparse(dataset), places(dataset));
    let place = places[0].display();
    if let Some(whole) = models.iter().filter(|model| kind_of(model).is_some()).max_by_key(|model| count_images(model))
    {
        let error = IoError::new(whole, format!("is a whole COLMAP model, and models are read from {place}"));
        return Some(match places[0].exists() {
            true => error.advise("exchange the names of the two folders"),
            false => error.advise(format!("rename it to {place}")),
        });
    }
    places.iter().chain(&models).find_map(|model| {
        let is_there =
            |stem: &str| ["bin", "txt"].iter().any(|ending| model.join(format!("{stem}.{ending}")).is_file());
        let missing = match (is_there("cameras"), is_there("images")) {
            (false, false) => return None,
            (true, false) => "images.bin and no images.txt",
            (false, true) => "cameras.bin and no cameras.txt",
            (true, true) => "pair of cameras and images that are both .bin or both .txt",
        };
        let error = IoError::new(model, format!("is a COLMAP model that has no {missing}"));
        Some(error.advise("have COLMAP export the whole model"))
    })
}

/// Reads `cameras` and `images` of a model folder; `.bin` files take precedence over `.txt` if both are there.
///
/// # Errors
/// A file is missing or damaged, or a camera model is not supported.
pub fn read_colmap(folder: &Path) -> Result<Vec<PosedImage>, IoError> {
    let ending = kind_of(folder).unwrap_or("txt");
    let binary = ending == "bin";
    let (cameras_path, images_path) =
        (folder.join(format!("cameras.{ending}")), folder.join(format!("images.{ending}")));
    let (cameras, images) = (read_bytes(&cameras_path)?, read_bytes(&images_path)?);
    if binary {
        parse_images_bin(&images, &images_path, &parse_cameras_bin(&cameras, &cameras_path)?)
    } else {
        parse_images_txt(&images, &images_path, &parse_cameras_txt(&cameras, &cameras_path)?)
    }
}

/// Parses the bytes of the two binary files; `path` is only used in messages.
pub fn parse_colmap_bin(cameras: &[u8], images: &[u8], path: &Path) -> Result<Vec<PosedImage>, IoError> {
    parse_images_bin(images, path, &parse_cameras_bin(cameras, path)?)
}

/// Parses the bytes of the two text files; `path` is only used in messages.
pub fn parse_colmap_txt(cameras: &[u8], images: &[u8], path: &Path) -> Result<Vec<PosedImage>, IoError> {
    parse_images_txt(images, path, &parse_cameras_txt(cameras, path)?)
}

/// COLMAP's camera models by number: name and number of parameters.
const MODELS: [(&str, usize); 18] = [
    ("SIMPLE_PINHOLE", 3),
    ("PINHOLE", 4),
    ("SIMPLE_RADIAL", 4),
    ("RADIAL", 5),
    ("OPENCV", 8),
    ("OPENCV_FISHEYE", 8),
    ("FULL_OPENCV", 12),
    ("FOV", 5),
    ("SIMPLE_RADIAL_FISHEYE", 4),
    ("RADIAL_FISHEYE", 5),
    ("THIN_PRISM_FISHEYE", 12),
    ("RAD_TAN_THIN_PRISM_FISHEYE", 16),
    ("SIMPLE_DIVISION", 4),
    ("DIVISION", 5),
    ("SIMPLE_FISHEYE", 3),
    ("FISHEYE", 4),
    ("EUCM", 6),
    (PANORAMA, 2),
];

/// The model of panoramas, whose parameters are the size of the picture.
const PANORAMA: &str = "EQUIRECTANGULAR";
const UNDISTORT: &str = "undistort with `colmap image_undistorter`";
/// COLMAP's undistorter only copies panoramas.
pub(crate) const CUT_PANORAMA: &str =
    "cut panoramas into perspective views first, as COLMAP's script panorama_sfm.py does";

/// The distortion of a fisheye lens.
pub(crate) fn fisheye(k: [f64; 4]) -> Distortion {
    Distortion { fisheye: Some(k), ..Distortion::default() }
}

fn intrinsics(model: &str, size: [u64; 2], p: &[f64], fail: &dyn Fn(String) -> IoError) -> Result<Intrinsics, IoError> {
    let (fx, fy, cx, cy, distortion) = match (model, p) {
        ("SIMPLE_PINHOLE", &[f, cx, cy]) => (f, f, cx, cy, Distortion::default()),
        ("PINHOLE", &[fx, fy, cx, cy]) => (fx, fy, cx, cy, Distortion::default()),
        ("SIMPLE_RADIAL", &[f, cx, cy, k1]) => (f, f, cx, cy, Distortion { k1, ..Distortion::default() }),
        ("RADIAL", &[f, cx, cy, k1, k2]) => (f, f, cx, cy, Distortion { k1, k2, ..Distortion::default() }),
        ("OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2]) => {
            (fx, fy, cx, cy, Distortion { k1, k2, p1, p2, ..Distortion::default() })
        }
        ("SIMPLE_FISHEYE", &[f, cx, cy]) => (f, f, cx, cy, fisheye([0.0; 4])),
        ("FISHEYE", &[fx, fy, cx, cy]) => (fx, fy, cx, cy, fisheye([0.0; 4])),
        ("SIMPLE_RADIAL_FISHEYE", &[f, cx, cy, k1]) => (f, f, cx, cy, fisheye([k1, 0.0, 0.0, 0.0])),
        ("RADIAL_FISHEYE", &[f, cx, cy, k1, k2]) => (f, f, cx, cy, fisheye([k1, k2, 0.0, 0.0])),
        ("OPENCV_FISHEYE", &[fx, fy, cx, cy, k1, k2, k3, k4]) => (fx, fy, cx, cy, fisheye([k1, k2, k3, k4])),
        // k4 to k6 form a denominator; they are zero unless they were fitted.
        ("FULL_OPENCV", &[fx, fy, cx, cy, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]) => {
            (fx, fy, cx, cy, Distortion { k1, k2, p1, p2, k3, fisheye: None })
        }
        _ if MODELS.iter().any(|(name, count)| *name == model && *count == p.len()) => {
            let advice = if model == PANORAMA { CUT_PANORAMA } else { UNDISTORT };
            return Err(fail(format!("camera model {model} is not supported")).advise(advice));
        }
        _ => {
            let what = format!("camera model {model} with {} parameters is not known", p.len());
            return Err(fail(what).advise(UNDISTORT));
        }
    };
    let [Ok(width), Ok(height)] = size.map(u32::try_from) else {
        return Err(fail(format!("image size {}x{}", size[0], size[1])));
    };
    Ok(Intrinsics { size: [width, height], focal: [fx, fy], centre: [cx, cy], distortion: distortion.if_any() })
}

/// Cameras by number. One that is not supported matters only if an image uses it.
type Cameras = BTreeMap<u32, Result<Intrinsics, IoError>>;

fn parse_cameras_bin(bytes: &[u8], path: &Path) -> Result<Cameras, IoError> {
    let mut c = Cursor::new(bytes, path);
    let count = c.u64("the number of cameras")?;
    let mut cameras = Cameras::new();
    // Each iteration consumes bytes, so a wrong count stops at the end of the file.
    for _ in 0..count {
        let at = c.position() as u64;
        let fail = |what: String| IoError::new(path, what).at(Place::Byte(at));
        let (id, model) = (c.u32("a camera")?, c.u32("a camera")?);
        let size = [c.u64("a camera")?, c.u64("a camera")?];
        let Some(&(name, parameters)) = MODELS.get(model as usize) else {
            let what =
                format!("camera model {model} is not known: it is newer than this program, or the file is damaged");
            return Err(fail(what).advise("convert the images to PINHOLE cameras with COLMAP's image_undistorter"));
        };
        let parameters: Vec<f64> = (0..parameters).map(|_| c.f64("a camera")).collect::<Result<_, _>>()?;
        cameras.insert(id, intrinsics(name, size, &parameters, &fail));
    }
    Ok(cameras)
}

fn parse_images_bin(bytes: &[u8], path: &Path, cameras: &Cameras) -> Result<Vec<PosedImage>, IoError> {
    let mut c = Cursor::new(bytes, path);
    let count = c.u64("the number of images")?;
    let mut out = Vec::new();
    for _ in 0..count {
        let at = c.position() as u64;
        let fail = |what: String| IoError::new(path, what).at(Place::Byte(at));
        c.u32("an image")?;
        let mut pose = [0.0; 7];
        for v in &mut pose {
            *v = c.f64("an image")?;
        }
        let camera = c.u32("an image")?;
        let name = c.c_string("an image's name")?;
        let points = c.u64("an image's point count")?;
        let skip = points.checked_mul(24).and_then(|n| usize::try_from(n).ok()).unwrap_or(usize::MAX);
        c.take(skip, "an image's points")?;
        out.push(posed(pose, camera, name, cameras, &fail)?);
    }
    Ok(out)
}

/// Lines with their numbers, from 1, without those of comments.
pub(crate) fn lines<'a>(bytes: &'a [u8], path: &Path) -> Result<Vec<(u64, &'a str)>, IoError> {
    let text = text_of(bytes, path)?;
    Ok((1..).zip(text.lines()).filter(|(_, line)| !line.trim_start().starts_with('#')).collect())
}

pub(crate) fn number<T: std::str::FromStr>(word: Option<&str>, fail: &dyn Fn(String) -> IoError) -> Result<T, IoError> {
    let word = word.ok_or_else(|| fail("ends early".into()))?;
    word.parse().map_err(|_| {
        // A file that is no text may have words of any length.
        let shown: String = word.chars().take(24).collect();
        let more = if shown.len() < word.len() { "..." } else { "" };
        fail(format!("\"{}{more}\" is not a valid number here", shown.escape_debug()))
    })
}

fn parse_cameras_txt(bytes: &[u8], path: &Path) -> Result<Cameras, IoError> {
    let mut cameras = Cameras::new();
    for (n, line) in lines(bytes, path)?.into_iter().filter(|(_, l)| !l.trim().is_empty()) {
        let fail = |what: String| IoError::new(path, what).at(Place::Line(n));
        let mut words = line.split_whitespace();
        let id = number(words.next(), &fail)?;
        let model = words.next().ok_or_else(|| fail("ends early".into()))?;
        let size = [number(words.next(), &fail)?, number(words.next(), &fail)?];
        let parameters: Vec<f64> = words.map(|w| number(Some(w), &fail)).collect::<Result<_, _>>()?;
        cameras.insert(id, intrinsics(model, size, &parameters, &fail));
    }
    Ok(cameras)
}

fn parse_images_txt(bytes: &[u8], path: &Path, cameras: &Cameras) -> Result<Vec<PosedImage>, IoError> {
    let mut out = Vec::new();
    let all = lines(bytes, path)?;
    let mut rest = all.iter().peekable();
    while let Some(&(n, line)) = rest.next() {
        if line.trim().is_empty() {
            continue;
        }
        let fail = |what: String| IoError::new(path, what).at(Place::Line(n));
        let (mut words, name) = split_words::<9>(line);
        number::<u32>(words.next(), &fail)?;
        let mut pose = [0.0; 7];
        for v in &mut pose {
            *v = number(words.next(), &fail)?;
        }
        let camera = number(words.next(), &fail)?;
        if name.is_empty() {
            return Err(fail("names no image".into()));
        }
        out.push(posed(pose, camera, name.to_owned(), cameras, &fail)?);
        // The image's line of points is often empty; files written by hand may lack it.
        rest.next_if(|(_, line)| is_points_line(line));
    }
    Ok(out)
}

/// True for a line of points of an image: triples of x, y and the number of a point, or nothing.
fn is_points_line(line: &str) -> bool {
    let words = line.split_whitespace();
    words.clone().count().is_multiple_of(3) && words.into_iter().all(|word| word.parse::<f64>().is_ok())
}

/// The first `N` words of a line, and the rest as it is, for a file name may hold spaces.
fn split_words<const N: usize>(line: &str) -> (impl Iterator<Item = &str>, &str) {
    let mut rest = line.trim_start();
    let mut words = Vec::with_capacity(N);
    for _ in 0..N {
        let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
        if end > 0 {
            words.push(&rest[..end]);
        }
        rest = rest[end..].trim_start();
    }
    (words.into_iter(), rest.trim_end())
}

/// Builds a view from `pose`: quaternion w, x, y, z and translation of view_from_world.
fn posed(
    pose: [f64; 7],
    camera: u32,
    file: String,
    cameras: &Cameras,
    fail: &dyn Fn(String) -> IoError,
) -> Result<PosedImage, IoError> {
    let Some(intrinsics) = cameras.get(&camera) else {
        return Err(fail(format!("image {file} uses camera {camera}, which is not in the cameras file")));
    };
    let intrinsics = intrinsics.as_ref().map_err(Clone::clone)?;
    let [w, x, y, z, t @ ..] = pose;
    let q = DQuat::from_xyzw(x, y, z, w);
    let length = q.length();
    if !(length.is_finite() && length > 1e-6) {
        return Err(fail(format!("image {file} has a rotation of length {length}")));
    }
    let r = DMat3::from_quat(q / length);
    let camera = Camera {
        name: stem(&file),
        width: intrinsics.size[0],
        height: intrinsics.size[1],
        fx: intrinsics.focal[0],
        fy: intrinsics.focal[1],
        cx: intrinsics.centre[0],
        cy: intrinsics.centre[1],
        view_from_world: rigid_rows(r, DVec3::from_array(t)),
    };
    camera.validate().map_err(|e| fail(e.to_string()))?;
    Ok(PosedImage { camera, file, distortion: intrinsics.distortion, mask: None, split: None, note: None })
}

/// File name without its folders and extension.
pub(crate) fn stem(file: &str) -> String {
    Path::new(file).file_stem().map(|s| s.to_string_lossy().into_owned()).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_with_empty_point_lines_comments_and_distortion() -> Result<(), IoError> {
        let cameras = b"# c\n1 PINHOLE 20 10 15 16 10 5\n2 OPENCV 20 10 15 16 10 5 0.1 0 0 0.2\n";
        let images = b"# i\n1 1 0 0 0 1 2 3 1 a b.jpg\n\n2 0 1 0 0 0 0 0 2 sub/c.png\n1.5 2.5 -1\n";
        let out = parse_colmap_txt(cameras, images, Path::new("m"))?;
        assert_eq!(out.len(), 2);
        assert_eq!((out[0].file.as_str(), out[0].camera.name.as_str()), ("a b.jpg", "a b"));
        assert_eq!(out[0].camera.view_from_world[1], [0.0, 1.0, 0.0, 2.0]);
        assert_eq!((out[0].camera.fx, out[0].camera.fy, out[0].distortion), (15.0, 16.0, None));
        assert_eq!(out[1].distortion, Some(Distortion { k1: 0.1, k2: 0.0, p1: 0.0, p2: 0.2, k3: 0.0, fisheye: None }));
        assert_eq!((out[1].camera.name.as_str(), out[1].camera.view_from_world[2][2]), ("c", -1.0));
        let cameras = b"2 FULL_OPENCV 20 10 15 16 10 5 0.1 0 0 0.2 0.3 0 0 0\n";
        let out = parse_colmap_txt(cameras, b"2 0 1 0 0 0 0 0 2 c.png\n\n", Path::new("m"))?;
        assert_eq!(out[0].distortion, Some(Distortion { k1: 0.1, k2: 0.0, p1: 0.0, p2: 0.2, k3: 0.3, fisheye: None }));
        Ok(())
    }

    #[test]
    fn errors_name_line_or_byte() {
        let cameras: &[u8] = b"1 PINHOLE 20 10 15 16 10 5\n";
        let text = |c: &[u8], i: &[u8]| {
            parse_colmap_txt(c, i, Path::new("m")).err().map(|e| e.to_string()).unwrap_or_default()
        };
        assert!(text(cameras, b"\n1 1 0 0 x").contains("line 2"));
        assert!(text(cameras, b"1 1 0 0 0 0 0 0 7 a.jpg\n\n").contains("camera 7"));
        assert!(text(cameras, b"1 0 0 0 0 0 0 0 1 a.jpg\n\n").contains("rotation"));
        // Cameras matter where images use them.
        let used = b"1 1 0 0 0 0 0 0 1 a.jpg\n\n";
        assert_eq!(text(b"1 THIN_PRISM_FISHEYE 20 10 1 1 1 1 0 0 0 0 0 0 0 0\n", b""), "");
        assert!(text(b"1 THIN_PRISM_FISHEYE 20 10 1 1 1 1 0 0 0 0 0 0 0 0\n", used).contains("image_undistorter"));
        assert!(text(b"1 NEW 20 10 1\n", used).contains("not known"));
        assert!(text(b"1 EUCM 20 10 1 1 1 1 1 1\n", used).contains("EUCM is not supported"));
        assert!(text(b"1 FULL_OPENCV 20 10 1 1 1 1 0 0 0 0 0.1 0.1 0 0\n", used).contains("image_undistorter"));
        assert!(
            parse_colmap_bin(&u64::MAX.to_le_bytes(), &[], Path::new("m"))
                .is_err_and(|e| e.to_string().contains("byte 8"))
        );
    }
}
