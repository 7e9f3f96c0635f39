//! Camera paths for scenes that come without cameras.

use glam::DVec3;

use crate::math::sh::widened;
use crate::scene::camera::Camera;
use crate::scene::instanced_scene::InstancedScene;

/// Field of view along the shorter image side, radians.
const FIELD_OF_VIEW: f64 = 50.0 * std::f64::consts::PI / 180.0;
/// Elevation of the circle above the scene's centre, an angle seen from the centre, radians.
const ELEVATION: f64 = 20.0 * std::f64::consts::PI / 180.0;
/// Upper limit on means that are sampled: enough for percentiles, and expanding millions would take seconds.
const MOST_SAMPLES: u64 = 1 << 16;
/// An axis counts as the scene's vertical if the scene's extent along it is at most this part of the next larger one.
const CLEARLY_THINNER: f64 = 0.8;
/// The scene must also be a plate: its second extent is at least this part of the largest.
const PLATE: f64 = 0.5;
/// Upper limit on the radius shown, relative to the radius that holds half of the means: objects fit, far backgrounds
/// are ignored.
const MOST_HALF_RADII: f64 = 1.6;

/// A circle of cameras that look down at its centre.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Orbit {
    /// The point that the cameras look at, world units.
    pub center: DVec3,
    /// Distance of the cameras from the centre, world units.
    pub distance: f64,
    /// Unit vector that points up in the images, world frame.
    pub up: DVec3,
}

impl Orbit {
    /// A circle that fits a scene, from the means of the expanded scene: the centre is their median per axis, and the
    /// distance shows the smaller of the ball with nine tenths of them and 1.6 times the ball with half of them, so
    /// that far background and outliers are ignored.
    ///
    /// Without `up`, the vertical is the thin axis of a scene that is a plate (clearly thinner along one world axis
    /// than along the other two, 10th to 90th percentile): places are wider than high. Its sign follows the usual
    /// conventions, -y (COLMAP and the public 3DGS files) or +z (Blender, nerfstudio), +x otherwise. Other scenes, such
    /// as a figure or a ball, get -y.
    pub fn around(scene: &InstancedScene, up: Option<DVec3>) -> Self {
        let means = sampled_means(scene);
        let axis = |k: usize| sorted(means.iter().map(|m| m[k]));
        let axes = [axis(0), axis(1), axis(2)];
        let center = DVec3::from_array([0, 1, 2].map(|k| percentile(&axes[k], 0.5)));
        let distances = sorted(means.iter().map(|m| m.distance(center)));
        // If all means coincide, the distance follows from the largest standard deviation.
        let [half, most, all] = [0.5, 0.9, 1.0].map(|p| percentile(&distances, p));
        let radius = [most.min(MOST_HALF_RADII * half), all].into_iter().find(|&r| r > 0.0);
        let radius = radius.unwrap_or_else(|| 2.0 * largest_deviation(scene));
        let radius = if radius.is_finite() && radius > 0.0 { radius } else { 1.0 };
        let thickness = axes.map(|values| percentile(&values, 0.9) - percentile(&values, 0.1));
        let up = up.and_then(DVec3::try_normalize).unwrap_or_else(|| guessed_up(thickness));
        Self { center, distance: radius / (0.5 * FIELD_OF_VIEW).sin(), up }
    }

    /// `count` cameras at equal angles, named 000, 001 and so on, with images of `size` pixels.
    pub fn cameras(&self, count: u32, size: (u32, u32)) -> Vec<Camera> {
        let reference = if self.up.x.abs() < 0.9 { DVec3::X } else { DVec3::Y };
        let side = self.up.cross(reference).normalize();
        let front = side.cross(self.up);
        // `look_at` takes the vertical field of view.
        let aspect = f64::from(size.1) / f64::from(size.0);
        let fov_y = if aspect > 1.0 { 2.0 * ((0.5 * FIELD_OF_VIEW).tan() * aspect).atan() } else { FIELD_OF_VIEW };
        let camera = |i: u32| {
            let angle = std::f64::consts::TAU * f64::from(i) / f64::from(count);
            let level = front * angle.cos() + side * angle.sin();
            let eye = self.center + self.distance * (level * ELEVATION.cos() + self.up * ELEVATION.sin());
            Camera::look_at(&format!("{i:03}"), eye, self.center, self.up, fov_y, size)
        };
        (0..count).map(camera).collect()
    }
}

/// Means of the expanded scene in the world frame: all, or an evenly spaced sample.
fn sampled_means(scene: &InstancedScene) -> Vec<DVec3> {
    let stride = scene.expanded_len().div_ceil(MOST_SAMPLES).max(1);
    let mut means = Vec::new();
    let mut first_flat = 0u64;
    for (k, instance) in scene.instances.iter().enumerate() {
        let range = scene.template_ranges[instance.template as usize];
        let end = first_flat + u64::from(range.count);
        let own = scene.own_range(k);
        let end_own = end + u64::from(own.count);
        let mut flat = first_flat.next_multiple_of(stride);
        while flat < end_own {
            let mean = if flat < end {
                let local = (flat - first_flat) as usize;
                let offset =
                    instance.first_offset.map_or(DVec3::ZERO, |o| widened(scene.offsets.means[o as usize + local]));
                widened(scene.templates.means[range.first as usize + local]) + offset
            } else {
                widened(scene.own.means[own.first as usize + (flat - end) as usize])
            };
            means.push(instance.world_from_template.transform_point(mean));
            flat += stride;
        }
        first_flat = end_own;
    }
    let skip = first_flat.next_multiple_of(stride) - first_flat;
    means.extend(scene.background.means.iter().skip(skip as usize).step_by(stride as usize).map(|&m| widened(m)));
    means
}

