//! Groups of repeated objects with their poses: the result of registration, the contents of `groups.json`.

use crate::math::similarity::Similarity;

/// One object of a group.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedInstance {
    /// The object's id in the masks, 1 or more.
    pub id: u32,
    /// Maps the group's template frame (axes of the reference object, origin at its centre) to the world.
    pub world_from_template: Similarity,
}

/// A group of objects that can share one template.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedGroup {
    /// Index of the template that they share.
    pub template_id: u32,
    /// The kind of object, for instance "chair".
    pub name: Option<String>,
    /// How well they match, 0..=1; `None` if unknown.
    pub score: Option<f64>,
    /// At least one object; the first is the reference.
    pub instances: Vec<PosedInstance>,
}
