//! Selects the views that show an object best, and the crop of each around the object.

use glam::DVec3;

use instgs_vk::scene::Camera;

/// Number of views in which poses are compared; more add little.
const VIEWS: usize = 4;
/// Views whose directions to the object differ by less are redundant (cosine of 35 degrees).
const SAME_DIRECTION: f64 = 0.82;
/// Longer side of a rendered crop, pixels: enough for outlines and colours.
const MOST_PX: f64 = 96.0;
/// Margin around the object as a part of its box: a wrong pose reaches out of it.
const MARGIN: f64 = 0.15;
/// Least part of the object that must be in the picture.
const MIN_SHARE: f64 = 0.7;

/// A rectangular part of a view, at reduced size.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Crop {
    /// Index of the view among the cameras.
    pub view: usize,
    /// A camera that sees just that part, at a size reduced by `shrink`.
    pub camera: Camera,
    /// Upper left corner within the view, pixels.
    pub corner_px: [f64; 2],
    /// Pixels of the view per pixel of the crop, 1 or more.
    pub shrink: f64,
}

/// The crops that show the points (world frame) largest, from different sides.
pub(super) fn best_crops(cameras: &[Camera], points: &[DVec3]) -> Vec<Crop> {
    let centre = points.iter().sum::<DVec3>() / points.len().max(1) as f64;
    let crop = |(i, camera): (usize, &Camera)| crop_of(i, camera, points);
    let mut all: Vec<(f64, Crop)> = cameras.iter().enumerate().filter_map(crop).collect();
    all.sort_by(|a, b| b.0.total_cmp(&a.0).then(a.1.view.cmp(&b.1.view)));
    let direction = |crop: &Crop| (cameras[crop.view].position_world() - centre).normalize_or_zero();
    let mut chosen: Vec<Crop> = Vec::new();
    // First views from different sides, then any others.
    for limit in [SAME_DIRECTION, f64::INFINITY] {
        for (_, crop) in &all {
            let apart = chosen.iter().all(|c| c.view != crop.view && direction(c).dot(direction(crop)) < limit);
            if chosen.len() < VIEWS && apart {
                chosen.push(crop.clone());
            }
        }
    }
    chosen
}

/// The crop around the points, and its quality: part of the object that is visible, times pixels.
fn crop_of(view: usize, camera: &Camera, points: &[DVec3]) -> Option<(f64, Crop)> {
    let (mut low, mut high) = ([f64::INFINITY; 2], [f64::NEG_INFINITY; 2]);
    let mut inside = 0;
    for &p in points {
        let at = camera.pixel_of(p)?;
        inside += usize::from(camera.has_pixel(at));
        for axis in 0..2 {
            (low[axis], high[axis]) = (low[axis].min(at[axis]), high[axis].max(at[axis]));
        }
    }
    let share = inside as f64 / points.len().max(1) as f64;
    if share < MIN_SHARE {
        return None;
    }
    let limits = [f64::from(camera.width), f64::from(camera.height)];
    let reach = [0, 1].map(|axis| {
        let room = MARGIN * (high[axis] - low[axis]) + 1.0;
        ((low[axis] - room).max(0.0).floor(), (high[axis] + room).min(limits[axis]).ceil())
    });
    let size = reach.map(|(low, high)| high - low);
    let shrink = (size[0].max(size[1]) / MOST_PX).max(1.0);
    let corner_px = reach.map(|(low, _)| low);
    let camera = Camera {
        width: (size[0] / shrink).ceil().max(1.0) as u32,
        height: (size[1] / shrink).ceil().max(1.0) as u32,
        fx: camera.fx / shrink,
        fy: camera.fy / shrink,
        cx: (camera.cx - corner_px[0]) / shrink,
        cy: (camera.cy - corner_px[1]) / shrink,
        ..camera.clone()
    };
    Some((share * size[0] * size[1], Crop { view, camera, corner_px, shrink }))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera(turn: f64, distance: f64) -> Camera {
        let eye = DVec3::new(distance * turn.cos(), distance * turn.sin(), 1.0);
        Camera::look_at("", eye, DVec3::ZERO, DVec3::Z, 0.8, (640, 360))
    }

    fn points() -> Vec<DVec3> {
        (0..8).map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2)) - 0.5).collect()
    }

    #[test]
    fn near_views_from_different_sides_are_chosen() {
        let cameras: Vec<Camera> = (0..40).map(|i| camera(0.05 * f64::from(i), 4.0 + 0.1 * f64::from(i))).collect();
        let crops = best_crops(&cameras, &points());
        assert_eq!(crops.len(), VIEWS);
        assert_eq!(crops[0].view, 0, "the nearest");
        assert!(crops[1].view >= 12, "{}", crops[1].view);
        assert!(best_crops(&[], &points()).is_empty());
        let behind = Camera::look_at("", DVec3::X * 4.0, DVec3::X * 9.0, DVec3::Z, 0.8, (640, 360));
        assert!(best_crops(&[behind], &points()).is_empty());
    }

    /// A point has the crop camera's pixel of the view's pixel, minus the corner, over `shrink`.
    #[test]
    fn crops_show_their_part_of_the_view() {
        let view = camera(0.3, 3.0);
        let crop = best_crops(std::slice::from_ref(&view), &points()).remove(0);
        assert!(crop.shrink > 1.0 && crop.camera.width.max(crop.camera.height) == MOST_PX as u32, "{crop:?}");
        let draw = |c: &Camera, p: DVec3| c.pixel_of(p).unwrap();
        for p in points() {
            let (whole, part) = (draw(&view, p), draw(&crop.camera, p));
            for axis in 0..2 {
                assert!((part[axis] * crop.shrink + crop.corner_px[axis] - whole[axis]).abs() < 1e-9);
                assert!((0.0..=MOST_PX).contains(&part[axis]));
            }
        }
    }
}
