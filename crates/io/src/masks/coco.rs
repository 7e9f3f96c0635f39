//! COCO files: `images`, `annotations` with a `segmentation` each, and `categories`.
//!
//! An annotation is one object in one photo, and its id is its own. Which object of the other photos it is stands in
//! `track_id` or `instance_id`, or in one of these of its `attributes`, as programs for video write them.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use serde_json::Value;

use crate::dataset::{shared_folders, without_dots};
use crate::error::{IoError, Place};
use crate::json::parse_record;

use super::drawn::{DrawnMasks, DrawnPhoto};
use super::ids::{Seen, number};
use super::polygon::{self, Polygon};
use super::runs::Runs;
use super::shape::Shape;

#[derive(Deserialize)]
#[serde(expecting = "a COCO file: an object with images, annotations and categories")]
struct CocoFile {
    images: Vec<ImageFields>,
    annotations: Vec<Annotation>,
    #[serde(default)]
    categories: Vec<CategoryFields>,
}

#[derive(Deserialize)]
struct ImageFields {
    id: Value,
    file_name: String,
    width: Option<u32>,
    height: Option<u32>,
}

#[derive(Deserialize)]
struct CategoryFields {
    id: Value,
    name: String,
}

/// One object in one photo.
#[derive(Deserialize)]
#[serde(try_from = "Value")]
struct Annotation {
    /// Its name in messages.
    name: String,
    image: String,
    category: Option<String>,
    track: Option<String>,
    /// `None` if it has only a box.
    shape: Option<Shape>,
}

impl TryFrom<Value> for Annotation {
    type Error = String;

    fn try_from(mut value: Value) -> Result<Self, String> {
        let name = value.get("id").and_then(text_of_id).map_or("an annotation".into(), |id| format!("annotation {id}"));
        let image = value.get("image_id").and_then(text_of_id).ok_or_else(|| format!("{name} has no image_id"))?;
        let category = value.get("category_id").and_then(text_of_id);
        let tracks = ["track_id", "instance_id"];
        let of = |value: &Value| tracks.iter().find_map(|key| value.get(key).and_then(text_of_id));
        let track = of(&value).or_else(|| of(value.get("attributes")?));
        let segmentation = value.get_mut("segmentation").map(Value::take).unwrap_or_default();
        let shape = shape_of(segmentation).map_err(|what| format!("{name}, segmentation: {what}"))?;
        Ok(Self { name, image, category, track, shape })
    }
}

/// An id, a number or a text, as text.
fn text_of_id(value: &Value) -> Option<String> {
    match value {
        Value::String(text) => Some(text.clone()),
        Value::Number(number) => match number.as_f64() {
            // Some programs write whole numbers as 3.0.
            Some(v) if number.is_f64() && v.fract() == 0.0 => Some(format!("{v:.0}")),
            _ => Some(number.to_string()),
        },
        _ => None,
    }
}

/// The shape of a segmentation; `None` if it is empty.
fn shape_of(segmentation: Value) -> Result<Option<Shape>, String> {
    match segmentation {
        Value::Null => Ok(None),
        Value::Array(list) if list.is_empty() => Ok(None),
        // One polygon that is not in a list.
        Value::Array(list) if list[0].is_number() => Ok(Some(Shape::Polygons(vec![polygon_of(&list)?]))),
        Value::Array(lists) => {
            let polygon = |list: &Value| polygon_of(list.as_array().ok_or("is no list of polygons")?);
            Ok(Some(Shape::Polygons(lists.iter().map(polygon).collect::<Result<_, String>>()?)))
        }
        Value::Object(fields) => {
            let size = fields.get("size").and_then(Value::as_array).map(Vec::as_slice);
            let size = match size {
                Some([height, width]) => side_of(width).zip(side_of(height)),
                _ => None,
            };
            let size = size.ok_or("has no size of [height, width]")?;
            let runs = match fields.get("counts") {
                Some(Value::String(text)) => Runs::of_text(text, size),
                Some(Value::Array(list)) => {
                    let counts = list.iter().map(side_of).collect::<Option<Vec<u32>>>();
                    Runs::new(counts.ok_or("has a count that is no whole number")?, size)
                }
                _ => Err("has no counts, a list or a text".into()),
            };
            runs.map(|runs| Some(Shape::Runs(runs)))
        }
        _ => Err("is neither a list of polygons nor an object with size and counts".into()),
    }
}

fn side_of(value: &Value) -> Option<u32> {
    value.as_u64().and_then(|v| u32::try_from(v).ok())
}

