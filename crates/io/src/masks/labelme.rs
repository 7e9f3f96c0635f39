//! labelme's files: one JSON per photo, with `shapes` that have a `label` and perhaps a `group_id`.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use base64::Engine;
use base64::prelude::BASE64_STANDARD;
use rayon::prelude::*;
use serde::Deserialize;
use serde_json::Value;

use crate::error::{IoError, Place};
use crate::json::parse_record;
use crate::mask_png::parse_mask;
use crate::read_bytes;

use super::drawn::{DrawnMasks, DrawnPhoto};
use super::ids::{Seen, number, without_number};
use super::polygon::{self, Polygon};
use super::shape::Shape;

#[derive(Deserialize)]
#[serde(rename_all = "camelCase", expecting = "a file of labelme: an object with shapes")]
struct LabelmeFile {
    shapes: Vec<ShapeFields>,
    image_path: Option<String>,
    image_width: Option<u32>,
    image_height: Option<u32>,
}

#[derive(Deserialize)]
struct ShapeFields {
    label: String,
    #[serde(default)]
    group_id: Value,
    shape_type: Option<String>,
    points: Polygon,
    mask: Option<String>,
}

/// The shapes of one photo.
pub(super) struct LabelmePhoto {
    photo: DrawnPhoto,
    /// Label and group of each shape.
    labels: Vec<(String, Option<String>)>,
    /// The photo, as the file names it.
    pub(super) image_path: Option<String>,
    /// Number of points and lines, which have no pixels.
    without_area: usize,
}

/// Reads files of labelme, whose names are those of their photos; `root` is their folder.
///
/// # Errors
/// The same errors as [`parse_labelme`], or more objects than ids.
pub(super) fn read_labelme(files: &[PathBuf], root: &Path) -> Result<(DrawnMasks, Vec<PathBuf>), IoError> {
    let read = |file: &PathBuf| parse_photo(&read_bytes(file)?, file, root);
    // Collected first, so that of several errors the first file's is always returned.
    let read: Vec<Result<LabelmePhoto, IoError>> = files.par_iter().map(read).collect();
    let photos = read.into_iter().collect::<Result<Vec<_>, IoError>>()?;
    let beside = |photo: &LabelmePhoto| {
        let name = PathBuf::from(photo.image_path.as_ref()?.replace('\\', "/"));
        Some(photo.photo.file.parent()?.join(name.file_name()?))
    };
    let named = photos.iter().filter_map(beside).collect();
    Ok((of_photos(photos, root)?, named))
}

/// Parses the bytes of the file of one photo; `path` is only used in messages and for the photo's name.
///
/// # Errors
/// It is not JSON, a shape has points that do not make its kind or a mask that is damaged, or the kind is unknown.
pub fn parse_labelme(bytes: &[u8], path: &Path) -> Result<DrawnMasks, IoError> {
    let root = path.parent().unwrap_or(path);
    of_photos(vec![parse_photo(bytes, path, root)?], root)
}

fn parse_photo(bytes: &[u8], path: &Path, root: &Path) -> Result<LabelmePhoto, IoError> {
    let file: LabelmeFile = parse_record(bytes, path)?;
    let name = path.strip_prefix(root).unwrap_or(path).to_path_buf();
    let size = file.image_width.zip(file.image_height);
    let mut photo = DrawnPhoto { file: path.into(), given: name.clone(), name, size, objects: Vec::new() };
    let (mut labels, mut without_area) = (Vec::new(), 0);
    for (i, fields) in file.shapes.into_iter().enumerate() {
        let label = (fields.label.clone(), text_of_group(&fields.group_id));
        let at = |what: String| IoError::new(path, what).at(Place::Field(format!("shapes[{i}] ({:?})", label.0)));
        match shape_of(fields, path).map_err(at)? {
            Some(shape) => {
                photo.objects.push((0, shape));
                labels.push(label);
            }
            None => without_area += 1,
        }
    }
    Ok(LabelmePhoto { photo, labels, image_path: file.image_path, without_area })
}

fn text_of_group(value: &Value) -> Option<String> {
    match value {
        Value::String(text) if !text.is_empty() => Some(text.clone()),
        Value::Number(number) => Some(number.to_string()),
        _ => None,
    }
}

