//! `boxes.json`: boxes around objects, drawn by a user, detected in photos, or found by shape.
//!
//! ```json
//! {"objects": [{"id": 1, "category": "car", "center": [0, 0, 1], "size": [2, 4, 1.5], "rotation": [1, 0, 0, 0]}],
//!  "views": {"view_000": [{"box_px": [10, 20, 110.5, 80], "category": "car", "score": 0.8, "id": 1}]}}
//! ```
//!
//! `objects` are boxes in the world: centre, edge lengths (world units), and the rotation from the box's axes to the
//! world's as a quaternion (w, x, y, z), the identity if it is omitted. `views` are rectangles in photos: left, top,
//! right, bottom in pixels of the photo. `category`, `score` and, in photos, `id` are optional. Unknown keys are
//! ignored.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use glam::{DQuat, DVec3};
use serde::{Deserialize, Serialize};
use serde_json::Value;

use super::camera_file::parse_json;
use super::error::{IoError, Place};
use super::groups::MAX_INSTANCE_ID;
use super::json::write_json;
use super::masks::names::ends_of_path;
use super::{View, read_bytes};
use instgs_vk::scene::{Boxes, ObjectBox, ViewBox};

#[derive(Deserialize, Serialize)]
struct BoxesFields {
    #[serde(default)]
    objects: Vec<ObjectFields>,
    #[serde(default)]
    views: BTreeMap<String, Vec<ViewFields>>,
}

#[derive(Deserialize, Serialize)]
struct ObjectFields {
    id: u32,
    #[serde(skip_serializing_if = "Option::is_none")]
    category: Option<String>,
    center: [f64; 3],
    size: [f64; 3],
    /// Quaternion (w, x, y, z)
    #[serde(default = "no_rotation")]
    rotation: [f64; 4],
}

#[derive(Deserialize, Serialize)]
struct ViewFields {
    #[serde(skip_serializing_if = "Option::is_none")]
    id: Option<u32>,
    #[serde(skip_serializing_if = "Option::is_none")]
    category: Option<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    score: Option<f64>,
    box_px: [f64; 4],
}

fn no_rotation() -> [f64; 4] {
    [1.0, 0.0, 0.0, 0.0]
}

/// Reads a file of boxes. Quaternions may have any length but 0.
///
/// # Errors
/// The file is missing or not JSON; an id is outside 1..=65535, or occurs twice in the world or in one photo; an edge
/// is not above 0; a rectangle has no area; a score is outside 0..=1; or a value is not finite. The error names the
/// box.
pub fn read_boxes(path: &Path) -> Result<Boxes, IoError> {
    let value = parse_json(&read_bytes(path)?, path)?;
    // serde would accept a list for a struct, too.
    if !value.is_object() {
        return Err(not_boxes(path, &value));
    }
    if value.get("objects").is_none() && value.get("views").is_none() {
        return Err(not_boxes(path, &value));
    }
    let fields: BoxesFields = serde_json::from_value(value).map_err(|e| {
        IoError::new(path, format!("is not a boxes file: {e}")).advise("`instgs-vk find` writes such files")
    })?;
    let mut objects = Vec::with_capacity(fields.objects.len());
    for (i, fields) in fields.objects.into_iter().enumerate() {
        let at = Place::Field(format!("objects[{i}]"));
        objects.push(object_of(fields).map_err(|what| IoError::new(path, what).at(at))?);
    }
    let view_of = |f: ViewFields| ViewBox { id: f.id, category: f.category, score: f.score, box_px: f.box_px };
    let views = fields.views.into_iter().map(|(name, list)| (name, list.into_iter().map(view_of).collect()));
    let boxes = Boxes { objects, views: views.collect() };
    check(&boxes, path)?;
    Ok(boxes)
}

