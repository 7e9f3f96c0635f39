//! Boxes of photos, converted to the pictures of pinhole cameras.

use std::collections::BTreeMap;

use instgs_io::View;
use instgs_io::view_image::camera_at_width;
use instgs_vk::math::distortion::Distortion;
use instgs_vk::scene::{Boxes, Camera, ViewBox};

/// Number of views that a note names at most.
const NAMED: usize = 5;

/// A box in the picture of a camera.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct PlacedBox {
    /// Id of the object; 0 while it is unknown.
    pub(super) object: u16,
    /// Name of the kind of object, if given.
    pub(super) category: Option<String>,
    /// Left, top, right, bottom in pixels of the camera, clipped to its picture.
    pub(super) bounds_px: [f64; 4],
}

impl PlacedBox {
    /// Depth of a pixel position in the box: 1 at its centre, 0 at its edges, -1 at half its size or more outside.
    pub(super) fn depth(&self, at: [f64; 2]) -> f64 {
        let [left, top, right, bottom] = self.bounds_px;
        let along = |v: f64, low: f64, high: f64| 1.0 - (2.0 * v - low - high).abs() / (high - low);
        along(at[0], left, right).min(along(at[1], top, bottom)).max(-1.0)
    }
}

/// The boxes of all views, with the cameras they refer to.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct PlacedBoxes {
    /// By view: the pinhole camera at the width used for carving.
    pub(super) cameras: Vec<Camera>,
    /// By view: the boxes in its picture.
    pub(super) by_view: Vec<Vec<PlacedBox>>,
}

impl PlacedBoxes {
    /// Converts the boxes of `views` to pictures of the given width (`None` = that of the photos). Boxes outside of the
    /// picture and unknown views are reported in `notes`.
    pub(super) fn new(views: &[View], boxes: &Boxes, width: Option<u32>, notes: &mut Vec<String>) -> Self {
        let mut out = Self::default();
        for view in views {
            let camera = camera_at_width(&view.camera, width);
            let mut placed = Vec::new();
            for view_box in boxes.views.get(&view.camera.name).into_iter().flatten() {
                match placed_in(view, &camera, view_box) {
                    Some(found) => placed.push(found),
                    None => notes.push(outside_note(&view.camera.name, view_box)),
                }
            }
            out.cameras.push(camera);
            out.by_view.push(placed);
        }
        notes.extend(unknown_views_note(views, boxes));
        out
    }

    /// Whether any view has a box.
    pub(super) fn has_boxes(&self) -> bool {
        self.by_view.iter().any(|boxes| !boxes.is_empty())
    }

    /// By object: its boxes with the indices of their views, in order; at most one per view.
    pub(super) fn by_object(&self) -> BTreeMap<u16, Vec<(usize, &PlacedBox)>> {
        let mut out: BTreeMap<u16, Vec<(usize, &PlacedBox)>> = BTreeMap::new();
        for (view, boxes) in self.by_view.iter().enumerate() {
            boxes.iter().filter(|b| b.object != 0).for_each(|b| out.entry(b.object).or_default().push((view, b)));
        }
        out
    }
}

/// The box in the camera's picture; `None` if no part of it is inside.
fn placed_in(view: &View, camera: &Camera, view_box: &ViewBox) -> Option<PlacedBox> {
    let photo = &view.camera;
    let straight = match &view.distortion {
        Some(distortion) => without_distortion(view_box.box_px, photo, distortion)?,
        None => view_box.box_px,
    };
    let (width, height) = (f64::from(camera.width), f64::from(camera.height));
    let scale = [width / f64::from(photo.width), height / f64::from(photo.height)];
    let clip = |k: usize| (straight[k] * scale[k % 2]).clamp(0.0, [width, height][k % 2]);
    let bounds_px = [0, 1, 2, 3].map(clip);
    let is_in = bounds_px[0] < bounds_px[2] && bounds_px[1] < bounds_px[3];
    // The reader of boxes has checked the range of ids, 1 to 65535.
    let object = view_box.id.map_or(Some(0), |id| u16::try_from(id).ok())?;
    is_in.then(|| PlacedBox { object, category: view_box.category.clone(), bounds_px })
}