/// The pixels of a shape; `None` for points and lines, which have none.
fn shape_of(fields: ShapeFields, path: &Path) -> Result<Option<Shape>, String> {
    polygon::check(&fields.points)?;
    let kind = fields.shape_type.as_deref().unwrap_or("polygon");
    match (kind, &fields.points[..]) {
        ("rectangle", &[[x0, y0], [x1, y1]]) => {
            Ok(Some(Shape::Polygons(vec![vec![[x0, y0], [x1, y0], [x1, y1], [x0, y1]]])))
        }
        ("polygon" | "rectangle" | "rotation" | "oriented_rectangle", [_, _, _, ..]) => {
            Ok(Some(Shape::Polygons(vec![fields.points])))
        }
        ("circle", &[center, rim]) => {
            let radius = (rim[0] - center[0]).hypot(rim[1] - center[1]);
            Ok(Some(Shape::Disk { center, radius }))
        }
        ("mask", &[corner, _]) => {
            let text = fields.mask.ok_or("is a mask without the field mask")?;
            let bytes = BASE64_STANDARD.decode(text.trim()).map_err(|e| format!("its mask is not base64: {e}"))?;
            let mask = parse_mask(&bytes, path).map_err(|e| e.what)?;
            // The corner is that of its first pixel; what is left of the picture cannot be drawn.
            let [x, y] = corner.map(|v| v.round());
            if x < 0.0 || y < 0.0 {
                return Err(format!("its mask begins at {x}, {y}, outside of the picture"));
            }
            Ok(Some(Shape::of_mask(&mask, (x as u32, y as u32))))
        }
        ("point" | "points" | "line" | "linestrip" | "line_strip" | "lines", _) => Ok(None),
        ("polygon" | "rectangle" | "rotation" | "oriented_rectangle" | "circle" | "mask", points) => {
            Err(format!("is a {kind} of {} points, which does not make one", points.len()))
        }
        _ => Err(format!("has the shape_type {kind:?}, which is none of polygon, rectangle, circle and mask")),
    }
}

/// Numbers the objects. An object is a label and its group, or a label alone if every photo has that at most once.
fn of_photos(photos: Vec<LabelmePhoto>, root: &Path) -> Result<DrawnMasks, IoError> {
    let twice = photos.iter().find_map(|photo| {
        let mut counts: BTreeMap<&str, usize> = BTreeMap::new();
        let alone = photo.labels.iter().filter(|(_, group)| group.is_none());
        alone.for_each(|(label, _)| *counts.entry(label).or_default() += 1);
        let (label, count) = counts.into_iter().find(|(_, count)| *count > 1)?;
        Some((label.to_owned(), count, photo.photo.file.clone()))
    });
    let seen_of = |(label, group): &(String, Option<String>)| {
        let kind = without_number(label);
        // Labels have no line breaks, so that no label is another with its group.
        let object = format!("{label}\n{}", group.as_deref().unwrap_or_default());
        let category = (!kind.is_empty()).then(|| kind.to_owned());
        Seen { object: twice.is_none().then_some(object), category }
    };
    let seen: Vec<Vec<Seen>> = photos.iter().map(|photo| photo.labels.iter().map(seen_of).collect()).collect();
    // Labels are sorted, so that ids are the same for the same folder.
    let numbered =
        number(&seen, |_| None).map_err(|what| IoError::new(root, what).advise("give objects fewer labels"))?;
    let mut notes = Vec::new();
    let without_area: usize = photos.iter().map(|photo| photo.without_area).sum();
    if without_area > 0 {
        notes.push(format!("{}: {without_area} points and lines have no pixels and are not used", root.display()));
    }
    notes.extend(twice.map(|(label, count, file)| {
        format!(
            "{}: has {count} shapes {label:?} without group_id, so every photo's ids are its own: which masks show one \
             object is found from the trained cloud; to say it yourself, give each object one group_id in all photos",
            file.display()
        )
    }));
    let with_ids = |(photo, ids): (LabelmePhoto, Vec<u16>)| {
        let shapes = photo.photo.objects.into_iter().map(|(_, shape)| shape);
        DrawnPhoto { objects: ids.into_iter().zip(shapes).collect(), ..photo.photo }
    };
    DrawnMasks::new(photos.into_iter().zip(numbered.ids).map(with_ids).collect(), numbered.categories, notes)
}
