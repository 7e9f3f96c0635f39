//! Report of consensus, for `prepared.json`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// One object that was found.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ObjectReport {
    /// Number of the object, from 1.
    pub id: u32,
    /// Most frequent name of its masks in `categories.json`, if any.
    pub category: Option<String>,
    /// Number of views in which it has a mask.
    pub views: usize,
    /// Number of its masks; above the number of views where it is in pieces.
    pub masks: usize,
    /// Gaussians with its label; 0 until Gaussians are labelled.
    pub gaussians: usize,
}

/// Statistics of a run of consensus.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ConsensusReport {
    /// Whether ids mean the same object in every view and were kept.
    pub ids_agree: bool,
    /// Part of the cases in which the mask that shows a mask's points in another view has the same id, 0 to 1.
    pub agreement: f64,
    /// Gaussians that were used.
    pub points: usize,
    /// Number of masks: an id in a view is one.
    pub masks: usize,
    /// Masks that show several objects as one; they were not used.
    pub undersegmented: usize,
    /// Other masks that belong to no object; they were not used.
    pub unassigned: usize,
    /// Names of the views without a mask, which contribute nothing.
    #[serde(default)]
    pub without_mask: Vec<String>,
    /// All objects, in order of their numbers.
    pub objects: Vec<ObjectReport>,
    /// Memory for the contributions of all views, bytes.
    pub contribution_bytes: u64,
    /// Memory for the points of masks, bytes.
    pub point_bytes: u64,
    /// Wall time in seconds, including the first rendering of the views.
    pub seconds: f64,
}

impl ConsensusReport {
    /// One line for the user if ids were not kept.
    pub fn warning(&self) -> Option<String> {
        let (agreement, objects) = (100.0 * self.agreement, self.objects.len());
        let unused = match (self.undersegmented, self.unassigned) {
            (0, 0) => String::new(),
            (merged, alone) => format!("; not used: {merged} masks of several objects, {alone} of none"),
        };
        let text = format!(
            "masks: only {agreement:.0} % of the ids mean the same object in other views; {} masks were merged into \
             {objects} objects by the Gaussians they share{unused}",
            self.masks
        );
        (!self.ids_agree).then_some(text)
    }

    /// Fills in the number of Gaussians of every object from labels; `labels` has one entry per Gaussian.
    pub fn count_gaussians(&mut self, labels: &[u32]) {
        let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
        labels.iter().for_each(|&label| *counts.entry(label).or_default() += 1);
        for object in &mut self.objects {
            object.gaussians = counts.get(&object.id).copied().unwrap_or_default();
        }
    }
}
