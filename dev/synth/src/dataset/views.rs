//! Camera positions of a data set.

use std::f64::consts::TAU;

use glam::DVec3;

use instgs_io::dataset::Split;
use instgs_vk::math::rng::Rng;
use instgs_vk::scene::Camera;

use super::files::split_of;

/// Vertical field of view, radians.
const FIELD_OF_VIEW: f64 = 45.0 * std::f64::consts::PI / 180.0;
/// Largest horizontal field of view, radians: very wide pictures have a smaller vertical one.
const WIDEST: f64 = 100.0 * std::f64::consts::PI / 180.0;
/// Stream of the camera positions, derived from the seed.
const STREAM: u64 = 0xCA_3E_8A;
/// Relative jitter of distance and height.
const JITTER: f64 = 0.05;

/// From a camera of a rig to the next, in widths of its azimuths: (3 + g) / 8, where g is the golden ratio, 0.618. So
/// any number of cameras is spread evenly, and of the test views, every eighth, each is a golden ratio of a turn from
/// the one before. With a step of g itself the test views would be close together, since 8 g is nearly whole.
const STEP: f64 = 0.452_254_248_593_736_8;
/// Part of an arc at each end where no test view stands: half of its photo would show what no other does.
const ARC_INSET: f64 = 0.06;
/// Part of a line of a sweep at each end where no camera stands: half of its photo would show what no other does.
const SWEEP_INSET: f64 = 0.06;

/// Elevation of a flight, radians: above hedges and fences, like the view of a person or a low drone.
const FLIGHT_ELEVATION: f64 = 14.0 * std::f64::consts::PI / 180.0;
/// Azimuth of a flight from the centre of the rig's azimuths, so that rows of objects are not seen end on.
const FLIGHT_AZIMUTH: f64 = 30.0 * std::f64::consts::PI / 180.0;

/// A circle of cameras around the target.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Ring {
    /// Horizontal distance from the rig's target, metres.
    pub distance: f64,
    /// Height above the ground, metres.
    pub height: f64,
}

/// Cameras that fly over a rectangle, line by line and back and forth, and all look in about the same direction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sweep {
    /// Where the flight begins, world frame, metres.
    pub corner: DVec3,
    /// From the first to the last camera of a line, metres, world frame.
    pub along: DVec3,
    /// From the first line's side of the rectangle to the last one's, metres.
    pub across: DVec3,
    /// Number of lines, flown back and forth in turn.
    pub lines: u32,
    /// From a camera to what it looks at, metres.
    pub look: DVec3,
}

/// Rings of cameras that look inwards: a dome, or a part of one; or a sweep.
#[derive(Clone, Debug, PartialEq)]
pub struct Rig {
    /// Point that cameras look at, world frame.
    pub target: DVec3,
    /// Largest distance of a camera's own target from it, metres.
    pub stray: f64,
    /// The rings, at least one; cameras take turns on them. Their number should have no divisor in common with 8, so
    /// that test views are on all of them.
    pub rings: Vec<Ring>,
    /// Centre and width of the azimuths, radians; a width of TAU is all around.
    pub azimuths: (f64, f64),
    /// Cameras sweep over the scene instead of standing on the rings.
    pub sweep: Option<Sweep>,
}

impl Rig {
    /// `count` cameras on a line that rises by 14 degrees from the target, near the centre of the rig's azimuths, at
    /// distances in geometric progression from the first to the second, metres; all look at the target. Named like
    /// those of rings.
    pub fn flight(&self, count: u32, size: (u32, u32), (from, to): (f64, f64)) -> Vec<Camera> {
        let (azimuth, level) = (self.azimuths.0 + FLIGHT_AZIMUTH, FLIGHT_ELEVATION.cos());
        let towards = DVec3::new(level * azimuth.cos(), level * azimuth.sin(), FLIGHT_ELEVATION.sin());
        let camera = |i: u32| {
            let share = f64::from(i) / f64::from(count.saturating_sub(1).max(1));
            let eye = self.target + from * (to / from).powf(share) * towards;
            Camera::look_at(&name(i, count), eye, self.target, DVec3::Z, field_of_view(size), size)
        };
        (0..count).map(camera).collect()
    }

    /// `count` cameras on the rings or on the sweep, named `view_000`, `view_001` and so on.
    pub fn cameras(&self, count: u32, size: (u32, u32), seed: u64) -> Vec<Camera> {
        let rng = Rng::new(seed).fork(STREAM);
        let fov_y = field_of_view(size);
        let camera = |i: u32| {
            let mut rng = rng.fork(u64::from(i));
            if let Some(sweep) = &self.sweep {
                let (eye, target) = sweep.camera(f64::from(i) / f64::from(count), &mut rng);
                return Camera::look_at(&name(i, count), eye, target, DVec3::Z, fov_y, size);
            }
            let ring = self.rings[i as usize % self.rings.len()];
            let share = (0.5 + f64::from(i) * STEP + rng.range(0.0, 0.02)).fract() - 0.5;
            let inset = if self.is_arc() && split_of(i as usize) == Split::Test { ARC_INSET } else { 0.0 };
            let azimuth = self.azimuths.0 + self.azimuths.1 * (1.0 - 2.0 * inset) * share;
            let mut vary = |v: f64| v * rng.range(1.0 - JITTER, 1.0 + JITTER);
            let (distance, height) = (vary(ring.distance), vary(ring.height));
            let around = DVec3::new(self.target.x, self.target.y, 0.0);
            let eye = around + DVec3::new(distance * azimuth.cos(), distance * azimuth.sin(), height);
            let target = self.target + rng.unit_vector() * self.stray * DVec3::new(1.0, 1.0, 0.3);
            Camera::look_at(&name(i, count), eye, target, DVec3::Z, fov_y, size)
        };
        (0..count).map(camera).collect()
    }

