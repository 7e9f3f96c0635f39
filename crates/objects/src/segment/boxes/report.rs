//! Report of masks made from boxes.

use serde::Serialize;

/// Source of an object's boxes.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum BoxSource {
    /// A box given in world coordinates.
    World,
    /// Boxes in photos that share an id.
    Photos,
    /// Boxes in photos without ids, joined by their position.
    Joined,
}

/// One object with a box.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct BoxObject {
    /// Id of the object in the masks.
    pub id: u32,
    /// Name of the kind of object, if given.
    pub category: Option<String>,
    /// Source of the object's boxes.
    pub source: BoxSource,
    /// Number of photos with a box of it.
    pub boxes: usize,
    /// Number of Gaussians with its label.
    pub gaussians: usize,
    /// Gaussians in its box that were removed as part of the ground below it; `None` if no plane was found below it, or
    /// none was searched.
    pub support: Option<usize>,
    /// Number of views whose mask contains it.
    pub views: usize,
}

/// Report of a run of masks from boxes.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct BoxReport {
    /// All objects, in order of their ids.
    pub objects: Vec<BoxObject>,
    /// Number of Gaussians in boxes that were removed as outliers of their object.
    pub far: usize,
    /// What was left out or is missing, one line each, for the user.
    pub notes: Vec<String>,
    /// Wall time in seconds.
    pub seconds: f64,
}
