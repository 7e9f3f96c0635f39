//! Handles on what is chosen: arrows that move it, rings that turn it, a circle that scales it. Knows a camera and pixels
//! only; `hud` draws the lines, and the window hands in where the pointer is. The window's camera has points of the interface
//! for pixels, so that handles are as large on a fine screen as on a coarse one.
//!
//! A drag says how far the pointer went since it began, as an edit of the scene as it was then. Where a direction cannot be
//! told from the picture (an axis that points at the camera, a plane seen from its edge) there is no handle, or the drag
//! stays as it was.

use std::f64::consts::PI;

use glam::DVec3;

use instgs_vk::scene::Camera;
use instgs_vk::scene::edit::{Edit, Selector, Turn};

/// Length of the arrows, pixels: they reach out of an object of a tenth of a picture of 1080 lines, and fit into one of 180.
const ARROW_PX: f64 = 84.0;
/// Half the side of the square in the middle, pixels.
const SQUARE_PX: f64 = 10.0;
/// The arrows begin beyond the square.
const ARROW_START_PX: f64 = 16.0;
/// Length of an arrow's barbs, pixels.
const BARB_PX: f64 = 10.0;
/// Radius of rings and circle, pixels.
const RING_PX: f64 = 72.0;
/// A handle is grabbed within so many pixels of its line.
const REACH_PX: f64 = 7.0;
/// An arrow that is foreshortened to less is not there: ten degrees from the line of sight.
const SHORTEST_PX: f64 = ARROW_PX / 6.0;
/// A ring is drawn where its points are no farther behind its centre than this part of the radius: the far half would only
/// be in the way.
const BEHIND: f64 = 0.12;
/// Pieces of a whole ring; less than a pixel from the circle.
const RING_PIECES: usize = 64;
/// A ring whose plane is nearer to the line of sight than this sine (12 degrees) is turned by pulling along it.
const EDGE_ON: f64 = 0.2;
/// Sine of 2 degrees: rays nearer to an axis, or to a plane, say nothing about places on it.
const GRAZING: f64 = 0.035;
/// Least factor of one drag.
const SMALLEST_FACTOR: f64 = 0.01;

/// Which handles there are.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum GizmoMode {
    /// None.
    Off,
    /// Three arrows and a square.
    #[default]
    Move,
    /// Three rings.
    Turn,
    /// A circle.
    Scale,
}

/// Something to drag. Axes are those of the world, or those given: 0 = x, 1 = y, 2 = z.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handle {
    /// Moves along an axis.
    Arrow(usize),
    /// Moves in the plane of the screen.
    Square,
    /// Turns about an axis.
    Ring(usize),
    /// Scales.
    Circle,
}

/// The line of a handle.
#[derive(Clone, Debug, PartialEq)]
pub struct HandleLine {
    /// Whose.
    pub handle: Handle,
    /// Corners, pixels of the picture.
    pub points_px: Vec<[f64; 2]>,
}

/// The handles of one picture.
#[derive(Clone, Debug)]
pub struct Gizmo {
    mode: GizmoMode,
    /// Unit vectors of the world.
    axes: [DVec3; 3],
    centre: DVec3,
    centre_px: [f64; 2],
    camera: Camera,
    /// World units per pixel at the centre's depth.
    unit: f64,
}

/// How far the pointer went, as a change of what is chosen.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Motion {
    /// World units.
    Move(DVec3),
    /// About centres.
    Turn(Turn),
    /// About centres.
    Scale(f64),
}

/// A handle that is held.
#[derive(Clone, Debug)]
pub struct Drag {
    handle: Handle,
    centre: DVec3,
    measure: Measure,
}

/// What is measured, and what it was at the begin.
#[derive(Clone, Debug)]
enum Measure {
    /// World units from the centre along an axis.
    Along { axis: DVec3, from: f64 },
    /// The point under the pointer of the plane through the centre.
    Across { normal: DVec3, from: DVec3 },
    /// The direction from the centre in the ring's plane.
    Around { axis: DVec3, from: DVec3 },
    /// Pixels along the ring's line.
    Pulled { axis: DVec3, along_px: [f64; 2], from_px: [f64; 2] },
    /// Pixels from the centre.
    Away { centre_px: [f64; 2], from: f64 },
}

