//! `transforms.json` of NeRF (Blender), instant-ngp and nerfstudio: camera-to-world poses in OpenGL axes.
//!
//! Intrinsics are in the file or in a frame, which takes precedence: `fl_x`, `fl_y`, `cx`, `cy`, `w`, `h`, `k1` to
//! `k3`, `p1`, `p2`, or `camera_angle_x` (and `_y`). Fields that say one thing together (focal length, distortion, kind of
//! lens) are taken from one of the two: a frame that has any of them has all of them. A field that is null is not there. A
//! missing size is read from the image's header.
//!
//! Supported additions of nerfstudio: `mask_path` of a frame, and the lists `train_filenames`, `val_filenames` and
//! `test_filenames`. The test split is `test_filenames`, or `val_filenames` if that is missing or empty; it takes
//! precedence over `train_filenames`. Frames in no list are training views if there is no `train_filenames`; with
//! `train_filenames` alone they are the test split. All others (validation beside a test split) are ignored.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use glam::{DMat3, DVec3};
use serde_json::Value;

use crate::camera_file::parse_json;
use crate::colmap::{CUT_PANORAMA, Distortion, PosedImage, fisheye, stem};
use crate::dataset::{Split, file_in, without_dots};
use crate::error::{IoError, Place};
use crate::read_bytes;
use instgs_vk::scene::camera::{Camera, rigid_rows};

/// Extensions tried, in this order, for a `file_path` without one, as in Blender's datasets.
const ENDINGS: [&str; 6] = ["png", "jpg", "jpeg", "PNG", "JPG", "JPEG"];

/// Fields that, if set, declare a camera model other than a perspective lens (instant-ngp).
const OTHER_LENSES: [&str; 5] = ["ftheta_p0", "latlong", "equirectangular", "orthographic", "rolling_shutter"];
/// Fields that say the focal length together.
const FOCAL: [&str; 4] = ["fl_x", "fl_y", "camera_angle_x", "camera_angle_y"];
/// nerfstudio's list of the terms of distortion, and all fields that say the distortion together.
const TERMS: &str = "distortion_params";
const DISTORTION: [&str; 9] = [TERMS, "k1", "k2", "k3", "k4", "k5", "k6", "p1", "p2"];
/// Fields that say together what kind of lens it is.
const KIND: [&str; 2] = ["camera_model", "is_fisheye"];
/// nerfstudio's name of fisheye lenses.
const FISHEYE: &str = "OPENCV_FISHEYE";
const UNDISTORT: &str = "undistort the images to PINHOLE";

/// Reads a transforms file; image paths are relative to its folder.
pub fn read_transforms(path: &Path) -> Result<Vec<PosedImage>, IoError> {
    parse_transforms(&read_bytes(path)?, path)
}

/// Parses the bytes of a transforms file; `path` is used in messages and to find images whose extension or size is
/// missing.
pub fn parse_transforms(bytes: &[u8], path: &Path) -> Result<Vec<PosedImage>, IoError> {
    let root = parse_json(bytes, path)?;
    let folder = path.parent().unwrap_or(Path::new("."));
    let field = |name: &str, what: &str| IoError::new(path, what).at(Place::Field(name.into()));
    let frames =
        root.get("frames").and_then(Value::as_array).ok_or_else(|| field("frames", "is missing or not a list"))?;
    let mut images = frames
        .iter()
        .enumerate()
        .map(|(i, frame)| Frame { root: &root, frame, name: format!("frames[{i}]"), path }.read(folder))
        .collect::<Result<Vec<_>, _>>()?;
    apply_filenames(&root, &mut images, path)?;
    Ok(images)
}

