//! Pose and motion of the camera. Lengths are scene units, angles radians, positions in the view pixels.

use glam::{DMat3, DVec3};

use instgs_vk::scene::Camera;
use instgs_vk::scene::trajectory::Orbit;

/// Orbiting stops this far (radians) from straight up and down: beyond it, left and right would swap.
const POLE: f64 = 2.0 * std::f64::consts::PI / 180.0;
/// Angle in radians of a drag over the full height of the view.
const TURN_PER_HEIGHT: f64 = std::f64::consts::PI;
/// Factor on the distance to the target per step of the wheel.
const ZOOM_PER_STEP: f64 = 0.9;
/// Range of the vertical field of view, radians: 5 to 150 degrees.
const FIELDS_OF_VIEW: [f64; 2] = [0.0873, 2.618];
/// Range of the flight speed, in initial target distances per second: from inspecting a detail to crossing a town.
const SPEEDS: [f64; 2] = [1e-3, 1e3];
/// Factor on the speed while Shift is held.
const FAST: f64 = 5.0;

/// A camera that the user moves. Orbiting and zooming are relative to its target.
#[derive(Clone, Debug, PartialEq)]
pub struct Navigator {
    eye: DVec3,
    /// Columns: right, down and forward in world coordinates.
    world_from_view: DMat3,
    /// Distance from the eye to the target.
    distance: f64,
    /// The axis of turns to the left and right: a unit vector.
    up: DVec3,
    /// Vertical field of view, radians.
    fov_y: f64,
    /// Flight speed, in units of `unit` per second.
    speed: f64,
    /// Target distance at the start: the scale of flight, which does not shrink when the user zooms in.
    unit: f64,
}

/// A direction of flight along the camera's axes, each component from -1 to 1.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Flight {
    /// To the right of the view.
    pub right: f64,
    /// Upwards, along the scene's up axis.
    pub up: f64,
    /// Along the direction of view.
    pub forward: f64,
    /// True for five times the speed.
    pub fast: bool,
}

impl Flight {
    /// True if all components are zero.
    pub fn is_still(&self) -> bool {
        self.right == 0.0 && self.up == 0.0 && self.forward == 0.0
    }
}

impl Navigator {
    /// The first camera of the circle that `render --orbit` uses.
    pub fn around(orbit: &Orbit) -> Self {
        let camera = orbit.cameras(1, (16, 9)).remove(0);
        let mut navigator = Self {
            eye: DVec3::ZERO,
            world_from_view: DMat3::IDENTITY,
            distance: orbit.distance,
            up: orbit.up,
            fov_y: 1.0,
            speed: 1.0,
            unit: orbit.distance,
        };
        navigator.stand_at(&camera);
        navigator
    }

    /// Takes the pose and the field of view of a camera. The distance to the target is kept.
    pub fn stand_at(&mut self, camera: &Camera) {
        self.eye = camera.position_world();
        self.world_from_view = camera.rotation().transpose();
        self.set_fov_y(2.0 * (0.5 * f64::from(camera.height) / camera.fy).atan());
    }

    /// The camera for an image of `size_px`.
    pub fn camera(&self, size_px: [u32; 2]) -> Camera {
        let focal = 0.5 * f64::from(size_px[1]) / (0.5 * self.fov_y).tan();
        let row = |axis: DVec3| [axis.x, axis.y, axis.z, -axis.dot(self.eye)];
        let axes = self.world_from_view;
        Camera {
            name: "view".into(),
            width: size_px[0],
            height: size_px[1],
            fx: focal,
            fy: focal,
            cx: 0.5 * f64::from(size_px[0]),
            cy: 0.5 * f64::from(size_px[1]),
            view_from_world: [row(axes.x_axis), row(axes.y_axis), row(axes.z_axis), [0.0, 0.0, 0.0, 1.0]],
        }
    }

    /// Position of the eye, world coordinates.
    pub fn eye(&self) -> DVec3 {
        self.eye
    }

    /// Level directions to the right and forward as seen from the camera, and the up axis; unit vectors.
    pub fn level_axes(&self) -> [DVec3; 3] {
        let right = self.world_from_view.x_axis.reject_from_normalized(self.up);
        let right = right.try_normalize().unwrap_or_else(|| self.up.any_orthonormal_vector());
        [right, self.up.cross(right), self.up]
    }