impl Gizmo {
    /// Handles at a place of the world; `None` behind the camera, and without a mode.
    pub fn new(mode: GizmoMode, centre: DVec3, camera: &Camera) -> Option<Self> {
        Self::along(DVec3::AXES, mode, centre, camera)
    }

    /// As [`Gizmo::new`], with other axes than the world's: three unit vectors at right angles.
    pub fn along(axes: [DVec3; 3], mode: GizmoMode, centre: DVec3, camera: &Camera) -> Option<Self> {
        let centre_px = camera.pixel_of(centre).filter(|_| mode != GizmoMode::Off)?;
        let unit = camera.view_from_point(centre).z / camera.fy;
        Some(Self { mode, axes, centre, centre_px, camera: camera.clone(), unit })
    }

    /// The lines of all handles that can be told from the picture.
    pub fn lines(&self) -> Vec<HandleLine> {
        let of = |handle: Handle| self.line(handle).map(|points_px| HandleLine { handle, points_px });
        self.handles().into_iter().filter_map(of).collect()
    }

    /// The handle under the pointer: the nearest one within reach.
    pub fn handle_at(&self, at_px: [f64; 2]) -> Option<Handle> {
        let inside = (0..2).all(|k| (at_px[k] - self.centre_px[k]).abs() <= SQUARE_PX);
        if self.mode == GizmoMode::Move && inside {
            return Some(Handle::Square);
        }
        let near = |line: HandleLine| (distance_to_line(at_px, &line.points_px), line.handle);
        let nearest = self.lines().into_iter().map(near).min_by(|a, b| a.0.total_cmp(&b.0))?;
        (nearest.0 <= REACH_PX).then_some(nearest.1)
    }

    /// Begins to drag a handle; `None` if the place says nothing about it.
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

    /// From beyond the square to the tip, and the barbs.
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

    /// The part of a ring that is in front.
    fn ring(&self, axis: DVec3) -> Option<Vec<[f64; 2]>> {
        let towards = (self.camera.position_world() - self.centre).try_normalize()?;
        let front = towards.reject_from_normalized(axis);
        // Towards the camera, in the ring's plane; any direction if the ring faces it.
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

    /// For a ring seen from its edge: where its front goes when it turns by a positive angle, a unit vector in the picture.
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
    /// Which handle is held.
    pub fn handle(&self) -> Handle {
        self.handle
    }

    /// What the pointer's way from the begin to a place means; `None` where that cannot be told. The camera may have moved.
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
    /// The edit of some instances, each treated alike about its own centre.
    pub fn edit(&self, which: Selector) -> Edit {
        match *self {
            Self::Move(by) => Edit::MoveBy { which, by },
            Self::Turn(turn) => Edit::Rotate { which, turn },
            Self::Scale(by) => Edit::Scale { which, by },
        }
    }
}

/// What a pixel may show.
pub(super) struct Ray {
    origin: DVec3,
    /// A unit vector.
    direction: DVec3,
}

impl Ray {
    pub(super) fn through(camera: &Camera, at_px: [f64; 2]) -> Self {
        let view = DVec3::new((at_px[0] - camera.cx) / camera.fx, (at_px[1] - camera.cy) / camera.fy, 1.0);
        Self { origin: camera.position_world(), direction: (camera.rotation().transpose() * view).normalize() }
    }

    /// How far along an axis (a unit vector) from a point the line is nearest to the ray. `None` if they are nearly
    /// parallel, or nearest behind the camera.
    pub(super) fn along(&self, point: DVec3, axis: DVec3) -> Option<f64> {
        let cosine = axis.dot(self.direction);
        let sine2 = 1.0 - cosine * cosine;
        let way = point - self.origin;
        // Least |way + t axis - s direction|^2 over t and s.
        let t = (cosine * way.dot(self.direction) - way.dot(axis)) / sine2;
        let s = way.dot(self.direction) + t * cosine;
        (sine2 > GRAZING * GRAZING && s > 0.0).then_some(t)
    }

    /// Where the ray meets a plane with a unit normal. `None` if it grazes it, or goes the other way.
    fn across(&self, point: DVec3, normal: DVec3) -> Option<DVec3> {
        let sine = normal.dot(self.direction);
        let s = normal.dot(point - self.origin) / sine;
        (sine.abs() > GRAZING && s > 0.0).then(|| self.origin + s * self.direction)
    }
}

pub(super) fn distance(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// From a point to the nearest one of a line of straight pieces.
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
