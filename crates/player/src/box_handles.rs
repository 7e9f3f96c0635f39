//! Handles of a box in the view: a dot on each face, which moves the face, and the handles of [`super::gizmo`] aligned
//! with the box's axes.

use glam::{DQuat, DVec3};

use super::gizmo::{Drag, Gizmo, GizmoMode, Handle, HandleLine, Motion, Ray, distance, distance_to_line};
use instgs_vk::scene::{Camera, ObjectBox};

/// Distance in pixels within which the pointer grabs a dot or clicks an edge.
const REACH_PX: f64 = 8.0;
/// Smallest edge length that a drag can produce, relative to the longest edge: thinner boxes cannot be seen or grabbed.
const THINNEST: f64 = 0.01;
/// Near limit for drawing an edge, relative to the depth of its farther end: nearer parts are almost at the camera.
const NEAREST: f64 = 0.01;

/// A part of a box that can be dragged.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum BoxPart {
    /// The dot on a face: the box axis (0 to 2), and true for the face on the axis's positive side.
    Face(usize, bool),
    /// Moves, turns or scales the box.
    Handle(Handle),
}

/// The handles of one box as one frame shows them.
pub struct BoxHandles {
    object: ObjectBox,
    gizmo: Option<Gizmo>,
    camera: Camera,
}

/// A drag of one part of a box that is in progress.
#[derive(Clone, Debug)]
pub struct BoxDrag {
    part: BoxPart,
    start: ObjectBox,
    pull: Pull,
}

#[derive(Clone, Debug)]
enum Pull {
    /// Distance in world units along the line from the face's centre outwards.
    Face {
        middle: DVec3,
        outwards: DVec3,
        from: f64,
    },
    Gizmo(Drag),
}

impl BoxHandles {
    /// Handles of a box as the camera sees it.
    pub fn new(object: &ObjectBox, mode: GizmoMode, camera: &Camera) -> Self {
        let axes = DVec3::AXES.map(|axis| object.world_from_box * axis);
        let gizmo = Gizmo::along(axes, mode, object.center, camera);
        Self { object: object.clone(), gizmo, camera: camera.clone() }
    }

    /// The face dots that are in front of the camera, with their positions in pixels.
    pub fn dots(&self) -> Vec<(BoxPart, [f64; 2])> {
        let faces = (0..3).flat_map(|axis| [(axis, false), (axis, true)]);
        let dot = |(axis, far)| {
            let (middle, _) = face(&self.object, axis, far);
            Some((BoxPart::Face(axis, far), self.camera.pixel_of(middle)?))
        };
        faces.filter_map(dot).collect()
    }

    /// The lines of the gizmo handles, in pixels.
    pub fn lines(&self) -> Vec<HandleLine> {
        self.gizmo.as_ref().map_or_else(Vec::new, Gizmo::lines)
    }

    /// The part under the pointer. A dot wins over a line.
    pub fn part_at(&self, at_px: [f64; 2]) -> Option<BoxPart> {
        let near = |(part, dot_px)| (distance(at_px, dot_px), part);
        let dot = self.dots().into_iter().map(near).min_by(|a, b| a.0.total_cmp(&b.0));
        let handle = || self.gizmo.as_ref()?.handle_at(at_px).map(BoxPart::Handle);
        dot.filter(|dot| dot.0 <= REACH_PX).map(|dot| dot.1).or_else(handle)
    }

    /// Begins to drag a part; `None` if the pointer's position does not determine a value for it.
    pub fn grab(&self, part: BoxPart, at_px: [f64; 2]) -> Option<BoxDrag> {
        let pull = match part {
            BoxPart::Face(axis, far) => {
                let (middle, outwards) = face(&self.object, axis, far);
                Pull::Face { middle, outwards, from: Ray::through(&self.camera, at_px).along(middle, outwards)? }
            }
            BoxPart::Handle(handle) => Pull::Gizmo(self.gizmo.as_ref()?.grab(handle, at_px)?),
        };
        Some(BoxDrag { part, start: self.object.clone(), pull })
    }
}