    /// The point that the camera orbits, world coordinates.
    pub fn target(&self) -> DVec3 {
        self.eye + self.distance * self.world_from_view.z_axis
    }

    /// Distance from the eye to the target.
    pub fn distance(&self) -> f64 {
        self.distance
    }

    /// Vertical field of view, radians.
    pub fn fov_y(&self) -> f64 {
        self.fov_y
    }

    /// Sets the vertical field of view, clamped to 5 to 150 degrees; NaN is ignored.
    pub fn set_fov_y(&mut self, fov_y: f64) {
        if fov_y.is_finite() {
            self.fov_y = fov_y.clamp(FIELDS_OF_VIEW[0], FIELDS_OF_VIEW[1]);
        }
    }

    /// Flight speed, in initial target distances per second.
    pub fn speed(&self) -> f64 {
        self.speed
    }

    /// Multiplies the flight speed by a factor.
    pub fn change_speed(&mut self, factor: f64) {
        self.speed = (self.speed * factor).clamp(SPEEDS[0], SPEEDS[1]);
    }

    /// Orbits around the target for a drag by `by_px` in a view of `height_px`: the near side follows the pointer.
    pub fn orbit(&mut self, by_px: [f64; 2], height_px: f64) {
        let target = self.target();
        self.turn(by_px, height_px);
        self.eye = target - self.distance * self.world_from_view.z_axis;
    }

    /// Rotates the camera about its own position: distant points follow the pointer.
    pub fn look(&mut self, by_px: [f64; 2], height_px: f64) {
        // Exact in the middle of the view: a point moves by as many pixels as the pointer.
        let scale = 2.0 * (0.5 * self.fov_y).tan() / TURN_PER_HEIGHT;
        self.turn([-by_px[0] * scale, -by_px[1] * scale], height_px);
    }

    /// Rotates by a drag to the right and down, in pixels of a view of `height_px`.
    fn turn(&mut self, by_px: [f64; 2], height_px: f64) {
        let [right, down] = by_px.map(|px| px / height_px.max(1.0) * TURN_PER_HEIGHT);
        // An upside-down camera turns the other way about the vertical.
        let upright = if self.world_from_view.y_axis.dot(self.up) > 0.0 { -1.0 } else { 1.0 };
        let yaw = DMat3::from_axis_angle(self.up, -right * upright);
        let from_up = self.world_from_view.z_axis.dot(self.up).clamp(-1.0, 1.0).acos();
        let wanted = from_up + down * upright;
        // A camera that starts beyond the limit may stay there, but does not go farther.
        let limits = [POLE.min(from_up), (std::f64::consts::PI - POLE).max(from_up)];
        let pitch = (wanted.clamp(limits[0], limits[1]) - from_up) * upright;
        let tilted = DMat3::from_axis_angle(self.world_from_view.x_axis, -pitch) * self.world_from_view;
        self.world_from_view = orthonormal(yaw * tilted);
    }

    /// Translates parallel to the image plane: points at the target's depth follow the pointer.
    pub fn pan(&mut self, by_px: [f64; 2], height_px: f64) {
        let per_px = 2.0 * self.distance * (0.5 * self.fov_y).tan() / height_px.max(1.0);
        self.eye -= per_px * (by_px[0] * self.world_from_view.x_axis + by_px[1] * self.world_from_view.y_axis);
    }

    /// Moves closer by `steps` of the wheel (negative: away); the point under the pointer at the target's depth stays
    /// there.
    pub fn zoom(&mut self, steps: f64, pointer_px: [f64; 2], size_px: [u32; 2]) {
        self.approach(ZOOM_PER_STEP.powf(steps), pointer_px, size_px);
    }

    /// Moves closer after two fingers have spread by a part `by` of their distance (negative: away): things at the target's
    /// depth grow as much, and the point under the pointer stays there. What is no number is ignored.
    pub fn pinch(&mut self, by: f64, pointer_px: [f64; 2], size_px: [u32; 2]) {
        if by.is_finite() {
            self.approach(1.0 / (1.0 + by.max(-0.9)), pointer_px, size_px);
        }
    }