/// Applies nerfstudio's lists of file names, if any: sets the split of all images, and removes those of no split.
fn apply_filenames(root: &Value, images: &mut Vec<PosedImage>, path: &Path) -> Result<(), IoError> {
    let known: BTreeSet<PathBuf> = images.iter().map(|i| without_dots(&i.file)).collect();
    let list = |field: &str| -> Result<BTreeSet<PathBuf>, IoError> {
        let Some(value) = present(root, field) else { return Ok(BTreeSet::new()) };
        let fail = |place: String, what: String| IoError::new(path, what).at(Place::Field(place));
        let names = value.as_array().ok_or_else(|| fail(field.into(), "is not a list".into()))?;
        let name = |(i, name): (usize, &Value)| {
            let place = || format!("{field}[{i}]");
            let file = name.as_str().ok_or_else(|| fail(place(), "is not a string".into()))?;
            let file = without_dots(&with_ending(path.parent().unwrap_or(Path::new(".")), file));
            let missing = || fail(place(), format!("no frame has the file {}", file.display()));
            known.contains(&file).then_some(()).ok_or_else(missing)?;
            Ok(file)
        };
        names.iter().enumerate().map(name).collect()
    };
    let (train, val, test) = (list("train_filenames")?, list("val_filenames")?, list("test_filenames")?);
    if train.is_empty() && val.is_empty() && test.is_empty() {
        return Ok(());
    }
    let held_out = if test.is_empty() { &val } else { &test };
    images.retain_mut(|image| {
        let file = without_dots(&image.file);
        image.split = match (held_out.contains(&file), train.is_empty()) {
            (true, _) => Some(Split::Test),
            (false, true) => (!val.contains(&file)).then_some(Split::Train),
            (false, false) if train.contains(&file) => Some(Split::Train),
            (false, false) => held_out.is_empty().then_some(Split::Test),
        };
        image.split.is_some()
    });
    if !images.iter().any(|i| i.split == Some(Split::Train)) {
        let error = IoError::new(path, "its lists of filenames leave no view to train on");
        return Err(error.advise("a view for test or validation is never trained on"));
    }
    Ok(())
}

/// A field that is there, and not null.
fn present<'v>(value: &'v Value, field: &str) -> Option<&'v Value> {
    value.get(field).filter(|value| !value.is_null())
}

struct Frame<'a> {
    root: &'a Value,
    frame: &'a Value,
    name: String,
    path: &'a Path,
}

