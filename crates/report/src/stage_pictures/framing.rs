//! Chooses views that show all objects, and cameras that show one object large.

use glam::{DMat3, DVec3};

use instgs_objects::register::up_direction;
use instgs_vk::math::sh::widened;
use instgs_vk::scene::{Camera, Gaussians};

/// Fraction of the means, at either end of an axis of the picture, that may be stray Gaussians.
const STRAYS: f64 = 0.01;
/// Margin around an object on all sides, as a fraction of its box: an object with a wrong pose extends into it.
const MARGIN: f64 = 0.18;
/// A view that shows a smaller fraction of an object does not show it well.
const MIN_SHARE: f64 = 0.7;
/// A view shows many objects if it shows this fraction of the largest number that any view shows.
const MANY: f64 = 0.7;
/// Distance of a camera that is not a view, in radii of the object: outside of it, with some perspective.
const DISTANCE: f64 = 4.0;
/// Vertical field of view of such a camera, radians; close-ups choose their own.
const FIELD_OF_VIEW: f64 = 0.5;

/// Chooses at most `most` of the `candidates` (indices of cameras), returned in ascending order. Each choice is the
/// view that shows the most objects that no chosen view shows; among equals, one that shows many, then the one farthest
/// from all chosen. Objects are given by their centres, world units.
pub(super) fn choose_views(cameras: &[Camera], candidates: &[usize], objects: &[DVec3], most: usize) -> Vec<usize> {
    let shows = |view: usize, object: usize| {
        cameras[view].pixel_of(objects[object]).is_some_and(|at| cameras[view].has_pixel(at))
    };
    let shown: Vec<Vec<usize>> =
        candidates.iter().map(|&view| (0..objects.len()).filter(|&o| shows(view, o)).collect()).collect();
    let many = MANY * shown.iter().map(Vec::len).max().unwrap_or(0) as f64;
    let mut is_new = vec![true; objects.len()];
    let mut chosen: Vec<usize> = Vec::new();
    while chosen.len() < most.min(candidates.len()) {
        let value = |c: usize| {
            let at = cameras[candidates[c]].position_world();
            let apart = |&other: &usize| at.distance(cameras[candidates[other]].position_world());
            let nearest = chosen.iter().map(apart).fold(f64::MAX, f64::min);
            let new = shown[c].iter().filter(|&&o| is_new[o]).count();
            (new, shown[c].len() as f64 >= many, nearest)
        };
        let better =
            |a: &(usize, bool, f64), b: &(usize, bool, f64)| (a.0, a.1).cmp(&(b.0, b.1)).then(a.2.total_cmp(&b.2));
        let left = (0..candidates.len()).filter(|c| !chosen.contains(c)).map(|c| (value(c), c));
        let Some((_, next)) = left.max_by(|(a, c), (b, d)| better(a, b).then(d.cmp(c))) else { break };
        shown[next].iter().for_each(|&o| is_new[o] = false);
        chosen.push(next);
    }
    let mut views: Vec<usize> = chosen.into_iter().map(|c| candidates[c]).collect();
    views.sort_unstable();
    views
}

/// The camera that shows the points (world) largest, among those that show the most; `None` if none shows any.
pub(super) fn best_camera<'a>(cameras: &'a [Camera], points: &[DVec3]) -> Option<&'a Camera> {
    let size = |camera: &Camera| {
        let at: Vec<[f64; 2]> = points.iter().filter_map(|&p| camera.pixel_of(p)).collect();
        let inside = at.iter().filter(|at| camera.has_pixel(**at)).count();
        let shows = at.len() == points.len() && inside as f64 >= MIN_SHARE * points.len() as f64;
        // As a fraction of the picture, since cameras may differ in resolution.
        let pixels = f64::from(camera.width) * f64::from(camera.height);
        let [x, y] = boxed(&at)?.map(|(low, high)| high - low);
        (shows && inside > 0).then_some(x * y / pixels)
    };
    let sizes = cameras.iter().enumerate().filter_map(|(i, camera)| Some((size(camera)?, i)));
    let best = sizes.max_by(|a, b| a.0.total_cmp(&b.0).then(b.1.cmp(&a.1)))?;
    cameras.get(best.1)
}

