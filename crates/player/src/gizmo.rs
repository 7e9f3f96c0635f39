//! Handles on the selection: arrows that move it, rings that turn it, and a circle that scales it. This module works
//! with a camera and pixels only; `hud_gizmo` draws the lines, and the window passes in the pointer. The window's
//! camera has interface points for pixels, so that handles have the same size on screens of any resolution.
//!
//! A drag gives the motion of the pointer since its start as an edit of the scene at that time. Where the view does not
//! determine a direction (an axis towards the camera, a plane seen edge-on), the handle is left out, or the drag keeps
//! its last value.

use std::f64::consts::PI;

use glam::DVec3;

use instgs_vk::scene::Camera;
use instgs_vk::scene::edit::{Edit, Selector, Turn};

/// Length of the arrows in pixels: longer than an object of a tenth of a 1080-line view, and short enough for a view of
/// 180 lines.
const ARROW_PX: f64 = 84.0;
/// Half the side of the square at the centre, pixels.
const SQUARE_PX: f64 = 10.0;
/// Where the arrows begin, outside of the square; pixels from the centre.
const ARROW_START_PX: f64 = 16.0;
/// Length of an arrow's barbs, pixels.
const BARB_PX: f64 = 10.0;
/// Radius of the rings and of the circle, pixels.
const RING_PX: f64 = 72.0;
/// Distance in pixels from its line within which a handle is grabbed.
const REACH_PX: f64 = 7.0;
/// An arrow whose projection is shorter is left out: its axis is within ten degrees of the line of sight.
const SHORTEST_PX: f64 = ARROW_PX / 6.0;
/// A ring's points are drawn up to this fraction of the radius behind its centre: the far half would clutter the view.
const BEHIND: f64 = 0.12;
/// Line segments of a whole ring; they deviate less than a pixel from the circle.
const RING_PIECES: usize = 64;
/// A ring whose plane is closer to the line of sight than this sine (12 degrees) is turned by pulling along it.
const EDGE_ON: f64 = 0.2;
/// Sine of 2 degrees. A ray closer to an axis or plane than this does not determine a point on it.
const GRAZING: f64 = 0.035;
/// Smallest scale factor of one drag.
const SMALLEST_FACTOR: f64 = 0.01;

/// The kind of handles that are shown.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GizmoMode {
    /// No handles are shown.
    Off,
    /// Three arrows and a square, which move.
    #[default]
    Move,
    /// Three rings, which turn.
    Turn,
    /// A circle, which scales.
    Scale,
}

/// A handle. Axes are 0 = x, 1 = y, 2 = z, of the world or of the given frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handle {
    /// Moves along an axis.
    Arrow(usize),
    /// Moves parallel to the image plane.
    Square,
    /// Turns about an axis.
    Ring(usize),
    /// Scales about the centre.
    Circle,
}

/// The polyline of a handle in the view.
#[derive(Clone, Debug, PartialEq)]
pub struct HandleLine {
    /// The handle that the line belongs to.
    pub handle: Handle,
    /// Vertices, pixels of the view.
    pub points_px: Vec<[f64; 2]>,
}

/// The handles as one frame shows them.
#[derive(Clone, Debug)]
pub struct Gizmo {
    mode: GizmoMode,
    /// The axes of the handles: unit vectors in world coordinates.
    axes: [DVec3; 3],
    centre: DVec3,
    centre_px: [f64; 2],
    camera: Camera,
    /// World units per pixel at the centre's depth.
    unit: f64,
}

/// The motion of a drag, as a change of the selection.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// Translation in world units.
    Move(DVec3),
    /// Rotation of each object about its centre.
    Turn(Turn),
    /// Scale factor of each object about its centre.
    Scale(f64),
}

/// A drag of a handle that is in progress.
#[derive(Clone, Debug)]
pub struct Drag {
    handle: Handle,
    centre: DVec3,
    measure: Measure,
}

/// The measured quantity, with its value at the start of the drag.
#[derive(Clone, Debug)]
enum Measure {
    /// Distance from the centre along an axis, world units.
    Along { axis: DVec3, from: f64 },
    /// The point under the pointer on the plane through the centre.
    Across { normal: DVec3, from: DVec3 },
    /// The direction from the centre in the ring's plane.
    Around { axis: DVec3, from: DVec3 },
    /// Pixels along the tangent of the ring.
    Pulled { axis: DVec3, along_px: [f64; 2], from_px: [f64; 2] },
    /// Pixels from the centre.
    Away { centre_px: [f64; 2], from: f64 },
}

impl Gizmo {
    /// Handles at a point in world coordinates; `None` behind the camera or with [`GizmoMode::Off`].
    pub fn new(mode: GizmoMode, centre: DVec3, camera: &Camera) -> Option<Self> {
        Self::along(DVec3::AXES, mode, centre, camera)
    }