/// A polygon from x and y of its corners in turn.
fn polygon_of(list: &[Value]) -> Result<Polygon, String> {
    let (corners, []) = list.as_chunks::<2>() else {
        return Err(format!("has {} numbers, which are no pairs", list.len()));
    };
    let corner = |[x, y]: &[Value; 2]| Some([x.as_f64()?, y.as_f64()?]);
    let polygon =
        corners.iter().map(corner).collect::<Option<Polygon>>().ok_or("has a coordinate that is no number")?;
    polygon::check(&polygon)?;
    Ok(polygon)
}

/// Parses the bytes of a COCO file; `path` is only used in messages.
///
/// # Errors
/// It is not JSON, or an image or an annotation lacks something, names something that is not there, or has another form than
/// COCO's; some annotations have a track_id and others none; or none has a segmentation.
pub fn parse_coco(bytes: &[u8], path: &Path) -> Result<DrawnMasks, IoError> {
    let file: CocoFile = parse_record(bytes, path)?;
    let fail = |what: String| IoError::new(path, what);
    let mut images = BTreeMap::new();
    for (i, image) in file.images.iter().enumerate() {
        let at = |what: &str| fail(what.into()).at(Place::Field(format!("images[{i}]")));
        let id = text_of_id(&image.id).ok_or_else(|| at("its id is neither a number nor a text"))?;
        if images.insert(id, i).is_some() {
            return Err(at("has the id of an earlier image").advise("give every image an id of its own"));
        }
    }
    let names: BTreeMap<String, String> =
        file.categories.into_iter().filter_map(|c| Some((text_of_id(&c.id)?, c.name))).collect();
    let mut seen = vec![Vec::new(); file.images.len()];
    let mut shapes: Vec<Vec<Shape>> = vec![Vec::new(); file.images.len()];
    let (all, mut without_shape, mut without_track) = (file.annotations.len(), 0, None);
    for annotation in file.annotations {
        let at = |what: String| fail(what).at(Place::Field(annotation.name.clone()));
        let image = images.get(&annotation.image).copied();
        let image = image.ok_or_else(|| at(format!("images has no image {}", annotation.image)))?;
        let named = |id: &String| names.get(id).cloned().ok_or_else(|| at(format!("categories has no category {id}")));
        let category = annotation.category.as_ref().filter(|_| !names.is_empty()).map(named).transpose()?;
        let Some(shape) = annotation.shape else {
            without_shape += 1;
            continue;
        };
        if annotation.track.is_none() {
            without_track.get_or_insert(annotation.name);
        }
        seen[image].push(Seen { object: annotation.track, category });
        shapes[image].push(shape);
    }
    if without_shape == all {
        let error = fail("none of its annotations has a segmentation".into());
        return Err(error.advise("export masks or polygons; boxes alone are for --boxes, as boxes.json"));
    }
    let notes = notes(path, &seen, without_track, (without_shape, all))?;
    let numbered =
        number(&seen, |track| track.parse().ok()).map_err(|what| fail(what).advise("give each object a track_id"))?;
    let objects = numbered.ids.into_iter().zip(shapes).map(|(ids, shapes)| ids.into_iter().zip(shapes).collect());
    let photos = named_photos(file.images, path).zip(objects).map(|(photo, objects)| DrawnPhoto { objects, ..photo });
    DrawnMasks::new(photos.collect(), numbered.categories, notes)
}

/// What a user should know; an error if only some objects are followed from photo to photo.
fn notes(
    path: &Path,
    seen: &[Vec<Seen>],
    without_track: Option<String>,
    (without_shape, all): (usize, usize),
) -> Result<Vec<String>, IoError> {
    let mut notes = Vec::new();
    if without_shape > 0 {
        let path = path.display();
        notes.push(format!("{path}: {without_shape} of {all} annotations have no segmentation and are not used"));
    }
    let Some(name) = without_track else { return Ok(notes) };
    if seen.iter().flatten().any(|seen| seen.object.is_some()) {
        let error = IoError::new(path, "has no track_id, and others have one").at(Place::Field(name));
        return Err(error.advise("give all annotations of an object the same track_id, or remove them all"));
    }
    notes.push(format!(
        "{}: no annotation has a track_id, so every photo's ids are its own: which masks show one object is found from \
         the trained cloud; to say it yourself, give each object one track_id in all photos",
        path.display()
    ));
    Ok(notes)
}

/// The photos without their objects. Folders that all share are left out, as they are from the names of views.
fn named_photos(images: Vec<ImageFields>, path: &Path) -> impl Iterator<Item = DrawnPhoto> {
    let names: Vec<PathBuf> = images.iter().map(|image| without_dots(&image.file_name.replace('\\', "/"))).collect();
    let shared = shared_folders(names.iter().map(PathBuf::as_path));
    images.into_iter().zip(names).map(move |(image, name)| DrawnPhoto {
        file: path.into(),
        name: name.components().skip(shared).collect(),
        given: name,
        size: image.width.zip(image.height),
        objects: Vec::new(),
    })
}
