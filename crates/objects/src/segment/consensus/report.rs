//! What consensus found, for `prepared.json`.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// One object.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct ObjectReport {
    /// Its number.
    pub id: u32,
    /// What `categories.json` calls most of its masks, if any.
    pub category: Option<String>,
    /// Views in which it has a mask.
    pub views: usize,
    /// Its masks: more than views where it is in pieces.
    pub masks: usize,
    /// Gaussians with its label; 0 until there are labels.
    pub gaussians: usize,
}

/// All of it.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ConsensusReport {
    /// Ids are the same object in every view, and were kept.
    pub ids_agree: bool,
    /// Part of the cases in which the mask that shows a mask's points in another view has the same id.
    pub agreement: f64,
    /// Gaussians that were looked at.
    pub points: usize,
    /// Masks: ids in views.
    pub masks: usize,
    /// Masks that show two objects as one, and were not used.
    pub undersegmented: usize,
    /// Other masks that belong to no object, and were not used.
    pub unassigned: usize,
    /// Names of the views that have no mask: they say nothing of objects.
    #[serde(default)]
    pub without_mask: Vec<String>,
    /// By number.
    pub objects: Vec<ObjectReport>,
    /// Bytes of the contributions of all views that are kept in memory.
    pub contribution_bytes: u64,
    /// Bytes of what clustering looks at.
    pub point_bytes: u64,
    /// Wall time, first rendering of the views included.
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
            "masks: ids are the same from view to view in {agreement:.0} % of the cases only; {} masks were \
             joined to {objects} objects by what they have in common{unused}",
            self.masks
        );
        (!self.ids_agree).then_some(text)
    }

    /// Fills in the Gaussians of every object, from labels.
    pub fn count_gaussians(&mut self, labels: &[u32]) {
        let mut counts: BTreeMap<u32, usize> = BTreeMap::new();
        labels.iter().for_each(|&label| *counts.entry(label).or_default() += 1);
        for object in &mut self.objects {
            object.gaussians = counts.get(&object.id).copied().unwrap_or_default();
        }
    }
}