    /// Multiplies the distance to the target by a factor; the point under the pointer at the target's depth stays there.
    fn approach(&mut self, factor: f64, pointer_px: [f64; 2], size_px: [u32; 2]) {
        let camera = self.camera(size_px);
        let ray = [(pointer_px[0] - camera.cx) / camera.fx, (pointer_px[1] - camera.cy) / camera.fy];
        let under = self.eye + self.distance * (self.world_from_view * DVec3::new(ray[0], ray[1], 1.0));
        // Below 1e-6 of the scene's size, f32 positions on the device cannot be told apart.
        let factor = factor.clamp(1e-6 * self.unit / self.distance, 1e6 * self.unit / self.distance);
        self.eye = under + (self.eye - under) * factor;
        self.distance *= factor;
    }

    /// Flies in a direction for `seconds`.
    pub fn fly(&mut self, flight: Flight, seconds: f64) {
        let axes = self.world_from_view;
        let direction = flight.right * axes.x_axis + flight.up * self.up + flight.forward * axes.z_axis;
        let speed = self.speed * self.unit * if flight.fast { FAST } else { 1.0 };
        self.eye += direction.normalize_or_zero() * speed * seconds;
    }

    /// Sets the target to the point on the line of sight that is as far away as `point_world`.
    pub fn aim_at(&mut self, point_world: DVec3) {
        let depth = (point_world - self.eye).dot(self.world_from_view.z_axis);
        if depth > 0.0 && point_world.is_finite() {
            self.distance = depth;
        }
    }

    /// Makes a point the target and moves the camera so that it is in the middle of the view at the same distance.
    pub fn focus(&mut self, point_world: DVec3) {
        let depth = (point_world - self.eye).dot(self.world_from_view.z_axis);
        if depth > 0.0 && point_world.is_finite() {
            self.aim_at(point_world);
            self.eye = point_world - depth * self.world_from_view.z_axis;
        }
    }

    /// Makes a point the target, wherever it is, and looks at it along a direction from a distance, world units; the horizon
    /// is level. Numbers that are not finite, and distances that are not positive, are ignored.
    pub fn look_along(&mut self, target_world: DVec3, along: DVec3, distance: f64) {
        if !(target_world.is_finite() && distance.is_finite() && distance > 0.0) {
            return;
        }
        let [_, ahead, up] = self.level_axes();
        let along = along.normalize_or(ahead);
        let upwards = if along.dot(up).abs() > 0.999 { ahead } else { up };
        let eye = target_world - distance * along;
        self.stand_at(&Camera::look_at("view", eye, target_world, upwards, self.fov_y, (16, 9)));
        self.distance = distance;
    }

    /// Looks at a ball, wherever it is, in the present direction from where it fills the height of the view; from the present
    /// distance to the target if its radius is 0.
    pub fn frame(&mut self, centre_world: DVec3, radius: f64) {
        let distance = if radius > 0.0 { radius / (0.5 * self.fov_y).sin() } else { self.distance };
        self.look_along(centre_world, self.world_from_view.z_axis, distance);
    }
}

/// Removes the rounding errors that add up over thousands of rotations.
fn orthonormal(m: DMat3) -> DMat3 {
    let forward = m.z_axis.normalize();
    let right = m.y_axis.cross(forward).normalize();
    DMat3::from_cols(right, forward.cross(right), forward)
}

#[cfg(test)]
mod tests {
    use super::*;

    const SIZE: [u32; 2] = [320, 180];

    fn navigator() -> Navigator {
        Navigator::around(&Orbit { center: DVec3::new(1.0, -2.0, 0.5), distance: 4.0, up: DVec3::Z })
    }

    fn near(a: DVec3, b: DVec3) -> bool {
        a.distance(b) < 1e-9
    }

