//! Tests of the handles with cameras whose pixels can be computed by hand.

use super::*;

const CENTRE: DVec3 = DVec3::new(0.4, -0.2, 0.3);
const SIZE: (u32, u32) = (800, 600);

/// A camera at `distance` that looks at the centre from a direction, upright where possible.
fn camera(from: DVec3, distance: f64) -> Camera {
    let up = if from.normalize().z.abs() > 0.9 { DVec3::Y } else { DVec3::Z };
    Camera::look_at("", CENTRE + distance * from.normalize(), CENTRE, up, 0.8, SIZE)
}

fn oblique() -> Camera {
    camera(DVec3::new(1.0, -1.3, 0.8), 3.0)
}

fn gizmo(mode: GizmoMode, camera: &Camera) -> Gizmo {
    Gizmo::new(mode, CENTRE, camera).unwrap()
}

fn mean(points: &[[f64; 2]]) -> [f64; 2] {
    [0, 1].map(|k| points.iter().map(|p| p[k]).sum::<f64>() / points.len() as f64)
}

#[test]
fn handles_have_the_same_size_on_the_screen_from_near_and_far() {
    for mode in [GizmoMode::Move, GizmoMode::Turn, GizmoMode::Scale] {
        let extent = |distance: f64| {
            let lines = gizmo(mode, &camera(DVec3::new(1.0, -1.3, 0.8), distance)).lines();
            let points = lines.iter().flat_map(|line| &line.points_px);
            points.map(|p| super::distance(*p, [400.0, 300.0])).fold(0.0, f64::max)
        };
        let (near, far) = (extent(0.5), extent(500.0));
        assert!(near > 60.0 && near < 120.0, "{mode:?} {near}");
        assert!((near - far).abs() < 1e-6, "{mode:?} {near} {far}");
    }
    assert!(Gizmo::new(GizmoMode::Off, CENTRE, &oblique()).is_none());
    let behind = CENTRE + 4.0 * DVec3::new(1.0, -1.3, 0.8);
    assert!(Gizmo::new(GizmoMode::Move, behind, &oblique()).is_none(), "behind the camera");
}

#[test]
fn each_handle_is_hit_on_its_line_and_nowhere_else() {
    let camera = oblique();
    for mode in [GizmoMode::Move, GizmoMode::Turn, GizmoMode::Scale] {
        let gizmo = gizmo(mode, &camera);
        let lines = gizmo.lines();
        assert_eq!(lines.len(), [0, 4, 3, 1][mode as usize]);
        for line in &lines {
            // The tip of an arrow, or a point of a ring that no other ring crosses.
            let at = match line.handle {
                Handle::Arrow(_) => line.points_px[1],
                Handle::Square => mean(&line.points_px[..4]),
                Handle::Ring(_) | Handle::Circle => line.points_px[2],
            };
            assert_eq!(gizmo.handle_at(at), Some(line.handle));
            assert_eq!(gizmo.handle_at([at[0] + 4.0, at[1] + 3.0]), Some(line.handle), "within reach");
        }
        assert_eq!(gizmo.handle_at([400.0, 180.0]), None);
        assert_eq!(gizmo.handle_at([20.0, 20.0]), None);
        let centre = gizmo.handle_at([400.0, 300.0]);
        let want = if mode == GizmoMode::Move { Some(Handle::Square) } else { None };
        assert_eq!(centre, want, "{mode:?}");
    }
}

/// The dragged point stays under the pointer.
#[test]
fn an_arrow_follows_the_pointer_along_its_axis() {
    let camera = oblique();
    let gizmo = gizmo(GizmoMode::Move, &camera);
    for (k, axis) in DVec3::AXES.into_iter().enumerate() {
        let from = CENTRE + 0.2 * axis;
        let drag = gizmo.grab(Handle::Arrow(k), camera.pixel_of(from).unwrap()).unwrap();
        assert_eq!(drag.handle(), Handle::Arrow(k));
        for by in [-0.7, 0.0, 0.4, 1.1] {
            let to = camera.pixel_of(from + by * axis).unwrap();
            let Some(Motion::Move(got)) = drag.motion(&camera, to) else { panic!("a move") };
            assert!(got.distance(by * axis) < 1e-9, "{k} {by} {got}");
            // The camera may fly on during a drag.
            let later = super::tests::camera(DVec3::new(1.2, -1.0, 0.6), 2.5);
            let Some(Motion::Move(got)) = drag.motion(&later, later.pixel_of(from + by * axis).unwrap()) else {
                panic!("a move")
            };
            assert!(got.distance(by * axis) < 1e-9);
        }
        // Beside the axis only the component along it counts, and the motion stays finite.
        let [x, y] = camera.pixel_of(from).unwrap();
        let Some(Motion::Move(got)) = drag.motion(&camera, [x + 30.0, y - 20.0]) else { panic!("a move") };
        assert!(got.is_finite() && got.reject_from_normalized(axis).length() < 1e-12);
    }
}

#[test]
fn the_square_moves_in_the_plane_of_the_screen() {
    let camera = oblique();
    let drag = gizmo(GizmoMode::Move, &camera).grab(Handle::Square, [400.0, 300.0]).unwrap();
    let Some(Motion::Move(by)) = drag.motion(&camera, [437.0, 280.0]) else { panic!("a move") };
    let at = camera.pixel_of(CENTRE + by).unwrap();
    assert!(super::distance(at, [437.0, 280.0]) < 1e-9);
    assert!((camera.view_from_point(CENTRE + by).z - 3.0).abs() < 1e-12, "as deep as before");
}