    /// Like [`Gizmo::new`], with the given axes (orthogonal unit vectors) instead of the world's.
    pub fn along(axes: [DVec3; 3], mode: GizmoMode, centre: DVec3, camera: &Camera) -> Option<Self> {
        let centre_px = camera.pixel_of(centre).filter(|_| mode != GizmoMode::Off)?;
        let unit = camera.view_from_point(centre).z / camera.fy;
        Some(Self { mode, axes, centre, centre_px, camera: camera.clone(), unit })
    }

    /// The lines of all handles that the view determines.
    pub fn lines(&self) -> Vec<HandleLine> {
        let of = |handle: Handle| self.line(handle).map(|points_px| HandleLine { handle, points_px });
        self.handles().into_iter().filter_map(of).collect()
    }

    /// The nearest handle within `REACH_PX` of the pointer.
    pub fn handle_at(&self, at_px: [f64; 2]) -> Option<Handle> {
        let inside = (0..2).all(|k| (at_px[k] - self.centre_px[k]).abs() <= SQUARE_PX);
        if self.mode == GizmoMode::Move && inside {
            return Some(Handle::Square);
        }
        let near = |line: HandleLine| (distance_to_line(at_px, &line.points_px), line.handle);
        let nearest = self.lines().into_iter().map(near).min_by(|a, b| a.0.total_cmp(&b.0))?;
        (nearest.0 <= REACH_PX).then_some(nearest.1)
    }

    /// Begins to drag a handle; `None` if the pointer's position does not determine a value for it.
    pub fn grab(&self, handle: Handle, at_px: [f64; 2]) -> Option<Drag> {
        let ray = Ray::through(&self.camera, at_px);
        let centre = self.centre;
        let measure = match handle {
            Handle::Arrow(k) => {
                let axis = self.axes[k];
                Measure::Along { axis, from: ray.along(centre, axis)? }
            }
            Handle::Square => {
                let normal = self.camera.rotation().row(2);
                Measure::Across { normal, from: ray.across(centre, normal)? }
            }
            Handle::Ring(k) => {
                let axis = self.axes[k];
                match self.pull_direction(axis) {
                    Some(along_px) => Measure::Pulled { axis, along_px, from_px: at_px },
                    None => Measure::Around { axis, from: ray.across(centre, axis)? - centre },
                }
            }
            Handle::Circle => {
                Measure::Away { centre_px: self.centre_px, from: distance(at_px, self.centre_px).max(1.0) }
            }
        };
        Some(Drag { handle, centre, measure })
    }

    fn handles(&self) -> Vec<Handle> {
        match self.mode {
            GizmoMode::Off => Vec::new(),
            GizmoMode::Move => vec![Handle::Arrow(0), Handle::Arrow(1), Handle::Arrow(2), Handle::Square],
            GizmoMode::Turn => vec![Handle::Ring(0), Handle::Ring(1), Handle::Ring(2)],
            GizmoMode::Scale => vec![Handle::Circle],
        }
    }

    fn line(&self, handle: Handle) -> Option<Vec<[f64; 2]>> {
        let [x, y] = self.centre_px;
        match handle {
            Handle::Arrow(k) => self.arrow(self.axes[k]),
            Handle::Square => {
                let corners = [(-1.0, -1.0), (1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)];
                Some(corners.map(|(i, j)| [x + i * SQUARE_PX, y + j * SQUARE_PX]).into())
            }
            Handle::Ring(k) => self.ring(self.axes[k]),
            Handle::Circle => {
                let point = |k: usize| {
                    let angle = 2.0 * PI * k as f64 / RING_PIECES as f64;
                    [x + RING_PX * angle.cos(), y + RING_PX * angle.sin()]
                };
                Some((0..=RING_PIECES).map(point).collect())
            }
        }
    }

    /// From the edge of the square to the tip, and the barbs.
    fn arrow(&self, axis: DVec3) -> Option<Vec<[f64; 2]>> {
        let at = |px: f64| self.camera.pixel_of(self.centre + px * self.unit * axis);
        let (start, tip) = (at(ARROW_START_PX)?, at(ARROW_PX)?);
        let length = distance(self.centre_px, tip);
        if length < SHORTEST_PX {
            return None;
        }
        let back = [0, 1].map(|k| (self.centre_px[k] - tip[k]) / length * BARB_PX);
        let barb = |side: f64| [tip[0] + back[0] - 0.4 * side * back[1], tip[1] + back[1] + 0.4 * side * back[0]];
        Some(vec![start, tip, barb(1.0), barb(-1.0), tip])
    }

    /// The part of a ring that faces the camera.
    fn ring(&self, axis: DVec3) -> Option<Vec<[f64; 2]>> {
        let towards = (self.camera.position_world() - self.centre).try_normalize()?;
        let front = towards.reject_from_normalized(axis);
        // The direction towards the camera in the ring's plane; any direction if the ring faces the camera.
        let first = front.try_normalize().unwrap_or_else(|| axis.any_orthonormal_vector());
        let second = axis.cross(first);
        let half = if front.length() <= BEHIND { PI } else { (-BEHIND / front.length()).acos() };
        let point = |k: usize| {
            let angle = half * (2.0 * k as f64 / RING_PIECES as f64 - 1.0);
            let offset = angle.cos() * first + angle.sin() * second;
            self.camera.pixel_of(self.centre + RING_PX * self.unit * offset)
        };
        (0..=RING_PIECES).map(point).collect()
    }