    #[test]
    fn it_starts_where_the_orbit_does_and_its_camera_is_sound() {
        let n = navigator();
        assert!(near(n.target(), DVec3::new(1.0, -2.0, 0.5)) && (n.distance() - 4.0).abs() < 1e-12);
        let camera = n.camera(SIZE);
        camera.validate().unwrap();
        let orbit = Orbit { center: n.target(), distance: 4.0, up: DVec3::Z }.cameras(1, (320, 180)).remove(0);
        assert!(near(camera.position_world(), orbit.position_world()) && (camera.fy - orbit.fy).abs() < 1e-9);
        assert!(camera.pixel_of(n.target()).is_some_and(|at| (at[0] - 160.0).hypot(at[1] - 90.0) < 1e-9));
    }

    #[test]
    fn orbiting_keeps_the_target_and_the_horizon_and_stops_at_the_poles() {
        let mut n = navigator();
        let (target, before) = (n.target(), n.eye());
        n.orbit([180.0, 0.0], 180.0);
        assert!(near(n.target(), target));
        // Half a circle about the vertical ends on the opposite side at the same height.
        let want = DVec3::new(2.0 * target.x - before.x, 2.0 * target.y - before.y, before.z);
        assert!(near(n.eye(), want), "{} {want}", n.eye());
        for k in 0..5000 {
            n.orbit([f64::from(k % 7), f64::from(k % 5) - 1.0], 180.0);
            let camera = n.camera(SIZE);
            camera.validate().unwrap();
            assert!(camera.rotation().row(0).z.abs() < 1e-9, "the horizon is level");
            assert!(near(n.target(), target) || n.target().distance(target) < 1e-6);
        }
        n.orbit([0.0, 1e6], 180.0);
        let forward = n.camera(SIZE).rotation().row(2);
        assert!((forward.dot(-DVec3::Z).acos() - POLE).abs() < 1e-6, "looks down from above: {forward}");
        n.orbit([0.0, -1e6], 180.0);
        let forward = n.camera(SIZE).rotation().row(2);
        assert!((forward.dot(DVec3::Z).acos() - POLE).abs() < 1e-6, "looks up from below: {forward}");
    }

    #[test]
    fn a_drag_turns_the_front_of_things_with_the_pointer() {
        let mut n = navigator();
        let front = n.target() + 0.5 * (n.eye() - n.target()).normalize();
        n.orbit([10.0, 0.0], 180.0);
        assert!(n.camera(SIZE).pixel_of(front).unwrap()[0] > 160.5);
        let mut n = navigator();
        n.orbit([0.0, 10.0], 180.0);
        assert!(n.camera(SIZE).pixel_of(front).unwrap()[1] > 90.5);
        // Looking around moves the view with the pointer, here by the cosine of 20 degrees less.
        let mut n = navigator();
        let target = n.target();
        n.look([9.0, 4.0], 180.0);
        let [x, y] = n.camera(SIZE).pixel_of(target).unwrap();
        assert!((x - 169.0).abs() < 1.0 && (y - 94.0).abs() < 0.5, "{x} {y}");
    }

    #[test]
    fn panning_and_zooming_keep_what_is_under_the_pointer() {
        let mut n = navigator();
        let target = n.target();
        n.pan([30.0, -12.0], 180.0);
        let [x, y] = n.camera(SIZE).pixel_of(target).unwrap();
        assert!((x - 190.0).abs() < 1e-9 && (y - 78.0).abs() < 1e-9);
        n.zoom(3.0, [190.0, 78.0], SIZE);
        let [x, y] = n.camera(SIZE).pixel_of(target).unwrap();
        assert!((x - 190.0).abs() < 1e-9 && (y - 78.0).abs() < 1e-9);
        assert!((n.distance() - 4.0 * 0.729).abs() < 1e-9);
        for steps in [1e9, -1e9] {
            n.zoom(steps, [0.0, 0.0], SIZE);
            n.camera(SIZE).validate().unwrap();
            assert!(n.distance() > 0.0 && n.distance().is_finite());
        }
    }

