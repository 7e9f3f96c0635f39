//! Boxes around objects: oriented boxes in the world and axis-aligned ones in a photo. The contents of `boxes.json`.

use std::collections::BTreeMap;

use glam::{DQuat, DVec3};

/// An oriented box around one object in the world.
#[derive(Clone, Debug, PartialEq)]
pub struct ObjectBox {
    /// The object's id, 1..=65535, as in masks.
    pub id: u32,
    /// The kind of object, for instance "car".
    pub category: Option<String>,
    /// Centre, world units.
    pub center: DVec3,
    /// Lengths of the edges along the box's axes, world units, above 0.
    pub size: DVec3,
    /// Unit quaternion that rotates the box's axes to the world's.
    pub world_from_box: DQuat,
}

impl ObjectBox {
    /// Transforms a world point to the box's axes, relative to its centre.
    pub fn local(&self, point_world: DVec3) -> DVec3 {
        self.world_from_box.inverse() * (point_world - self.center)
    }

    /// True for world points inside the box or on its faces.
    pub fn contains(&self, point_world: DVec3) -> bool {
        self.local(point_world).abs().cmple(0.5 * self.size).all()
    }

    /// The eight corners in the world; bit 0, 1, 2 of the index is the side along x, y, z.
    pub fn corners(&self) -> [DVec3; 8] {
        std::array::from_fn(|corner| {
            let side = |bit: usize| if corner >> bit & 1 == 1 { 0.5 } else { -0.5 };
            self.center + self.world_from_box * (self.size * DVec3::new(side(0), side(1), side(2)))
        })
    }
}

/// A rectangle around the visible part of an object in one photo.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewBox {
    /// The object's id, 1..=65535, if known; the same in all views.
    pub id: Option<u32>,
    /// The kind of object, for instance "car".
    pub category: Option<String>,
    /// A detector's confidence, 0..=1, if it came from one.
    pub score: Option<f64>,
    /// Left, top, right, bottom in pixels of the photo as it is stored; the left edge of its first pixel is 0.
    pub box_px: [f64; 4],
}

/// All boxes of a dataset.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Boxes {
    /// Boxes in the world, one per object.
    pub objects: Vec<ObjectBox>,
    /// Rectangles in photos, by view name (a camera's name).
    pub views: BTreeMap<String, Vec<ViewBox>>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_turned_box_holds_what_is_between_its_corners() {
        let turned = ObjectBox {
            id: 1,
            category: None,
            center: DVec3::new(5.0, 0.0, 1.0),
            size: DVec3::new(4.0, 2.0, 1.0),
            world_from_box: DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2),
        };
        // The long edge is along the world's y.
        assert!(turned.contains(DVec3::new(5.0, 1.9, 1.0)) && turned.contains(DVec3::new(4.1, 0.0, 1.4)));
        assert!(!turned.contains(DVec3::new(6.9, 0.0, 1.0)) && !turned.contains(DVec3::new(5.0, 0.0, 1.6)));
        let corners = turned.corners();
        assert!((corners[0] - DVec3::new(6.0, -2.0, 0.5)).length() < 1e-12, "{corners:?}");
        assert!((corners[7] - DVec3::new(4.0, 2.0, 1.5)).length() < 1e-12, "{corners:?}");
        assert!((turned.local(corners[1]) - DVec3::new(2.0, -1.0, -0.5)).length() < 1e-12);
    }
}