impl BoxDrag {
    /// The part that is being dragged.
    pub fn part(&self) -> BoxPart {
        self.part
    }

    /// The box after the pointer has moved to `to_px`; `None` where the position does not determine a value.
    pub fn moved(&self, camera: &Camera, to_px: [f64; 2]) -> Option<ObjectBox> {
        match (&self.pull, self.part) {
            (Pull::Face { middle, outwards, from }, BoxPart::Face(axis, _)) => {
                let by = Ray::through(camera, to_px).along(*middle, *outwards)? - from;
                let mut size = self.start.size;
                size[axis] = (size[axis] + by).max(THINNEST * self.start.size.max_element());
                let grown = size[axis] - self.start.size[axis];
                // The opposite face stays in place.
                Some(ObjectBox { size, center: self.start.center + 0.5 * grown * *outwards, ..self.start.clone() })
            }
            (Pull::Gizmo(drag), _) => Some(after(&self.start, drag.motion(camera, to_px)?)),
            _ => None,
        }
    }
}

/// Centre of a face and its outward normal, both in world coordinates.
fn face(object: &ObjectBox, axis: usize, far: bool) -> (DVec3, DVec3) {
    let outwards = object.world_from_box * DVec3::AXES[axis] * if far { 1.0 } else { -1.0 };
    (object.center + 0.5 * object.size[axis] * outwards, outwards)
}

/// The box after a motion about its own centre.
pub fn after(object: &ObjectBox, motion: Motion) -> ObjectBox {
    let object = object.clone();
    match motion {
        Motion::Move(by) => ObjectBox { center: object.center + by, ..object },
        Motion::Turn(turn) => {
            let turned = DQuat::from_axis_angle(turn.axis, turn.angle) * object.world_from_box;
            ObjectBox { world_from_box: turned.normalize(), ..object }
        }
        Motion::Scale(by) => ObjectBox { size: object.size * by, ..object },
    }
}

/// The twelve edges of a box, clipped to the part in front of the camera, in pixels.
pub fn edges_px(object: &ObjectBox, camera: &Camera) -> Vec<[[f64; 2]; 2]> {
    let corners = object.corners();
    let ends = (0..8usize).flat_map(|a| (0..3).map(move |bit| (a, a | 1 << bit)).filter(|(a, b)| a != b));
    ends.filter_map(|(a, b)| segment_px(corners[a], corners[b], camera)).collect()
}

/// The part of a line segment in front of the camera, in pixels.
fn segment_px(a: DVec3, b: DVec3, camera: &Camera) -> Option<[[f64; 2]; 2]> {
    let depth = |p: DVec3| camera.view_from_point(p).z;
    let least = NEAREST * depth(a).max(depth(b));
    let clipped = |p: DVec3, other: DVec3| {
        let (z, far) = (depth(p), depth(other));
        if z >= least { p } else { p.lerp(other, (least - z) / (far - z)) }
    };
    Some([camera.pixel_of(clipped(a, b))?, camera.pixel_of(clipped(b, a))?])
}

/// The box with the edge nearest to the pointer, within `REACH_PX`.
pub fn box_at_edge<'a>(boxes: impl Iterator<Item = &'a ObjectBox>, camera: &Camera, at_px: [f64; 2]) -> Option<usize> {
    let far = |object: &ObjectBox| {
        let of = edges_px(object, camera).into_iter().map(|edge| distance_to_line(at_px, &edge));
        of.fold(f64::INFINITY, f64::min)
    };
    let nearest = boxes.map(far).enumerate().min_by(|a, b| a.1.total_cmp(&b.1))?;
    (nearest.1 <= REACH_PX).then_some(nearest.0)
}

#[cfg(test)]
mod tests {
    use super::*;
    use instgs_vk::scene::edit::Turn;