/// The error for a JSON file without boxes; it calls files of other programs by their names.
fn not_boxes(path: &Path, value: &Value) -> IoError {
    let has = |key: &str| value.get(key).is_some();
    let (kind, advice) = if has("annotations") && has("images") {
        (" (it is a COCO file)", "give one rectangle per object as views.NAME[].box_px: left, top, right, bottom")
    } else if has("shapes") && has("imagePath") {
        (" (it is a labelme file)", "give its rectangles as views.NAME[].box_px: left, top, right, bottom")
    } else {
        (
            "",
            "its keys are objects, boxes in the world, and views, rectangles in photos; `instgs-vk find` writes such files",
        )
    };
    IoError::new(path, format!("is not a boxes file: it has neither objects nor views{kind}")).advise(advice)
}

/// Writes boxes. Checks the same as [`read_boxes`], so that the file can be read.
///
/// # Errors
/// A box that could not be read again, or a file that cannot be written.
pub fn write_boxes(path: &Path, boxes: &Boxes) -> Result<(), IoError> {
    check(boxes, path)?;
    let object = |o: &ObjectBox| {
        let q = o.world_from_box;
        let rotation = [q.w, q.x, q.y, q.z];
        let (center, size) = (o.center.to_array(), o.size.to_array());
        ObjectFields { id: o.id, category: o.category.clone(), center, size, rotation }
    };
    let in_view = |b: &ViewBox| ViewFields { id: b.id, category: b.category.clone(), score: b.score, box_px: b.box_px };
    let views = boxes.views.iter().map(|(name, list)| (name.clone(), list.iter().map(in_view).collect()));
    write_json(path, &BoxesFields { objects: boxes.objects.iter().map(object).collect(), views: views.collect() })
}

/// Boxes in photos under the names of views. A key may also be the name of a photo with its ending, if only one view has such a
/// photo, or the end of a photo's path with at least one folder, as views of several cameras are named (`back_006`) whose part in
/// a block is named without the folder (`006`): the rule by which masks are found, too.
pub fn with_view_names(mut boxes: Boxes, views: &[View]) -> Boxes {
    let taken: BTreeSet<&str> = views.iter().map(|view| view.camera.name.as_str()).collect();
    let mut of_other_name: BTreeMap<String, usize> = BTreeMap::new();
    for view in views {
        // A photo without an ending has equal names.
        let names: BTreeSet<String> = names_with_folder(view).into_iter().chain(file_name(view)).collect();
        names.into_iter().for_each(|name| *of_other_name.entry(name).or_default() += 1);
    }
    for view in views {
        let name = &view.camera.name;
        let is_of_this = |other: &String| of_other_name.get(other) == Some(&1) && !taken.contains(other.as_str());
        let mut others = names_with_folder(view);
        // The file's name alone says less than the view's own.
        if !boxes.views.contains_key(name) {
            others.extend(file_name(view));
        }
        let list = others.iter().filter(|other| is_of_this(other)).find_map(|other| boxes.views.remove(other));
        if let Some(list) = list {
            boxes.views.insert(name.clone(), list);
        }
    }
    boxes
}

/// The ends of a view's photo's path with a folder, the longest first, with `_` or `/` between their parts.
fn names_with_folder(view: &View) -> Vec<String> {
    ends_of_path(&view.image_path).into_iter().flat_map(|end| [end.replace('/', "_"), end]).collect()
}

/// The name of a view's photo, with its ending.
fn file_name(view: &View) -> Option<String> {
    view.image_path.file_name().map(|name| name.to_string_lossy().into_owned())
}

fn object_of(fields: ObjectFields) -> Result<ObjectBox, String> {
    let [w, x, y, z] = fields.rotation;
    let rotation = DQuat::from_xyzw(x, y, z, w);
    // The squared length must be neither 0 nor infinite.
    if !(1e-100..1e100).contains(&rotation.length()) {
        return Err(format!("has the rotation {:?}, which is not a rotation quaternion", fields.rotation));
    }
    Ok(ObjectBox {
        id: fields.id,
        category: fields.category,
        center: DVec3::from_array(fields.center),
        size: DVec3::from_array(fields.size),
        world_from_box: rotation.normalize(),
    })
}