impl Frame<'_> {
    fn error(&self, field: &str, what: impl Into<String>) -> IoError {
        IoError::new(self.path, what).at(Place::Field(format!("{}.{field}", self.name)))
    }

    /// The frame if it has any of these fields, else the file. Otherwise a field of the file would be taken for the lens of
    /// a frame that says the same with another field.
    fn level(&self, fields: &[&str]) -> &Value {
        if fields.iter().any(|field| present(self.frame, field).is_some()) { self.frame } else { self.root }
    }

    /// A field of the frame, or else of the file.
    fn get(&self, field: &str) -> Option<&Value> {
        present(self.level(&[field]), field)
    }

    fn number(&self, field: &str) -> Result<Option<f64>, IoError> {
        self.number_of(self.level(&[field]), field)
    }

    /// A number of the frame or of the file, which `level` is.
    fn number_of(&self, level: &Value, field: &str) -> Result<Option<f64>, IoError> {
        let Some(value) = present(level, field) else { return Ok(None) };
        value.as_f64().map(Some).ok_or_else(|| self.error(field, "is not a number"))
    }

    fn read(&self, folder: &Path) -> Result<PosedImage, IoError> {
        let file =
            self.frame.get("file_path").and_then(Value::as_str).ok_or_else(|| self.error("file_path", "is missing"))?;
        let file = with_ending(folder, file);
        if let Some(model) = self.camera_model()
            && !["PINHOLE", "SIMPLE_PINHOLE", "OPENCV", "RADIAL", "SIMPLE_RADIAL", FISHEYE].contains(&model)
        {
            let advice = if model.starts_with("EQUIRECT") || model == "PANORAMA" { CUT_PANORAMA } else { UNDISTORT };
            return Err(self.error("camera_model", format!("{model} is not supported")).advise(advice));
        }
        for lens in OTHER_LENSES {
            if self.get(lens).is_some_and(|v| *v != Value::Bool(false)) {
                let is_panorama = ["latlong", "equirectangular"].contains(&lens);
                let advice = if is_panorama { CUT_PANORAMA } else { UNDISTORT };
                return Err(self.error(lens, "such lenses are not supported").advise(advice));
            }
        }
        let distortion = self.distortion()?;
        let (width, height) = self.size(&folder.join(&file))?;
        let (w, h) = (f64::from(width), f64::from(height));
        let (fx, fy) = self.focal(w, h)?;
        let (view_from_world, note) = self.view_from_world()?;
        let note = note.map(|note| format!("{}: {}.transform_matrix: {note}", self.path.display(), self.name));
        let camera = Camera {
            name: stem(&file),
            width,
            height,
            fx,
            fy,
            cx: self.number("cx")?.unwrap_or(0.5 * w),
            cy: self.number("cy")?.unwrap_or(0.5 * h),
            view_from_world,
        };
        camera.validate().map_err(|e| IoError::new(self.path, e.to_string()).at(Place::Field(self.name.clone())))?;
        let mask = match present(self.frame, "mask_path") {
            Some(value) => Some(value.as_str().ok_or_else(|| self.error("mask_path", "is not a string"))?.to_owned()),
            None => None,
        };
        Ok(PosedImage { camera, file, distortion, mask, split: None, note })
    }

    /// Focal lengths of a picture of the given width and height, pixels.
    fn focal(&self, w: f64, h: f64) -> Result<(f64, f64), IoError> {
        let level = self.level(&FOCAL);
        let [fl_x, fl_y, angle_x, angle_y] = FOCAL.map(|field| self.number_of(level, field));
        let (fl_x, fl_y, angle_x, angle_y) = (fl_x?, fl_y?, angle_x?, angle_y?);
        let from_angle = |angle: f64, side: f64| 0.5 * side / (0.5 * angle).tan();
        let fx = match (fl_x, angle_x) {
            (Some(f), _) => f,
            (None, Some(angle)) => from_angle(angle, w),
            (None, None) => return Err(self.error("fl_x", "is missing, and so is camera_angle_x")),
        };
        let fy = match (fl_y, angle_y, fl_x) {
            (Some(f), _, _) => f,
            (None, Some(angle), None) => from_angle(angle, h),
            _ => fx,
        };
        Ok((fx, fy))
    }

    fn camera_model(&self) -> Option<&str> {
        present(self.level(&KIND), "camera_model").and_then(Value::as_str)
    }

    /// True for OpenCV's fisheye model, as nerfstudio and instant-ngp name it.
    fn is_fisheye(&self) -> bool {
        self.camera_model() == Some(FISHEYE) || present(self.level(&KIND), "is_fisheye") == Some(&Value::Bool(true))
    }

    /// The terms k1 to k3, p1 and p2 (of a fisheye lens k1 to k4) as fields, or as nerfstudio's list of k1, k2, k3, k4, p1, p2.
    fn distortion(&self) -> Result<Option<Distortion>, IoError> {
        const BEYOND: &str = "distortion beyond k1 k2 k3 p1 p2 is not supported";
        let level = self.level(&DISTORTION);
        for term in ["k4", "k5", "k6"] {
            if (term, self.is_fisheye()) == ("k4", true) {
                continue;
            }
            if self.number_of(level, term)?.is_some_and(|v| v != 0.0) {
                return Err(self.error(term, BEYOND).advise(UNDISTORT));
            }
        }
        let Some(list) = present(level, TERMS) else {
            let term = |name: &str| self.number_of(level, name).map(|value| value.unwrap_or(0.0));
            let [k1, k2, k3, p1, p2] = ["k1", "k2", "k3", "p1", "p2"].map(term);
            let (k1, k2, k3, p1, p2) = (k1?, k2?, k3?, p1?, p2?);
            if self.is_fisheye() {
                return Ok(Some(fisheye([k1, k2, k3, term("k4")?])));
            }
            return Ok(Distortion { k1, k2, p1, p2, k3, fisheye: None }.if_any());
        };
        let terms: Vec<f64> =
            serde_json::from_value(list.clone()).map_err(|_| self.error(TERMS, "is not a list of numbers"))?;
        let &[k1, k2, k3, k4, p1, p2] = terms.as_slice() else {
            let what = format!("has {} numbers, not the six k1 k2 k3 k4 p1 p2", terms.len());
            return Err(self.error(TERMS, what).advise("give the terms as fields k1, k2, k3, p1, p2"));
        };
        if self.is_fisheye() {
            return Ok(Some(fisheye([k1, k2, k3, k4])));
        }
        if k4 != 0.0 {
            return Err(self.error(TERMS, BEYOND).advise(UNDISTORT));
        }
        Ok(Distortion { k1, k2, p1, p2, k3, fisheye: None }.if_any())
    }

    fn size(&self, image: &Path) -> Result<(u32, u32), IoError> {
        if let (Some(w), Some(h)) = (self.number("w")?, self.number("h")?) {
            let whole = |v: f64| v >= 1.0 && v <= f64::from(u32::MAX) && v.fract() == 0.0;
            if !(whole(w) && whole(h)) {
                return Err(self.error("w", format!("the image size {w}x{h} is not of whole pixels")));
            }
            return Ok((w as u32, h as u32));
        }
        image::ImageReader::open(image)
            .and_then(|r| r.with_guessed_format())
            .map_err(|e| IoError::os(image, "the file gives no w and h, and the image cannot be read", &e))?
            .into_dimensions()
            .map_err(|e| {
                IoError::new(image, format!("the file gives no w and h, and the image's size cannot be read: {e}"))
                    .advise("put w and h, its size in pixels, into transforms.json")
            })
    }

    /// The pose, and a note if its axes had another length than 1.
    fn view_from_world(&self) -> Result<([[f64; 4]; 4], Option<String>), IoError> {
        const FIELD: &str = "transform_matrix";
        let value = self.frame.get(FIELD).ok_or_else(|| self.error(FIELD, "is missing"))?;
        let rows: Vec<[f64; 4]> = serde_json::from_value(value.clone())
            .map_err(|e| self.error(FIELD, format!("is not a 4x4 matrix: {e}")))?;
        // Some tools omit the last row.
        let [a, b, c, ..] = rows.as_slice() else {
            return Err(self.error(FIELD, "is not a 4x4 matrix"));
        };
        let near = |last: &[f64; 4]| last.iter().zip([0.0, 0.0, 0.0, 1.0]).all(|(v, want)| (v - want).abs() < 1e-6);
        if rows.get(3).is_some_and(|last| !near(last)) || rows.len() > 4 {
            return Err(self.error(FIELD, "is not a rigid transform: its last row is not 0 0 0 1"));
        }
        let [right, up, back, position] = std::array::from_fn(|i| DVec3::new(a[i], b[i], c[i]));
        let (axes, note) = rotation_of([right, up, back]).map_err(|what| self.error(FIELD, what))?;
        // OpenGL's camera looks along -z with y up: its y and z axes are negated.
        let view_from_world = DMat3::from_cols(axes[0], -axes[1], -axes[2]).transpose();
        Ok((rigid_rows(view_from_world, -(view_from_world * position)), note))
    }
}

