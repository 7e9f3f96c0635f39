//! Repeated objects as detection leaves them: which ones are alike, and where each stands. `groups.json` in memory.

use crate::math::similarity::Similarity;

/// One object of a group.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedInstance {
    /// Its id in the masks, 1 or more.
    pub id: u32,
    /// From the group's template frame (the reference instance's orientation, centred on it) into the world.
    pub world_from_template: Similarity,
}

/// Objects that can share one template.
#[derive(Clone, Debug, PartialEq)]
pub struct PosedGroup {
    /// Which template they share.
    pub template_id: u32,
    /// What they are, for instance "chair".
    pub name: Option<String>,
    /// How well they match, 0..=1; `None` if nobody said.
    pub score: Option<f64>,
    /// At least one; the first is the reference.
    pub instances: Vec<PosedInstance>,
}