/// A camera that shows the points large: a close-up from the best view's position, or a camera that looks down at them
/// at an angle if no view shows them well; `None` without points.
pub(super) fn portrait(cameras: &[Camera], points: &[DVec3], size_px: (u32, u32)) -> Option<Camera> {
    let middle = (!points.is_empty()).then(|| middle(points))?;
    let best = best_camera(cameras, points).cloned().unwrap_or_else(|| {
        let up = up_or_guess(cameras);
        let reach = points.iter().map(|p| p.distance(middle)).fold(0.0, f64::max);
        let reach = if reach > 0.0 { reach } else { 1.0 };
        let eye = middle + DISTANCE * reach * (up + up.any_orthonormal_vector()).normalize();
        Camera::look_at("", eye, middle, up, FIELD_OF_VIEW, size_px)
    });
    Some(close_up(&best, points, size_px))
}

/// The up axis estimated from the cameras, else that of COLMAP's scenes.
pub(super) fn up_or_guess(cameras: &[Camera]) -> DVec3 {
    up_direction(cameras).unwrap_or(DVec3::NEG_Y)
}

/// A camera at the position of `camera` whose picture of `size_px` shows the points with a margin; the camera itself,
/// resized, if a point lies behind it.
pub(super) fn close_up(camera: &Camera, points: &[DVec3], size_px: (u32, u32)) -> Camera {
    let at: Option<Vec<[f64; 2]>> = points.iter().map(|&p| camera.pixel_of(p)).collect();
    let Some(reach) = at.and_then(|at| boxed(&at)) else { return camera.resized(size_px.0, size_px.1) };
    let size = [f64::from(size_px.0), f64::from(size_px.1)];
    let zoom = [0, 1].map(|axis| {
        let (low, high) = reach[axis];
        size[axis] / ((1.0 + 2.0 * MARGIN) * (high - low).max(1.0))
    });
    let zoom = zoom[0].min(zoom[1]);
    let middle = reach.map(|(low, high)| 0.5 * (low + high));
    Camera {
        width: size_px.0,
        height: size_px.1,
        fx: camera.fx * zoom,
        fy: camera.fy * zoom,
        cx: (camera.cx - middle[0]) * zoom + 0.5 * size[0],
        cy: (camera.cy - middle[1]) * zoom + 0.5 * size[1],
        ..camera.clone()
    }
}

/// The camera rotated about the vertical axis through `middle` by an angle, radians.
pub(super) fn carried_around(camera: &Camera, middle: DVec3, up: DVec3, angle: f64) -> Camera {
    // Rotating the world the other way has the same effect: p -> R (p - m) + m before the old view.
    let turn = DMat3::from_axis_angle(up, -angle);
    let rotation = camera.rotation() * turn;
    let translation = camera.translation() + camera.rotation() * (middle - turn * middle);
    let row = |i: usize| {
        let r = rotation.row(i);
        [r.x, r.y, r.z, translation[i]]
    };
    Camera { view_from_world: [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]], ..camera.clone() }
}

/// The centre of the points: the median per axis.
pub(super) fn middle(points: &[DVec3]) -> DVec3 {
    let median = |axis: usize| {
        let mut values: Vec<f64> = points.iter().map(|p| p[axis]).collect();
        values.sort_by(f64::total_cmp);
        values.get(values.len() / 2).copied().unwrap_or(0.0)
    };
    DVec3::new(median(0), median(1), median(2))
}

/// The finite means of a cloud.
pub(super) fn means(cloud: &Gaussians) -> Vec<DVec3> {
    cloud.means.iter().map(|&mean| widened(mean)).filter(|mean| mean.is_finite()).collect()
}

/// The box of points in a picture without strays, as (low, high) per axis; `None` without points.
fn boxed(at: &[[f64; 2]]) -> Option<[(f64, f64); 2]> {
    let reach = |axis: usize| {
        let mut values: Vec<f64> = at.iter().map(|p| p[axis]).collect();
        values.sort_by(f64::total_cmp);
        let last = values.len().checked_sub(1)?;
        let skipped = (STRAYS * last as f64) as usize;
        Some((values[skipped], values[last - skipped]))
    };
    Some([reach(0)?, reach(1)?])
}

