//! Checks of a dataset before the first step: coordinates too large for single precision, points and cameras in
//! different frames, and a scene closer than the near plane. They only warn, as the run may be intended.

use glam::DVec3;

use instgs_vk::scene::{Camera, PointCloud};

/// Cameras farther from the origin than this many scene extents: single precision, 2^-23 of a coordinate, then rounds
/// positions by more than 1e-4 of the extent, the size of a small Gaussian in a detailed scene.
const FAR_EXTENTS: f64 = 1000.0;
/// Upper bound of the number of points that are checked.
const SAMPLE: usize = 1000;
/// If a smaller fraction of the points is in the frame of any photo, points and cameras probably have different frames.
/// Photos saw every point of a reconstruction; where photos are cropped or thinned out, most points are still seen.
const LEAST_SEEN: f64 = 0.1;
/// A larger fraction of the depths below the near plane is more than a few stray points.
const MOST_NEAR: f64 = 0.02;

/// One warning per line. `extent` and `near` are in scene units.
pub(super) fn doubts(cameras: &[Camera], points: &PointCloud, extent: f64, near: f64) -> Vec<String> {
    let mut doubts = Vec::new();
    let farthest = cameras.iter().map(|camera| camera.position_world().abs().max_element()).fold(0.0, f64::max);
    if farthest > FAR_EXTENTS * extent {
        let step = farthest * f64::from(f32::EPSILON);
        doubts.push(format!(
            "cameras have coordinates up to {farthest:.0}, and the scene is about {extent:.3} wide: positions are rounded to \
             {step:.1e}; move the model to the origin first"
        ));
    }
    let every = points.len().div_ceil(SAMPLE).max(1);
    let sample: Vec<DVec3> =
        points.positions.iter().step_by(every).map(|p| DVec3::from_array(p.map(f64::from))).collect();
    let (seen, depths) = seen_by(cameras, &sample);
    if !sample.is_empty() && (seen as f64) < LEAST_SEEN * sample.len() as f64 {
        doubts.push(format!(
            "only {:.0} % of the points to start from are in any training photo: points and cameras may be in different frames",
            100.0 * seen as f64 / sample.len() as f64
        ));
    }
    let too_near = depths.iter().filter(|&&depth| depth <= near).count();
    if too_near as f64 > MOST_NEAR * depths.len() as f64 {
        let mut sorted = depths.clone();
        sorted.sort_by(f64::total_cmp);
        let wanted = 0.5 * sorted[(MOST_NEAR * depths.len() as f64) as usize];
        doubts.push(format!(
            "{:.0} % of the points that photos show are nearer than near = {near} and are not drawn; \
             --set near={wanted:.1e} draws them",
            100.0 * too_near as f64 / depths.len() as f64
        ));
    }
    doubts
}

/// The number of points in the frame of a camera, and the depth of each point in each such camera, scene units.
fn seen_by(cameras: &[Camera], points: &[DVec3]) -> (usize, Vec<f64>) {
    let mut depths = Vec::new();
    let mut seen = 0;
    for point in points {
        let before = depths.len();
        let in_frame = |camera: &&Camera| camera.pixel_of(*point).is_some_and(|at_px| camera.has_pixel(at_px));
        depths.extend(cameras.iter().filter(in_frame).map(|camera| camera.view_from_point(*point).z));
        seen += usize::from(depths.len() > before);
    }
    (seen, depths)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Cameras around a ball of points of radius 1, at a distance of 3 from its centre, all moved and scaled.
    fn of_ball(scale: f64, middle: DVec3) -> (Vec<Camera>, PointCloud) {
        let on_ball = |k: usize, n: usize, radius: f64| {
            let angle = 2.4 * k as f64;
            let z = 2.0 * (k as f64 + 0.5) / n as f64 - 1.0;
            radius * DVec3::new((1.0 - z * z).sqrt() * angle.cos(), (1.0 - z * z).sqrt() * angle.sin(), z)
        };
        let place = |p: DVec3| middle + scale * p;
        let cameras = (0..12).map(|k| {
            let eye = place(on_ball(k, 12, 3.0));
            Camera::look_at(&k.to_string(), eye, middle, DVec3::new(0.1, 0.2, 1.0), 0.8, (64, 48))
        });
        let positions = (0..2500).map(|k| place(on_ball(k, 2500, 1.0)).as_vec3().to_array()).collect::<Vec<_>>();
        let colors = vec![[0; 3]; positions.len()];
        (cameras.collect(), PointCloud { positions, colors })
    }

    #[test]
    fn a_usual_set_raises_none() {
        let (cameras, points) = of_ball(1.0, DVec3::new(50.0, -20.0, 3.0));
        assert_eq!(doubts(&cameras, &points, 3.0, 0.2), Vec::<String>::new());
        assert_eq!(doubts(&cameras, &PointCloud::default(), 3.0, 0.2), Vec::<String>::new());
    }

    #[test]
    fn each_doubt_is_said() {
        let only = |doubts: Vec<String>, words: &str| {
            assert!(matches!(&doubts[..], [one] if one.contains(words)), "{doubts:?}")
        };
        let (cameras, points) = of_ball(1.0, DVec3::new(4.5e5, 5.2e6, 0.0));
        only(doubts(&cameras, &points, 3.0, 0.2), "rounded to");
        let (cameras, _) = of_ball(1.0, DVec3::ZERO);
        let (_, elsewhere) = of_ball(0.1, DVec3::new(0.0, 0.0, 40.0));
        // The cameras above the centre look down.
        only(doubts(&cameras[6..], &elsewhere, 3.0, 0.2), "different frames");
        let (cameras, points) = of_ball(0.05, DVec3::ZERO);
        only(doubts(&cameras, &points, 0.15, 0.2), "--set near=");
    }
}