/// Axes that are this far from unit length or right angles were rounded, to three decimals at worst.
const ROUNDED_AXES: f64 = 5e-3;

/// The axes of a camera as a rotation, to the last bit where they are one; and a note if they had another length.
///
/// # Errors
/// The text says what is wrong with the axes.
fn rotation_of(axes: [DVec3; 3]) -> Result<([DVec3; 3], Option<String>), String> {
    let lengths = axes.map(|axis| axis.length());
    let length = lengths.iter().sum::<f64>() / 3.0;
    if !(length.is_finite() && lengths.iter().all(|&l| l > 1e-9)) {
        return Err("is singular".into());
    }
    if lengths.iter().any(|l| (l / length - 1.0).abs() > ROUNDED_AXES) {
        let [x, y, z] = lengths;
        return Err(format!(
            "is not a rigid transform: its axes have the lengths {x:.3}, {y:.3} and {z:.3}; apply the camera's scale"
        ));
    }
    let units = axes.map(|axis| axis / length);
    let [x, y, z] = units;
    if [x.dot(y), y.dot(z), z.dot(x)].iter().any(|cosine| cosine.abs() > ROUNDED_AXES) {
        return Err("is not a rigid transform: its axes are not at right angles".into());
    }
    if x.cross(y).dot(z) < 0.0 {
        return Err("is not a rigid transform: it mirrors".into());
    }
    if lengths.iter().all(|l| (l - 1.0).abs() < 1e-6) {
        return Ok((axes, None));
    }
    // The rotation nearest to the axes, after a few Newton steps for the polar decomposition.
    let mut rotation = DMat3::from_cols(x, y, z);
    for _ in 0..4 {
        rotation = (rotation + rotation.inverse().transpose()) * 0.5;
    }
    let note = ((length - 1.0).abs() > ROUNDED_AXES)
        .then(|| format!("its axes have the length {length:.3}, which counts as 1: is the camera's scale applied?"));
    Ok(([rotation.x_axis, rotation.y_axis, rotation.z_axis], note))
}