    /// For a ring seen edge-on: the direction in the view in which its front moves for a positive angle, a unit vector.
    fn pull_direction(&self, axis: DVec3) -> Option<[f64; 2]> {
        let towards = (self.camera.position_world() - self.centre).try_normalize()?;
        if towards.dot(axis).abs() >= EDGE_ON {
            return None;
        }
        let front = towards.reject_from_normalized(axis).try_normalize()?;
        let to = self.camera.pixel_of(self.centre + self.unit * axis.cross(front))?;
        let length = distance(to, self.centre_px);
        (length > 0.0).then(|| [0, 1].map(|k| (to[k] - self.centre_px[k]) / length))
    }
}

impl Drag {
    /// The handle that is being dragged.
    pub fn handle(&self) -> Handle {
        self.handle
    }

    /// The motion from the start of the drag to the pointer at `to_px`; `None` where the view does not determine it.
    /// The camera may have moved since the start.
    pub fn motion(&self, camera: &Camera, to_px: [f64; 2]) -> Option<Motion> {
        let ray = Ray::through(camera, to_px);
        Some(match &self.measure {
            Measure::Along { axis, from } => Motion::Move((ray.along(self.centre, *axis)? - from) * *axis),
            Measure::Across { normal, from } => Motion::Move(ray.across(self.centre, *normal)? - *from),
            Measure::Around { axis, from } => {
                let to = ray.across(self.centre, *axis)? - self.centre;
                let angle = axis.dot(from.cross(to)).atan2(from.dot(to));
                Motion::Turn(Turn { axis: *axis, angle })
            }
            Measure::Pulled { axis, along_px, from_px } => {
                let way = (0..2).map(|k| (to_px[k] - from_px[k]) * along_px[k]).sum::<f64>();
                Motion::Turn(Turn { axis: *axis, angle: way / RING_PX })
            }
            Measure::Away { centre_px, from } => {
                Motion::Scale((distance(to_px, *centre_px) / from).max(SMALLEST_FACTOR))
            }
        })
    }
}

impl Motion {
    /// The edit that applies the motion to each selected instance about its own centre.
    pub fn edit(&self, which: Selector) -> Edit {
        match *self {
            Self::Move(by) => Edit::MoveBy { which, by },
            Self::Turn(turn) => Edit::Rotate { which, turn },
            Self::Scale(by) => Edit::Scale { which, by },
        }
    }
}

/// The viewing ray of a pixel, in world coordinates.
pub(super) struct Ray {
    origin: DVec3,
    /// A unit vector from the camera into the scene.
    direction: DVec3,
}

impl Ray {
    pub(super) fn through(camera: &Camera, at_px: [f64; 2]) -> Self {
        let view = DVec3::new((at_px[0] - camera.cx) / camera.fx, (at_px[1] - camera.cy) / camera.fy, 1.0);
        Self { origin: camera.position_world(), direction: (camera.rotation().transpose() * view).normalize() }
    }

    /// Signed distance along an axis (a unit vector) from `point` to where it is closest to the ray. `None` if they are
    /// almost parallel, or closest behind the camera.
    pub(super) fn along(&self, point: DVec3, axis: DVec3) -> Option<f64> {
        let cosine = axis.dot(self.direction);
        let sine2 = 1.0 - cosine * cosine;
        let way = point - self.origin;
        // Minimises |way + t axis - s direction|^2 over t and s.
        let t = (cosine * way.dot(self.direction) - way.dot(axis)) / sine2;
        let s = way.dot(self.direction) + t * cosine;
        (sine2 > GRAZING * GRAZING && s > 0.0).then_some(t)
    }

    /// Where the ray meets a plane with a unit normal. `None` if it grazes the plane or points away from it.
    fn across(&self, point: DVec3, normal: DVec3) -> Option<DVec3> {
        let sine = normal.dot(self.direction);
        let s = normal.dot(point - self.origin) / sine;
        (sine.abs() > GRAZING && s > 0.0).then(|| self.origin + s * self.direction)
    }
}

pub(super) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Distance from a point to a polyline, in the unit of both.
pub(super) fn distance_to_line(at: [f64; 2], points: &[[f64; 2]]) -> f64 {
    let to_piece = |piece: &[[f64; 2]]| {
        let (a, b) = (piece[0], piece[1]);
        let along = [b[0] - a[0], b[1] - a[1]];
        let length2 = along[0] * along[0] + along[1] * along[1];
        let dot = (at[0] - a[0]) * along[0] + (at[1] - a[1]) * along[1];
        let t = if length2 > 0.0 { (dot / length2).clamp(0.0, 1.0) } else { 0.0 };
        distance(at, [a[0] + t * along[0], a[1] + t * along[1]])
    };
    points.windows(2).map(to_piece).fold(f64::INFINITY, f64::min)
}

#[cfg(test)]
mod tests;