    fn camera() -> Camera {
        Camera::look_at("", DVec3::new(1.0, -8.0, 4.0), DVec3::ZERO, DVec3::Z, 0.6, (640, 480))
    }

    fn turned() -> ObjectBox {
        ObjectBox {
            id: 1,
            category: None,
            center: DVec3::new(0.2, 0.1, 0.3),
            size: DVec3::new(2.0, 1.0, 0.8),
            world_from_box: DQuat::from_rotation_z(0.4),
        }
    }

    /// Dragging a dot moves its face to the pointer and leaves the opposite face in place.
    #[test]
    fn a_dot_moves_its_face_only() {
        let (object, camera) = (turned(), camera());
        let handles = BoxHandles::new(&object, GizmoMode::Off, &camera);
        assert_eq!(handles.dots().len(), 6);
        for (part, dot_px) in handles.dots() {
            let BoxPart::Face(axis, far) = part else { panic!("{part:?}") };
            assert_eq!(handles.part_at([dot_px[0] + 3.0, dot_px[1]]), Some(part));
            let (middle, outwards) = face(&object, axis, far);
            let want = middle + 0.3 * outwards;
            let drag = handles.grab(part, dot_px).unwrap();
            let moved = drag.moved(&camera, camera.pixel_of(want).unwrap()).unwrap();
            assert!(face(&moved, axis, far).0.distance(want) < 1e-9, "{part:?}");
            assert!(face(&moved, axis, !far).0.distance(face(&object, axis, !far).0) < 1e-9);
            // Dragged through the opposite face: the box keeps a positive size.
            let beyond = middle - 5.0 * outwards;
            if let Some(flat) = camera.pixel_of(beyond).and_then(|px| drag.moved(&camera, px)) {
                assert!((flat.size[axis] - 0.02).abs() < 1e-12 && flat.size[(axis + 1) % 3] > 0.5);
            }
        }
    }

    #[test]
    fn the_other_handles_are_along_the_edges() {
        let (object, camera) = (turned(), camera());
        let handles = BoxHandles::new(&object, GizmoMode::Move, &camera);
        let along = object.world_from_box * DVec3::X;
        let at = camera.pixel_of(object.center + 0.5 * along).unwrap();
        assert_eq!(handles.part_at(at), Some(BoxPart::Handle(Handle::Arrow(0))));
        let drag = handles.grab(BoxPart::Handle(Handle::Arrow(0)), at).unwrap();
        let moved = drag.moved(&camera, camera.pixel_of(object.center + 0.9 * along).unwrap()).unwrap();
        assert!(moved.center.distance(object.center + 0.4 * along) < 1e-9 && moved.size == object.size);
        let turned = after(&object, Motion::Turn(Turn { axis: DVec3::Z, angle: 0.3 }));
        assert!(turned.world_from_box.angle_between(DQuat::from_rotation_z(0.7)) < 1e-6);
        assert_eq!(after(&object, Motion::Scale(2.0)).size, 2.0 * object.size);
    }

    #[test]
    fn edges_are_where_corners_are_and_end_before_the_camera() {
        let (object, camera) = (turned(), camera());
        let edges = edges_px(&object, &camera);
        let corner = camera.pixel_of(object.corners()[5]).unwrap();
        let at_corner = edges.iter().flatten().filter(|end| distance(**end, corner) < 1e-9).count();
        assert_eq!((edges.len(), at_corner), (12, 3));
        assert_eq!(box_at_edge([&object].into_iter(), &camera, corner), Some(0));
        assert_eq!(box_at_edge([&object].into_iter(), &camera, [1.0, 1.0]), None);
        // The camera is inside the box.
        let around = ObjectBox { size: DVec3::splat(40.0), ..object };
        let edges = edges_px(&around, &camera);
        assert!(!edges.is_empty() && edges.len() < 12 && edges.iter().flatten().flatten().all(|v| v.is_finite()));
    }
}