/// The upright rectangle in the pinhole picture around a box of the distorted photo, from nine of its points; `None`
/// where the lens model has no inverse.
fn without_distortion(bounds: [f64; 4], camera: &Camera, distortion: &Distortion) -> Option<[f64; 4]> {
    let [left, top, right, bottom] = bounds;
    let (x, y) = (0.5 * (left + right), 0.5 * (top + bottom));
    let mut out = [f64::INFINITY, f64::INFINITY, f64::NEG_INFINITY, f64::NEG_INFINITY];
    for (u, v) in [left, x, right].into_iter().flat_map(|u| [top, y, bottom].map(|v| (u, v))) {
        let Some([x, y]) = distortion.undistort((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy) else {
            continue;
        };
        let (u, v) = (camera.fx * x + camera.cx, camera.fy * y + camera.cy);
        out = [out[0].min(u), out[1].min(v), out[2].max(u), out[3].max(v)];
    }
    (out[0] < out[2] && out[1] < out[3]).then_some(out)
}

fn outside_note(view: &str, view_box: &ViewBox) -> String {
    let id = view_box.id.map_or(String::new(), |id| format!(" of object {id}"));
    format!("view {view}: the box {:?}{id} is outside of the picture, and was left out", view_box.box_px)
}

fn unknown_views_note(views: &[View], boxes: &Boxes) -> Option<String> {
    let is_known = |name: &str| views.iter().any(|view| view.camera.name == name);
    let unknown: Vec<(&str, usize)> = boxes
        .views
        .iter()
        .filter(|(name, _)| !is_known(name))
        .map(|(name, list)| (name.as_str(), list.len()))
        .collect();
    let names: Vec<&str> = unknown.iter().take(NAMED).map(|(name, _)| *name).collect();
    let more = if unknown.len() > NAMED { ", ..." } else { "" };
    let count: usize = unknown.iter().map(|(_, count)| count).sum();
    (!unknown.is_empty()).then(|| {
        format!(
            "{count} boxes belong to {} views that are not used, and were left out: {}{more}",
            unknown.len(),
            names.join(", ")
        )
    })
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

    use glam::DVec3;

    use super::*;
    use instgs_io::Split;

    fn view(name: &str, distortion: Option<Distortion>) -> View {
        let camera = Camera::look_at(name, DVec3::new(0.0, -2.0, 0.0), DVec3::ZERO, DVec3::Z, 0.8, (100, 50));
        View { camera, image_path: PathBuf::new(), split: Split::Train, distortion, mask_path: None }
    }

    fn view_box(id: Option<u32>, box_px: [f64; 4]) -> ViewBox {
        ViewBox { id, category: None, score: None, box_px }
    }

    #[test]
    fn boxes_are_scaled_and_clipped_and_what_has_no_place_is_said() {
        let list = vec![
            view_box(Some(7), [-5.0, 10.0, 50.0, 70.0]),
            view_box(None, [99.0, 49.0, 101.0, 51.0]),
            view_box(Some(9), [100.0, 0.0, 120.0, 10.0]),
        ];
        let one = vec![view_box(None, [0.0, 0.0, 1.0, 1.0])];
        let boxes = Boxes { views: [("a".into(), list), ("none".into(), one)].into(), ..Boxes::default() };
        let mut notes = Vec::new();
        let placed = PlacedBoxes::new(&[view("a", None), view("b", None)], &boxes, Some(50), &mut notes);
        let bounds: Vec<[f64; 4]> = placed.by_view[0].iter().map(|b| b.bounds_px).collect();
        assert_eq!(bounds, [[0.0, 5.0, 25.0, 25.0], [49.5, 24.5, 50.0, 25.0]]);
        assert_eq!((placed.by_view[1].len(), placed.by_object().len()), (0, 1));
        assert!(notes[0].contains("view a") && notes[0].contains("object 9"), "{notes:?}");
        assert!(notes[1].contains("1 boxes belong to 1 views") && notes[1].contains("none"), "{notes:?}");
    }

    /// What the lens draws inwards moves outwards again.
    #[test]
    fn boxes_of_distorted_photos_are_where_the_pinhole_has_them() {
        let barrel = Distortion { k1: -0.2, ..Distortion::default() };
        let view = view("a", Some(barrel));
        let camera = &view.camera;
        let drawn = |u: f64, v: f64| {
            let [x, y] = barrel.distort((u - camera.cx) / camera.fx, (v - camera.cy) / camera.fy);
            [camera.fx * x + camera.cx, camera.fy * y + camera.cy]
        };
        let ([left, top], [right, bottom]) = (drawn(10.0, 5.0), drawn(30.0, 15.0));
        let placed = placed_in(&view, camera, &view_box(Some(1), [left, top, right, bottom])).unwrap();
        let want = [10.0, 5.0, 30.0, 15.0];
        // The pinhole image of the other two corners differs by up to a pixel.
        assert!(placed.bounds_px.iter().zip(want).all(|(a, b)| (a - b).abs() < 1.0), "{placed:?}");
        assert!((placed.bounds_px[0] - left).abs() > 0.3 && left > 10.0, "{left} {placed:?}");
    }

    #[test]
    fn depth_is_one_in_the_middle_and_zero_at_the_edge() {
        let placed = PlacedBox { object: 1, category: None, bounds_px: [10.0, 0.0, 20.0, 40.0] };
        assert_eq!(placed.depth([15.0, 20.0]), 1.0);
        assert_eq!(placed.depth([10.0, 20.0]), 0.0);
        assert_eq!(placed.depth([15.0, 30.0]), 0.5);
        assert_eq!(placed.depth([90.0, 20.0]), -1.0);
    }
}