/// `file`, or with the first of [`ENDINGS`] for which an image exists if it has no image extension itself; see
/// [`file_in`] for backslashes.
fn with_ending(folder: &Path, file: &str) -> String {
    let file = file_in(folder, file);
    let known = Path::new(&file).extension().is_some_and(|e| ENDINGS.contains(&&*e.to_string_lossy()));
    if known || folder.join(&file).is_file() {
        return file;
    }
    let candidates = ENDINGS.iter().map(|e| format!("{file}.{e}"));
    candidates.into_iter().find(|c| folder.join(c).is_file()).unwrap_or_else(|| format!("{file}.png"))
}

/// The transforms files of a Blender dataset: those for training and, if there is one, those that are held out, of
/// `transforms_test.json` or else of `transforms_val.json`.
pub(crate) fn blender_files(dataset: &Path) -> Option<(PathBuf, Option<PathBuf>)> {
    let file = |name: &str| Some(dataset.join(name)).filter(|path| path.is_file());
    let held_out = || file("transforms_test.json").or_else(|| file("transforms_val.json"));
    Some((file("transforms_train.json")?, held_out()))
}

/// The point cloud that a transforms file names as `ply_file_path`.
pub(crate) fn named_point_file(transforms: &Path) -> Result<Option<PathBuf>, IoError> {
    const FIELD: &str = "ply_file_path";
    let folder = transforms.parent().unwrap_or(Path::new("."));
    let root = parse_json(&read_bytes(transforms)?, transforms)?;
    let Some(value) = present(&root, FIELD) else { return Ok(None) };
    let fail = |what: String| IoError::new(transforms, what).at(Place::Field(FIELD.into()));
    let name = value.as_str().ok_or_else(|| fail("is not a string".into()))?;
    let named = folder.join(without_dots(&file_in(folder, name)));
    if !named.is_file() {
        let error = fail(format!("there is no file {}", named.display()));
        return Err(error.advise("copy it there, or remove the field"));
    }
    Ok(Some(named))
}

#[cfg(test)]
mod tests {
    use super::*;

    const POSE: &str = "[[1,0,0,1],[0,1,0,2],[0,0,1,3],[0,0,0,1]]";

    fn parse(text: &str) -> Result<Vec<PosedImage>, IoError> {
        parse_transforms(text.as_bytes(), Path::new("nowhere/transforms.json"))
    }