    /// Whether the azimuths have ends.
    fn is_arc(&self) -> bool {
        self.azimuths.1 < TAU
    }
}

impl Sweep {
    /// Position of the camera after the part `share` of the flight, 0..1, and the point that it looks at.
    fn camera(&self, share: f64, rng: &mut Rng) -> (DVec3, DVec3) {
        let flown = share * f64::from(self.lines);
        let line = flown.floor();
        let back = line as u32 % 2 == 1;
        let along = SWEEP_INSET + (1.0 - 2.0 * SWEEP_INSET) * flown.fract();
        let on_line = if back { 1.0 - along } else { along };
        let between = (line + 0.5) / f64::from(self.lines);
        let jitter = |rng: &mut Rng| rng.unit_vector() * (JITTER * self.look.length());
        let eye = self.corner + self.along * on_line + self.across * between + jitter(rng);
        (eye, eye + self.look + 2.0 * jitter(rng))
    }
}

fn name(i: u32, count: u32) -> String {
    let digits = count.saturating_sub(1).to_string().len().max(3);
    format!("view_{i:0digits$}")
}

/// Vertical field of view for a picture of this size, radians.
fn field_of_view(size: (u32, u32)) -> f64 {
    let aspect = f64::from(size.0) / f64::from(size.1);
    FIELD_OF_VIEW.min(2.0 * ((0.5 * WIDEST).tan() / aspect).atan())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Where the cameras of a rig with one ring stand, in turns of its azimuths, 0..1: those of a split, ascending.
    fn places(rig: &Rig, count: u32, split: Split) -> Vec<f64> {
        let place = |camera: &Camera| {
            let eye = camera.position_world() - rig.target;
            let turned = (eye.y.atan2(eye.x) - rig.azimuths.0) / rig.azimuths.1 + 0.5;
            if rig.is_arc() { turned } else { turned.rem_euclid(1.0) }
        };
        let cameras = rig.cameras(count, (64, 64), 1);
        let of_split = cameras.iter().enumerate().filter(|&(i, _)| split_of(i) == split);
        let mut places: Vec<f64> = of_split.map(|(_, camera)| place(camera)).collect();
        places.sort_by(f64::total_cmp);
        places
    }

    #[test]
    fn test_views_are_spread_and_have_training_views_on_both_sides() {
        for (width, count) in [(TAU, 24), (TAU, 48), (TAU, 64), (2.6, 24), (2.6, 48), (1.7, 64)] {
            let rings = vec![Ring { distance: 10.0, height: 2.0 }];
            let rig = Rig { target: DVec3::ZERO, stray: 0.0, rings, azimuths: (0.3, width), sweep: None };
            let (test, train) = (places(&rig, count, Split::Test), places(&rig, count, Split::Train));
            let at = format!("width {width}, {count} cameras: {test:?}");
            let gaps = test.windows(2).map(|w| w[1] - w[0]);
            let around = test[0] + 1.0 - test[test.len() - 1];
            // Evenly spread ones would have gaps of one share; the sequence of golden ratios has up to 1.8.
            let largest = gaps.chain([around]).fold(0.0, f64::max) * test.len() as f64;
            assert!(largest < 2.1, "{largest} {at}");
            for t in test {
                // In shares of a training view; around a circle the distance goes on over its seam.
                let near = |from: &f64, to: &f64| {
                    let d = to - from;
                    let d = if rig.is_arc() { d } else { d.rem_euclid(1.0) };
                    (0.0..3.5 / f64::from(count)).contains(&d)
                };
                assert!(train.iter().any(|v| near(&t, v)) && train.iter().any(|v| near(v, &t)), "{t} {at}");
            }
        }
    }

    #[test]
    fn cameras_are_valid_and_look_at_the_target_from_all_sides() {
        let rings = vec![Ring { distance: 10.0, height: 2.0 }, Ring { distance: 8.0, height: 6.0 }];
        let rig = Rig { target: DVec3::new(1.0, 2.0, 0.5), stray: 0.5, rings, azimuths: (0.0, TAU), sweep: None };
        let cameras = rig.cameras(48, (320, 180), 3);
        let mut sectors = [0; 8];
        for camera in &cameras {
            camera.validate().unwrap();
            let eye = camera.position_world() - rig.target;
            let forward = camera.rotation().row(2);
            assert!(forward.dot(-eye.normalize()) > 0.95);
            sectors[(eye.y.atan2(eye.x).rem_euclid(TAU) / TAU * 8.0) as usize] += 1;
        }
        assert!(sectors.iter().all(|&n| n >= 4), "{sectors:?}");
        assert_eq!(cameras[7].name, "view_007");
        assert_eq!(cameras, rig.cameras(48, (320, 180), 3));
        let flight = rig.flight(5, (320, 180), (64.0, 4.0));
        let distances: Vec<f64> = flight.iter().map(|c| c.position_world().distance(rig.target)).collect();
        assert!(distances.iter().zip([64.0, 32.0, 16.0, 8.0, 4.0]).all(|(d, want)| (d - want).abs() < 1e-9));
        flight.iter().for_each(|c| c.validate().unwrap());
        for size in [(1, 1), (16384, 1), (1, 16384), (33, 17)] {
            rig.cameras(2, size, 1).iter().for_each(|c| c.validate().unwrap());
        }
    }
}