fn sorted(values: impl Iterator<Item = f64>) -> Vec<f64> {
    let mut values: Vec<f64> = values.collect();
    values.sort_by(f64::total_cmp);
    values
}

/// The value below which a fraction (0..=1) of the sorted values lies; 0 without values.
fn percentile(sorted: &[f64], fraction: f64) -> f64 {
    let last = sorted.len().saturating_sub(1);
    sorted.get((fraction * last as f64).round() as usize).copied().unwrap_or(0.0)
}

fn largest_deviation(scene: &InstancedScene) -> f64 {
    let posed = scene.templates.log_scales.iter().chain(&scene.own.log_scales);
    let log_scales = posed.chain(&scene.background.log_scales).flatten();
    f64::from(log_scales.copied().fold(f32::NEG_INFINITY, f32::max)).exp()
}

fn guessed_up(thickness: [f64; 3]) -> DVec3 {
    let mut order = [0, 1, 2];
    order.sort_by(|&a: &usize, &b| thickness[a].total_cmp(&thickness[b]));
    let [thin, middle, wide] = order.map(|k| thickness[k]);
    let plate = thin <= CLEARLY_THINNER * middle && middle >= PLATE * wide && middle > 0.0;
    match order[0] {
        2 if plate => DVec3::Z,
        0 if plate => DVec3::X,
        _ => DVec3::NEG_Y,
    }
}

#[cfg(test)]
mod tests {
    use glam::DMat3;

    use super::*;
    use crate::math::similarity::Similarity;
    use crate::scene::gaussians::Gaussians;
    use crate::scene::instanced_scene::{Instance, SourceRange};

    fn cloud(means: &[[f32; 3]]) -> Gaussians {
        let mut out = Gaussians::with_capacity(0, means.len());
        for &mean in means {
            out.means.push(mean);
            out.quats.push([1.0, 0.0, 0.0, 0.0]);
            out.log_scales.push([-3.0; 3]);
            out.opacity_logits.push(0.0);
            out.sh.push([0.0; 3]);
        }
        out
    }

    /// A 9x9 grid along two axes, with one Gaussian far away.
    fn plate(thin: usize) -> Gaussians {
        let mut means: Vec<[f32; 3]> = Vec::new();
        for i in 0..81 {
            let mut mean = [0.0; 3];
            mean[(thin + 1) % 3] = (i % 9) as f32 - 4.0;
            mean[(thin + 2) % 3] = (i / 9) as f32 - 4.0;
            means.push(mean);
        }
        means.push([1e6; 3]);
        cloud(&means)
    }

    #[test]
    fn outliers_do_not_move_it_and_up_is_the_thin_axis() {
        for (thin, up) in [(0, DVec3::X), (1, DVec3::NEG_Y), (2, DVec3::Z)] {
            let orbit = Orbit::around(&InstancedScene::from_cloud(plate(thin)), None);
            assert_eq!((orbit.center, orbit.up), (DVec3::ZERO, up));
            assert!((5.0..25.0).contains(&orbit.distance), "{orbit:?}");
        }
        assert_eq!(guessed_up([0.5, 2.2, 0.8]), DVec3::NEG_Y, "a standing figure is no plate");
        let turned = Orbit::around(&InstancedScene::from_cloud(plate(2)), Some(DVec3::new(0.0, 3.0, 0.0)));
        assert_eq!(turned.up, DVec3::Y);
    }

    #[test]
    fn instances_count_where_they_stand_also_when_sampled() {
        let pose = |x: f64| Similarity::from_parts(DMat3::IDENTITY, 1.0, DVec3::new(x, 0.0, 7.0));
        let template = cloud(&vec![[1.0, 0.0, 0.0]; 1000]);
        let instance = |k: u32| Instance { template: 0, world_from_template: pose(f64::from(k)), first_offset: None };
        let scene = InstancedScene {
            templates: template,
            template_ranges: vec![SourceRange { first: 0, count: 1000 }],
            instances: (0..201).map(instance).collect(),
            background: cloud(&[[101.0, 0.0, 7.0]; 5]),
            ..InstancedScene::default()
        };
        let means = sampled_means(&scene);
        assert!(means.len() as u64 <= MOST_SAMPLES && means.len() > 40_000, "{}", means.len());
        assert_eq!(Orbit::around(&scene, None).center, DVec3::new(101.0, 0.0, 7.0));
    }

    #[test]
    fn cameras_are_valid_named_and_look_at_the_centre() {
        let scenes = [InstancedScene::default(), InstancedScene::from_cloud(cloud(&[[1.0, 2.0, 3.0]]))];
        for scene in scenes {
            let orbit = Orbit::around(&scene, None);
            let cameras = orbit.cameras(5, (64, 128));
            assert_eq!(
                cameras.iter().map(|c| c.name.as_str()).collect::<Vec<_>>(),
                ["000", "001", "002", "003", "004"]
            );
            for camera in &cameras {
                assert_eq!(camera.validate(), Ok(()));
                let view = camera.rotation() * orbit.center + camera.translation();
                assert!(view.truncate().length() < 1e-9 * orbit.distance && (view.z - orbit.distance).abs() < 1e-9);
                assert!((camera.position_world() - orbit.center).dot(orbit.up) > 0.0);
                // The field of view is along the shorter side, here the width.
                assert!((camera.fx * (0.5 * FIELD_OF_VIEW).tan() - 32.0).abs() < 1e-9);
            }
        }
    }
}