    #[test]
    fn frame_fields_win_and_axes_turn() -> Result<(), IoError> {
        let text = format!(
            r#"{{"w":20,"h":10,"fl_x":9,"k1":0.5,"frames":[{{"file_path":"i/a.jpg","transform_matrix":{POSE}}},
            {{"file_path":"./i/b","fl_x":8,"fl_y":7,"cx":3,"cy":4,"k1":0,"transform_matrix":{POSE}}}]}}"#
        );
        let out = parse(&text)?;
        let a = &out[0].camera;
        assert_eq!((a.fx, a.fy, a.cx, a.cy, a.name.as_str()), (9.0, 9.0, 10.0, 5.0, "a"));
        assert_eq!(a.view_from_world, [[1., 0., 0., -1.], [0., -1., 0., 2.], [0., 0., -1., 3.], [0., 0., 0., 1.]]);
        assert_eq!(out[0].distortion, Some(Distortion { k1: 0.5, ..Distortion::default() }));
        let b = &out[1].camera;
        assert_eq!((b.fx, b.fy, b.cx, b.cy, out[1].distortion), (8.0, 7.0, 3.0, 4.0, None));
        assert_eq!(out[1].file, "./i/b.png");
        let fisheye = format!(
            r#"{{"w":20,"h":10,"fl_x":9,"camera_model":"OPENCV_FISHEYE","k1":0.5,"k4":0.1,"frames":[{{"file_path":"a.jpg","transform_matrix":{POSE}}}]}}"#
        );
        assert_eq!(parse(&fisheye)?[0].distortion.and_then(|d| d.fisheye), Some([0.5, 0.0, 0.0, 0.1]));
        let text = format!(
            r#"{{"w":20,"h":10,"fl_x":9,"k3":0.25,"frames":[{{"file_path":"i\\j\\a.jpg","transform_matrix":{POSE}}}]}}"#
        );
        let out = parse(&text)?;
        assert_eq!(out[0].distortion, Some(Distortion { k3: 0.25, ..Distortion::default() }));
        assert_eq!((out[0].file.as_str(), out[0].camera.name.as_str()), ("i/j/a.jpg", "a"));
        Ok(())
    }

    /// The camera and distortion of a frame with its own fields, in a file with others.
    fn lens(root: &str, frame: &str) -> Result<PosedImage, IoError> {
        let text =
            format!(r#"{{"w":20,"h":10,{root},"frames":[{{"file_path":"a.png",{frame},"transform_matrix":{POSE}}}]}}"#);
        parse(&text)?.pop().ok_or_else(|| IoError::new(Path::new("x"), "no frame"))
    }

    /// What a frame says with one field is not lost to what the file says with another.
    #[test]
    fn a_frame_with_a_lens_of_its_own_has_nothing_of_the_files() -> Result<(), IoError> {
        let right_angle = format!(r#""camera_angle_x":{}"#, std::f64::consts::FRAC_PI_2);
        let own = lens(r#""fl_x":9,"fl_y":8"#, &right_angle)?;
        assert!((own.camera.fx - 10.0).abs() < 1e-9 && own.camera.fy == own.camera.fx, "{:?}", own.camera);
        let own = lens(r#""fl_x":9,"fl_y":8"#, r#""fl_x":7"#)?;
        assert_eq!((own.camera.fx, own.camera.fy), (7.0, 7.0));
        let k1 = |k1: f64| Some(Distortion { k1, ..Distortion::default() });
        let list = r#""fl_x":9,"distortion_params":[0.5,0,0,0,0,0]"#;
        assert_eq!(lens(list, r#""cx":9"#)?.distortion, k1(0.5));
        assert_eq!(lens(list, r#""k1":0.25"#)?.distortion, k1(0.25));
        assert_eq!(
            lens(r#""fl_x":9,"k1":0.5,"p1":0.5"#, r#""distortion_params":[0.25,0,0,0,0,0]"#)?.distortion,
            k1(0.25)
        );
        // Neither the kind of lens nor a term that only another kind has.
        let fisheye = r#""fl_x":9,"is_fisheye":true,"k1":0.5,"k4":0.1"#;
        assert_eq!(lens(fisheye, r#""camera_model":"OPENCV","k1":0.25"#)?.distortion, k1(0.25));
        assert!(
            lens(r#""fl_x":9,"camera_model":"OPENCV""#, r#""is_fisheye":true"#)?
                .distortion
                .is_some_and(|d| d.fisheye.is_some())
        );
        Ok(())
    }

    #[test]
    fn null_is_a_field_that_is_not_there() -> Result<(), IoError> {
        let own =
            lens(r#""fl_x":9,"fl_y":8,"k1":0.5,"cx":3"#, r#""fl_x":null,"fl_y":null,"k1":null,"cx":null,"cy":null"#)?;
        assert_eq!((own.camera.fx, own.camera.fy, own.camera.cx, own.camera.cy), (9.0, 8.0, 3.0, 5.0));
        assert_eq!(own.distortion, Some(Distortion { k1: 0.5, ..Distortion::default() }));
        assert!(lens(r#""fl_x":null"#, r#""cx":1"#).is_err_and(|e| e.to_string().contains("fl_x: is missing")));
        Ok(())
    }

    #[test]
    fn blender_files_take_the_size_from_the_image() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        image::GrayImage::new(40, 30).save(folder.path().join("r_0.png"))?;
        let text = format!(
            r#"{{"camera_angle_x":1.5707963267948966,"frames":[{{"file_path":"./r_0","transform_matrix":{POSE}}}]}}"#
        );
        let out = parse_transforms(text.as_bytes(), &folder.path().join("transforms_train.json"))?;
        let camera = &out[0].camera;
        assert_eq!((camera.width, camera.height, camera.cx, camera.name.as_str()), (40, 30, 20.0, "r_0"));
        assert!((camera.fx - 20.0).abs() < 1e-9 && camera.fx == camera.fy);
        Ok(())
    }

    #[test]
    fn errors_name_the_field() {
        let text = |json: &str| parse(json).err().map(|e| e.to_string()).unwrap_or_default();
        assert!(text("{}").contains("frames"));
        let frame = |rest: &str| format!(r#"{{"w":2,"h":2,"fl_x":1,"frames":[{{"file_path":"a.png",{rest}}}]}}"#);
        assert!(text(&frame(r#""transform_matrix":[[1]]"#)).contains("frames[0].transform_matrix"));
        assert!(text(&frame(r#""transform_matrix":[[0,0,0,0],[0,0,0,0],[0,0,0,0],[0,0,0,1]]"#)).contains("singular"));
        assert!(text(&frame(r#""transform_matrix":[[2,0,0,0],[0,1,0,0],[0,0,2,0],[0,0,0,1]]"#)).contains("rigid"));
        assert!(
            text(&frame(&format!(r#""camera_model":"THIN_PRISM_FISHEYE","transform_matrix":{POSE}"#)))
                .contains("camera_model")
        );
        assert!(text(&frame(&format!(r#""w":"x","transform_matrix":{POSE}"#))).contains("frames[0].w"));
        let lens = |lens: &str| text(&frame(&format!(r#"{lens},"transform_matrix":{POSE}"#)));
        for (field, value) in [("orthographic", "true"), ("k4", "0.1"), ("rolling_shutter", "[0,0,0,1]")] {
            let error = lens(&format!(r#""{field}":{value}"#));
            assert!(error.contains(&format!("frames[0].{field}")) && error.contains("undistort"), "{error}");
        }
        assert_eq!(lens(r#""is_fisheye":false,"latlong":null,"k4":0"#), "");
        assert!(lens(r#""latlong":true"#).contains("perspective views"));
        let error = lens(r#""fl_x":0"#);
        assert!(error.contains("frames[0]: ") && error.contains("positive"), "{error}");
    }
}