/// Checks the rules for boxes in a file or in memory; the error names the box.
fn check(boxes: &Boxes, path: &Path) -> Result<(), IoError> {
    let mut ids = BTreeSet::new();
    for (i, object) in boxes.objects.iter().enumerate() {
        let fail = |what: String| Err(IoError::new(path, what).at(Place::Field(format!("objects[{i}]"))));
        check_id(object.id, &mut ids).or_else(fail)?;
        if !object.center.is_finite() {
            return fail(format!("has the center {}, which is not finite", object.center));
        }
        if !(object.size.is_finite() && object.size.cmpgt(DVec3::ZERO).all()) {
            return fail(format!("has the size {}: edge lengths must be above 0", object.size));
        }
    }
    for (name, list) in &boxes.views {
        let mut ids = BTreeSet::new();
        for (i, view_box) in list.iter().enumerate() {
            let fail = |what: String| Err(IoError::new(path, what).at(Place::Field(format!("views.{name}[{i}]"))));
            view_box.id.map_or(Ok(()), |id| check_id(id, &mut ids)).or_else(fail)?;
            let [left, top, right, bottom] = view_box.box_px;
            let is_finite = view_box.box_px.iter().all(|v| v.is_finite());
            if !is_finite || left >= right || top >= bottom {
                return fail(format!("has the box_px {:?}: want left, top, right, bottom", view_box.box_px));
            }
            if let Some(score) = view_box.score.filter(|s| !(0.0..=1.0).contains(s)) {
                return fail(format!("has the score {score}, which is not from 0 to 1"));
            }
        }
    }
    Ok(())
}

