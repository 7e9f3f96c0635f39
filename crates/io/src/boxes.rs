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

/// Boxes in photos under the names of views: a photo may be named with its ending, too.
pub fn with_view_names(mut boxes: Boxes, views: &[View]) -> Boxes {
    for view in views {
        let Some(photo) = view.image_path.file_name().map(|name| name.to_string_lossy().into_owned()) else { continue };
        let is_view = |name: &str| views.iter().any(|view| view.camera.name == name);
        let named = |view: &&View| view.image_path.file_name().is_some_and(|name| name.to_string_lossy() == photo);
        if views.iter().filter(named).count() == 1
            && !boxes.views.contains_key(&view.camera.name)
            && !is_view(&photo)
            && let Some(list) = boxes.views.remove(&photo)
        {
            boxes.views.insert(view.camera.name.clone(), list);
        }
    }
    boxes
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
