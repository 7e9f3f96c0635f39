//! A camera path that the user flew, sampled at equal times.

use glam::{DMat3, DQuat, DVec3};

use instgs_vk::scene::Camera;

/// Frame rate of the sampled path, frames per second.
pub const PATH_FPS: f64 = 30.0;
/// A longer interval between frames means that the camera stood still: frames are drawn only while something changes.
const LONGEST_MOVE_SECONDS: f64 = 0.25;

/// The cameras of a recorded path.
#[derive(Clone, Debug, Default)]
pub struct Recording {
    /// Time in seconds since a fixed moment, increasing, and the camera from then on.
    shown: Vec<(f64, Camera)>,
}

impl Recording {
    /// The path through cameras at times in seconds, which increase; it moves all the time, however far these are apart.
    pub fn through(cameras: impl IntoIterator<Item = (f64, Camera)>) -> Self {
        Self { shown: cameras.into_iter().collect() }
    }

    /// Records the camera of a frame that was shown at a time in seconds; times that do not increase are ignored.
    pub fn push(&mut self, seconds: f64, camera: Camera) {
        let Some((last, still)) = self.shown.last() else { return self.shown.push((seconds, camera)) };
        if seconds <= *last {
            return;
        }
        if seconds - last > LONGEST_MOVE_SECONDS {
            // The camera stood still until just before.
            let still = still.clone();
            self.shown.push((seconds - LONGEST_MOVE_SECONDS / 2.0, still));
        }
        self.shown.push((seconds, camera));
    }

    /// Duration from the first frame to the last, seconds.
    pub fn seconds(&self) -> f64 {
        self.shown.last().map_or(0.0, |(last, _)| last - self.shown[0].0)
    }

    /// The path sampled at [`PATH_FPS`], first and last frame included. Between frames, positions are interpolated
    /// linearly and rotations spherically. All cameras have the image size of the first. Empty without frames.
    pub fn cameras(&self) -> Vec<Camera> {
        let Some((start, first)) = self.shown.first() else { return Vec::new() };
        // The tolerance keeps a rounding error from adding a sample.
        let pictures = (self.seconds() * PATH_FPS - 1e-6).ceil() as usize + 1;
        let size = [first.width, first.height];
        let at = |k: usize| {
            let camera = self.at(start + (k as f64 / PATH_FPS).min(self.seconds()));
            Camera { name: format!("{k:05}"), ..camera.in_shape(size) }
        };
        (0..pictures).map(at).collect()
    }

    fn at(&self, seconds: f64) -> Camera {
        let next = self.shown.partition_point(|(then, _)| *then <= seconds).clamp(1, self.shown.len());
        let (t0, a) = &self.shown[next - 1];
        let Some((t1, b)) = self.shown.get(next) else { return a.clone() };
        between(a, b, (seconds - t0) / (t1 - t0))
    }
}

/// A camera between two, with the first one's image size; `part` is the interpolation weight, 0 to 1.
fn between(a: &Camera, b: &Camera, part: f64) -> Camera {
    let b = b.in_shape([a.width, a.height]);
    let mix = |x: f64, y: f64| x + part * (y - x);
    let rotation = |camera: &Camera| DQuat::from_mat3(&camera.rotation());
    let turned = DMat3::from_quat(rotation(a).slerp(rotation(&b), part));
    let eye = a.position_world().lerp(b.position_world(), part);
    let shift: DVec3 = -(turned * eye);
    let row = |k: usize| [turned.x_axis[k], turned.y_axis[k], turned.z_axis[k], shift[k]];
    Camera {
        fx: mix(a.fx, b.fx),
        fy: mix(a.fy, b.fy),
        cx: mix(a.cx, b.cx),
        cy: mix(a.cy, b.cy),
        view_from_world: [row(0), row(1), row(2), [0.0, 0.0, 0.0, 1.0]],
        ..a.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::navigation::Navigator;
    use instgs_vk::scene::trajectory::Orbit;

    fn navigator() -> Navigator {
        Navigator::around(&Orbit { center: DVec3::ZERO, distance: 3.0, up: DVec3::Z })
    }

    #[test]
    fn a_turn_is_a_turn_at_equal_times() {
        let (mut n, mut recording) = (navigator(), Recording::default());
        let start = n.clone();
        assert!(recording.cameras().is_empty());
        // Uneven frames of an even pan: 10 px per 0.1 s.
        for (seconds, px) in [(5.0, 0.0), (5.05, 5.0), (5.2, 20.0)] {
            n = start.clone();
            n.look([px, 0.0], 180.0);
            recording.push(seconds, n.camera([160, 90]));
        }
        let cameras = recording.cameras();
        assert_eq!(cameras.len(), 7);
        for (k, camera) in cameras.iter().enumerate() {
            let mut want = start.clone();
            want.look([(100.0 * k as f64 / PATH_FPS).min(20.0), 0.0], 180.0);
            let want = want.camera([160, 90]);
            let worst = camera.view_from_world.as_flattened().iter().zip(want.view_from_world.as_flattened());
            let worst = worst.map(|(a, b)| (a - b).abs()).fold(0.0, f64::max);
            assert!(worst < 1e-9 && (camera.width, camera.fx) == (160, want.fx), "{k}: {worst}");
        }
    }

    #[test]
    fn another_shape_squeezes_nothing() {
        let n = navigator();
        let camera = n.camera([160, 90]);
        for size in [[160, 90], [64, 36], [100, 100], [90, 160]] {
            let shaped = camera.in_shape(size);
            let want = n.camera(size);
            assert_eq!((shaped.width, shaped.height), (size[0], size[1]));
            assert_eq!((shaped.fx, shaped.view_from_world), (shaped.fy, want.view_from_world), "{size:?}");
            let off = [shaped.fx - want.fx, shaped.cx - want.cx, shaped.cy - want.cy];
            assert!(off.iter().all(|px| px.abs() < 1e-9), "{size:?}: {off:?}");
        }
        // What a photograph has besides stays: at its own size it is the same camera.
        let lens = Camera { fx: 1.1 * camera.fx, cx: 77.0, cy: 44.0, ..camera };
        assert_eq!(lens.in_shape([160, 90]), lens);
        let square = lens.in_shape([180, 180]);
        assert_eq!((square.fx, square.fy, square.cx, square.cy), (2.0 * lens.fx, 2.0 * lens.fy, 84.0, 88.0));
        // A path has the shape of its first frame, also where the window had another one later.
        let mut recording = Recording::default();
        recording.push(0.0, n.camera([160, 90]));
        recording.push(0.1, n.camera([90, 90]));
        assert!(recording.cameras().iter().all(|c| c.width == 160 && (c.fx - c.fy).abs() < 1e-9));
    }

    /// A jump after a pause stays a jump, and decreasing times are ignored.
    #[test]
    fn pauses_stay_still() {
        let (mut n, mut recording) = (navigator(), Recording::default());
        let first = n.camera([160, 90]);
        recording.push(0.0, first.clone());
        n.pan([50.0, 0.0], 90.0);
        recording.push(2.0, n.camera([80, 45]));
        recording.push(1.0, first.clone());
        let cameras = recording.cameras();
        assert_eq!((cameras.len(), recording.seconds()), (61, 2.0));
        let moved = cameras.iter().filter(|c| c.position_world().distance(first.position_world()) > 1e-9).count();
        assert_eq!(moved, 4, "pictures within the last eighth of a second");
        let end = cameras.last().unwrap();
        assert!(end.position_world().distance(n.eye()) < 1e-12 && end.width == 160);
    }
}