    #[test]
    fn fingers_that_spread_make_things_as_much_larger() {
        let mut n = navigator();
        let target = n.target();
        n.pan([30.0, -12.0], f64::from(SIZE[1]));
        n.pinch(0.25, n.camera(SIZE).pixel_of(target).unwrap(), SIZE);
        assert!((n.distance() - 4.0 / 1.25).abs() < 1e-9);
        let [x, y] = n.camera(SIZE).pixel_of(target).unwrap();
        assert!((x - 190.0).abs() < 1e-9 && (y - 78.0).abs() < 1e-9, "{x} {y}");
        let here = n.clone();
        n.pinch(f64::NAN, [0.0; 2], SIZE);
        assert_eq!(n, here);
        n.pinch(-5.0, [0.0; 2], SIZE);
        assert!(n.distance() > here.distance() && n.distance().is_finite());
    }

    #[test]
    fn flying_goes_where_the_camera_looks_at_the_speed_set() {
        let mut n = navigator();
        let (eye, forward) = (n.eye(), n.camera(SIZE).rotation().row(2));
        n.fly(Flight { forward: 1.0, ..Default::default() }, 0.5);
        assert!(near(n.eye(), eye + 2.0 * forward));
        n.change_speed(0.5);
        n.fly(Flight { up: -1.0, fast: true, ..Default::default() }, 1.0);
        assert!(near(n.eye(), eye + 2.0 * forward - 10.0 * DVec3::Z));
        let here = n.clone();
        n.fly(Flight::default(), 1.0);
        assert_eq!(n, here);
        assert!(Flight::default().is_still() && !Flight { right: 0.1, ..Default::default() }.is_still());
    }

    #[test]
    fn focus_centres_a_point_and_what_is_behind_changes_nothing() {
        let mut n = navigator();
        let point = n.target() + DVec3::new(0.3, -0.2, 0.4);
        n.focus(point);
        assert!(near(n.target(), point));
        let here = n.clone();
        let behind = n.eye() - n.camera(SIZE).rotation().row(2);
        n.focus(behind);
        n.focus(DVec3::NAN);
        n.set_fov_y(f64::NAN);
        assert_eq!(n, here);
        n.set_fov_y(10.0);
        assert_eq!(n.fov_y(), FIELDS_OF_VIEW[1]);
    }

    #[test]
    fn framing_shows_a_ball_ahead_or_behind_in_the_same_direction() {
        let start = navigator();
        let forward = start.camera(SIZE).rotation().row(2);
        for depth in [7.0, -9.0] {
            let centre = start.eye() + depth * forward + DVec3::new(0.5, 2.0, -1.0);
            let mut n = start.clone();
            n.frame(centre, 1.5);
            assert!(near(n.target(), centre) && near(n.camera(SIZE).rotation().row(2), forward), "{depth}");
            // The edge of the ball is at the edge of the view.
            assert!((1.5 / n.eye().distance(centre) - (0.5 * n.fov_y()).sin()).abs() < 1e-9);
            n.frame(start.target(), 0.0);
            assert!(near(n.target(), start.target()) && (n.distance() - n.eye().distance(n.target())).abs() < 1e-9);
        }
        let mut n = start.clone();
        n.frame(DVec3::NAN, 1.0);
        n.frame(DVec3::ZERO, f64::INFINITY);
        assert_eq!(n, start);
    }

    #[test]
    fn looking_along_an_axis_is_towards_the_point_that_is_given() {
        let mut n = navigator();
        for along in [DVec3::X, -DVec3::Y, DVec3::Z, -DVec3::Z] {
            let target = n.eye() - 2.0 * n.camera(SIZE).rotation().row(2);
            n.look_along(target, 3.0 * along, 5.0);
            n.camera(SIZE).validate().unwrap();
            assert!(near(n.target(), target) && near(n.eye(), target - 5.0 * along), "{along}");
        }
    }

    #[test]
    fn a_rolled_camera_is_taken_as_it_is() {
        let mut n = navigator();
        let mut camera = n.camera(SIZE);
        let roll = DMat3::from_rotation_z(0.4) * camera.rotation();
        let at = camera.position_world();
        for k in 0..3 {
            let row = roll.row(k);
            camera.view_from_world[k] = [row.x, row.y, row.z, -row.dot(at)];
        }
        n.stand_at(&camera);
        let got = n.camera(SIZE);
        assert!(
            (0..3).all(|k| got.rotation().row(k).distance(roll.row(k)) < 1e-9) && (got.fy - camera.fy).abs() < 1e-9
        );
    }
}
