//! The stages from masks to templates, and the purpose of each stage of a run.

use std::time::Instant;

use super::observer::{Message, Observer};
use instgs_io::IoError;
use instgs_train::facts::StageTime;

/// A stage between the two phases that is timed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Making masks, from words or from boxes.
    Masks,
    /// Consensus: which masks of different views show the same object.
    Consensus,
    /// Labelling: the object of every Gaussian.
    Segment,
    /// Registration: groups of objects that are alike, and their poses.
    Register,
    /// Refinement of given poses.
    RefinePoses,
    /// Merging objects into templates and instances.
    Merge,
}

impl Stage {
    const ALL: [Self; 6] =
        [Self::Masks, Self::Consensus, Self::Segment, Self::Register, Self::RefinePoses, Self::Merge];

    /// Name of the stage in reports.
    pub fn name(self) -> &'static str {
        match self {
            Self::Masks => "masks",
            Self::Consensus => "consensus",
            Self::Segment => "segment",
            Self::Register => "register",
            Self::RefinePoses => "refine poses",
            Self::Merge => "merge",
        }
    }

    fn of(time: &StageTime) -> Option<Self> {
        Self::ALL.into_iter().find(|stage| stage.name() == time.name)
    }

    /// Begins the stage and reports it.
    pub(super) fn begin(self, observer: &mut dyn Observer) -> Result<StageClock, IoError> {
        observer.notify(Message::StageStarted(self))?;
        Ok(StageClock { stage: self, start: Instant::now() })
    }
}

/// A stage in progress.
pub(super) struct StageClock {
    stage: Stage,
    start: Instant,
}

impl StageClock {
    /// The wall time so far.
    pub(super) fn time(&self) -> StageTime {
        StageTime::since(self.stage.name(), self.start)
    }

    /// Ends the stage and reports its wall time.
    pub(super) fn end(self, observer: &mut dyn Observer) -> Result<StageTime, IoError> {
        let time = StageTime::since(self.stage.name(), self.start);
        observer.notify(Message::StageFinished(&time))?;
        Ok(time)
    }
}

/// True for the stages between the two phases: from masks to templates.
pub fn is_preparation(stage: &StageTime) -> bool {
    Stage::of(stage).is_some_and(|stage| stage != Stage::Masks)
}

/// True for stages that make the scene: masks, preparation and training; not loading, evaluating and drawing.
pub fn makes_scene(stage: &StageTime) -> bool {
    stage.name.ends_with("train") || Stage::of(stage).is_some()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_scene_needs_its_masks_but_no_evaluation() {
        let is_needed = |name: &&str| makes_scene(&StageTime { name: name.to_string(), seconds: 1.0 });
        let all = ["3dgs: load", "3dgs: train", "masks", "consensus", "segment", "register", "merge", "eval"];
        let needed: Vec<&str> = all.into_iter().filter(is_needed).collect();
        assert_eq!(needed, ["3dgs: train", "masks", "consensus", "segment", "register", "merge"]);
        assert!(!is_preparation(&StageTime { name: "masks".into(), seconds: 1.0 }));
    }
}