fn check_id(id: u32, seen: &mut BTreeSet<u32>) -> Result<(), String> {
    if !(1..=MAX_INSTANCE_ID).contains(&id) {
        return Err(format!("has the id {id}: ids are those of masks, 1 to {MAX_INSTANCE_ID}"));
    }
    if !seen.insert(id) {
        return Err(format!("has the id {id} of an earlier box"));
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Split;
    use instgs_vk::scene::Camera;

    type Outcome = Result<(), Box<dyn std::error::Error>>;

    #[test]
    fn boxes_come_back() -> Outcome {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("boxes.json");
        let object = ObjectBox {
            id: 7,
            category: Some("a \"car\"".into()),
            center: DVec3::new(0.1, -2.0, 3e5),
            size: DVec3::new(1.0, 2.0, 0.5),
            world_from_box: DQuat::from_rotation_y(0.5),
        };
        let drawn = ViewBox { id: None, category: None, score: None, box_px: [-3.5, 0.0, 10.0, 0.25] };
        let found =
            ViewBox { id: Some(7), category: Some("car".into()), score: Some(0.5), box_px: [0.0, 0.0, 1.0, 1.0] };
        let views = [("a".to_owned(), vec![drawn.clone(), found, drawn]), ("b".to_owned(), vec![])];
        let boxes = Boxes { objects: vec![object], views: views.into() };
        write_boxes(&path, &boxes)?;
        let again = read_boxes(&path)?;
        assert_eq!(again.views, boxes.views);
        assert!(again.objects[0].world_from_box.angle_between(boxes.objects[0].world_from_box) < 1e-7);
        assert_eq!(again.objects[0].center, boxes.objects[0].center);
        std::fs::write(&path, r#"{"objects": [{"id": 1, "center": [0, 0, 1], "size": [2, 4, 1], "why": 1}]}"#)?;
        let short = read_boxes(&path)?;
        assert_eq!((short.objects[0].world_from_box, short.views.len()), (DQuat::IDENTITY, 0));
        Ok(())
    }

    /// Views of two cameras, as the whole data set names them and as a block with one of the cameras does.
    #[test]
    fn keys_are_found_by_the_end_of_the_photos_path() {
        let view = |name: &str, path: &str| View {
            camera: Camera {
                name: name.into(),
                ..Camera::look_at("", DVec3::NEG_Y, DVec3::ZERO, DVec3::Z, 0.8, (16, 8))
            },
            image_path: path.into(),
            split: Split::Train,
            distortion: None,
            mask_path: None,
        };
        let named = |keys: &[&str], views: &[View]| -> Vec<String> {
            let one = ViewBox { id: None, category: None, score: None, box_px: [0.0, 0.0, 4.0, 4.0] };
            let views_of_keys = keys.iter().map(|key| (key.to_string(), vec![one.clone()])).collect();
            let boxes = Boxes { views: views_of_keys, ..Boxes::default() };
            with_view_names(boxes, views).views.into_keys().collect()
        };
        let whole = [view("back_006", "d/images/back/006.png"), view("left_006", "d/images/left/006.png")];
        let block = [view("006", "b/block_00/../../d/images/back/006.png"), view("007", "../../d/images/back/007.png")];
        for key in ["back_006", "back_006.png", "back/006.png", "images/back/006", "006.png", "006"] {
            assert_eq!(named(&[key], &block), ["006"], "{key}");
        }
        assert_eq!(named(&["back_006", "left_006", "back_007"], &block), ["006", "007", "left_006"]);
        // In the whole, the file's name alone says nothing, and what is a view's own name stays.
        assert_eq!(named(&["006.png", "back_006"], &whole), ["006.png", "back_006"]);
        assert_eq!(named(&["back/006.png", "left_006.png"], &whole), ["back_006", "left_006"]);
        // Of two keys for one view the more exact one counts.
        assert_eq!(named(&["006.png", "back_006"], &block), ["006", "006.png"]);
        // A photo outside of folders has the name that the block gives another.
        assert_eq!(named(&["006", "back_006"], &block[..1]), ["006"]);
        // Two views with one end of the path: neither.
        let twins = [view("a_back_006", "a/back/006.png"), view("b_back_006", "b/back/006.png")];
        assert_eq!(named(&["back_006"], &twins), ["back_006"]);
    }

    #[test]
    fn bad_boxes_are_named() -> Outcome {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("boxes.json");
        for (text, want) in [
            ("[", "JSON"),
            ("[]", "not a boxes file"),
            (r#"{"objects": [{"id": 0, "center": [0, 0, 1], "size": [2, 4, 1]}]}"#, "objects[0]: has the id 0"),
            (r#"{"objects": [{"id": 1, "center": [0, 0, 1], "size": [2, 0, 1]}]}"#, "above 0"),
            (r#"{"objects": [{"id": 1, "center": [0, 0], "size": [2, 1, 1]}]}"#, "not a boxes file"),
            (
                r#"{"objects": [{"id": 1, "center": [0, 0, 1], "size": [2, 4, 1], "rotation": [0, 0, 0, 0]}]}"#,
                "not a rotation quaternion",
            ),
            (r#"{"views": {"a": [{"box_px": [2, 0, 1, 1]}]}}"#, "views.a[0]: has the box_px"),
            (r#"{"views": {"a": [{"box_px": [0, 0, 1, 1], "score": 2}]}}"#, "score 2"),
            (
                r#"{"views": {"a": [{"box_px": [0, 0, 1, 1], "id": 3}, {"box_px": [0, 0, 1, 1], "id": 3}]}}"#,
                "views.a[1]: has the id 3 of an earlier",
            ),
        ] {
            std::fs::write(&path, text)?;
            let text = read_boxes(&path).err().map(|e| e.to_string()).unwrap_or_default();
            assert!(text.contains(want), "{text} lacks {want}");
        }
        assert!(read_boxes(&folder.path().join("none.json")).is_err());
        Ok(())
    }
}