#[cfg(test)]
mod tests {
    use std::f64::consts::{PI, TAU};

    use super::*;

    fn ring(count: u32) -> Vec<Camera> {
        let eye = |i: u32| {
            DVec3::new(
                (TAU * f64::from(i) / f64::from(count)).cos(),
                (TAU * f64::from(i) / f64::from(count)).sin(),
                0.3,
            ) * 6.0
        };
        (0..count).map(|i| Camera::look_at("c", eye(i), DVec3::ZERO, DVec3::Z, 0.8, (160, 120))).collect()
    }

    #[test]
    fn views_show_all_objects_and_are_apart() {
        let cameras = ring(8);
        let all: Vec<usize> = (0..8).collect();
        assert_eq!(choose_views(&cameras, &all, &[DVec3::ZERO], 2), [0, 4], "opposite sides");
        assert_eq!(choose_views(&cameras, &[1, 2], &[DVec3::ZERO], 4), [1, 2], "no more than there are");
        assert_eq!(choose_views(&cameras, &all, &[], 4), [0, 2, 4, 6], "without objects all around");
        // An object behind the first camera, which the cameras opposite see from far away.
        let behind = DVec3::new(9.0, 0.0, 2.7);
        let chosen = choose_views(&cameras, &all, &[DVec3::ZERO, behind], 1);
        let seen = cameras[chosen[0]].pixel_of(behind);
        assert!(seen.is_some_and(|at| cameras[chosen[0]].has_pixel(at)), "{chosen:?}");
        assert!(choose_views(&[], &[], &[DVec3::ZERO], 3).is_empty());
        // Two cameras see the same two objects; the third sees one that no other camera sees.
        let above = |x: f64, at: f64| {
            let (eye, target) = (DVec3::new(x, 0.0, 6.0), DVec3::new(at, 0.0, 0.0));
            Camera::look_at("c", eye, target, DVec3::Y, 0.5, (100, 100))
        };
        let objects = [0.0, 0.3, 50.0].map(|x| DVec3::new(x, 0.0, 0.0));
        assert_eq!(
            choose_views(&[above(0.0, 0.0), above(1.0, 0.0), above(50.0, 50.0)], &[0, 1, 2], &objects, 2),
            [0, 2]
        );
    }

    #[test]
    fn close_ups_show_the_object_in_the_middle_from_either_side() {
        let cameras = ring(8);
        let points: Vec<DVec3> =
            (0..8).map(|i| DVec3::new(f64::from(i & 1), f64::from(i >> 1 & 1), f64::from(i >> 2))).collect();
        let best = best_camera(&cameras, &points).unwrap();
        let near = |c: &Camera| c.position_world().distance(DVec3::splat(0.5));
        assert!(cameras.iter().all(|c| near(best) <= near(c) + 1.0));
        let camera = close_up(best, &points, (80, 60));
        let turned = carried_around(&camera, DVec3::splat(0.5), DVec3::Z, PI);
        for camera in [&camera, &turned] {
            assert_eq!(camera.validate(), Ok(()));
            assert!(points.iter().all(|&p| camera.has_pixel(camera.pixel_of(p).unwrap())));
        }
        let middle = camera.pixel_of(DVec3::splat(0.5)).unwrap();
        assert!((middle[0] - 40.0).abs() < 8.0 && (middle[1] - 30.0).abs() < 8.0, "{middle:?}");
        let (from, to) = (camera.position_world() - 0.5, turned.position_world() - 0.5);
        assert!((from + DVec3::new(to.x, to.y, -to.z)).length() < 1e-9, "{from} {to}");
        let behind = [points[0], camera.position_world() * 2.0];
        assert_eq!((best_camera(&cameras, &[]), portrait(&cameras, &[], (80, 60))), (None, None));
        for points in [vec![DVec3::new(40.0, 3.0, 2.0)], behind.to_vec()] {
            let unseen = portrait(&[], &points, (80, 60)).unwrap();
            assert_eq!(unseen.validate(), Ok(()));
            assert!(points.iter().all(|&p| unseen.has_pixel(unseen.pixel_of(p).unwrap())), "no camera needed");
        }
        assert_eq!(close_up(best, &behind, (80, 60)).fx, best.resized(80, 60).fx);
    }
}
