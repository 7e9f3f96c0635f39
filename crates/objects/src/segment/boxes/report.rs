//! What became of boxes.

use serde::Serialize;

/// Where an object's box is.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "snake_case")]
pub enum BoxSource {
    /// In the world.
    World,
    /// In photos, with its id.
    Photos,
    /// In photos without ids: joined by where they are.
    Joined,
}

/// One object.
#[derive(Clone, Debug, PartialEq, Eq, Serialize)]
pub struct BoxObject {
    /// Its id in the masks.
    pub id: u32,
    /// What it is.
    pub category: Option<String>,
    /// Where its box is.
    pub source: BoxSource,
    /// Photos with a box of it.
    pub boxes: usize,
    /// Gaussians that are its own.
    pub gaussians: usize,
    /// Gaussians in its box that are of what it stands on, and were left out; `None` if nothing flat was found below it,
    /// or not looked for.
    pub support: Option<usize>,
    /// Views whose mask has it.
    pub views: usize,
}

/// All of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct BoxReport {
    /// By id.
    pub objects: Vec<BoxObject>,
    /// Gaussians in boxes that are far from the rest of their object, and were left out.
    pub far: usize,
    /// What was left out or is missing, one line each, for the user.
    pub notes: Vec<String>,
    /// Wall time.
    pub seconds: f64,
}