/// Dragging a ring's point to another one turns by the angle between them.
#[test]
fn a_ring_turns_a_point_to_the_pointer() {
    let camera = oblique();
    let gizmo = gizmo(GizmoMode::Turn, &camera);
    for (k, axis) in DVec3::AXES.into_iter().enumerate() {
        let first = axis.any_orthonormal_vector();
        let at = |angle: f64| {
            let turned = glam::DMat3::from_axis_angle(axis, angle) * first;
            camera.pixel_of(CENTRE + 0.3 * turned).unwrap()
        };
        let drag = gizmo.grab(Handle::Ring(k), at(0.2)).unwrap();
        for angle in [-2.9, -0.5, 0.0, 0.4, 3.0] {
            let Some(Motion::Turn(turn)) = drag.motion(&camera, at(0.2 + angle)) else { panic!("a turn") };
            assert!(turn.axis == axis && (turn.angle - angle).abs() < 1e-9, "{k} {angle} {turn:?}");
        }
    }
}

#[test]
fn the_circle_scales_by_the_distance_from_the_centre() {
    let camera = oblique();
    let drag = gizmo(GizmoMode::Scale, &camera).grab(Handle::Circle, [472.0, 300.0]).unwrap();
    for (to, want) in [([544.0, 300.0], 2.0), ([400.0, 264.0], 0.5), ([400.0, 300.0], SMALLEST_FACTOR)] {
        let Some(Motion::Scale(got)) = drag.motion(&camera, to) else { panic!("a scale") };
        assert!((got - want).abs() < 1e-9, "{got} {want}");
    }
}

/// Where the view does not determine a direction there is no handle, or the drag keeps its value.
#[test]
fn degenerate_views_give_no_wild_motions() {
    let along_x = camera(DVec3::X, 3.0);
    let gizmo = gizmo(GizmoMode::Move, &along_x);
    let handles: Vec<Handle> = gizmo.lines().into_iter().map(|line| line.handle).collect();
    assert_eq!(handles, [Handle::Arrow(1), Handle::Arrow(2), Handle::Square], "x points at the camera");
    assert!(gizmo.grab(Handle::Arrow(0), [400.0, 300.0]).is_none());
    // Towards and beyond the vanishing point of the axis: bounded, then nothing, never a jump behind the camera.
    let oblique = oblique();
    let drag = Gizmo::new(GizmoMode::Move, CENTRE, &oblique).unwrap().grab(Handle::Arrow(0), [400.0, 300.0]).unwrap();
    let vanishing = oblique.pixel_of(CENTRE - 1e6 * DVec3::X).unwrap();
    for part in [0.5, 0.9, 0.99, 1.0, 1.01, 1.5, 3.0] {
        let to = [400.0 + part * (vanishing[0] - 400.0), 300.0 + part * (vanishing[1] - 300.0)];
        match drag.motion(&oblique, to) {
            Some(Motion::Move(by)) => assert!(part < 1.0 && by.x < 0.0 && by.length() < 100.0, "{part} {by}"),
            other => assert!(part >= 0.9 && other.is_none(), "{part} {other:?}"),
        }
    }
}

#[test]
fn a_ring_seen_from_its_edge_is_turned_by_pulling() {
    // The z axis points up in the view, and its ring is a horizontal line.
    let level = camera(DVec3::X, 3.0);
    let gizmo = gizmo(GizmoMode::Turn, &level);
    let line = gizmo.lines().into_iter().find(|line| line.handle == Handle::Ring(2)).unwrap();
    let heights = line.points_px.iter().map(|p| p[1]);
    assert!(heights.clone().fold(0.0, f64::max) - heights.fold(f64::INFINITY, f64::min) < 1.0);
    let drag = gizmo.grab(Handle::Ring(2), [400.0, 300.0]).unwrap();
    let Some(Motion::Turn(turn)) = drag.motion(&level, [400.0 + 0.1 * RING_PX, 333.0]) else { panic!("a turn") };
    assert!((turn.angle - 0.1).abs() < 1e-9, "the front goes to the right with the pointer: {turn:?}");
    let front = CENTRE + 0.3 * DVec3::X;
    let after = CENTRE + glam::DMat3::from_axis_angle(turn.axis, turn.angle) * (front - CENTRE);
    assert!(level.pixel_of(after).unwrap()[0] > level.pixel_of(front).unwrap()[0]);
    // The far half is not drawn; the ring that faces the camera is drawn whole.
    let facing = gizmo.lines().into_iter().find(|line| line.handle == Handle::Ring(0)).unwrap();
    let turned = super::distance(facing.points_px[0], facing.points_px[RING_PIECES]);
    assert!(turned < 1e-6, "closed: {turned}");
    assert!(super::distance(line.points_px[0], line.points_px[RING_PIECES]) > 1.9 * RING_PX);
}

#[test]
fn motions_are_edits_of_what_is_chosen() {
    let which = Selector::Indices(vec![1, 2]);
    let turn = Turn { axis: DVec3::Y, angle: 0.2 };
    let by = DVec3::new(1.0, 0.0, 2.0);
    assert_eq!(Motion::Move(by).edit(which.clone()), Edit::MoveBy { which: which.clone(), by });
    assert_eq!(Motion::Turn(turn).edit(which.clone()), Edit::Rotate { which: which.clone(), turn });
    assert_eq!(Motion::Scale(2.0).edit(which.clone()), Edit::Scale { which, by: 2.0 });
}
