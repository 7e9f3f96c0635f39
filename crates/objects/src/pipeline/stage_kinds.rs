//! The stages from masks to templates, and what the stages of a run are for.

use std::time::Instant;

use super::observer::{Message, Observer};
use instgs_io::IoError;
use instgs_train::facts::StageTime;

/// A stage that is timed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stage {
    /// Masks are made, from words or from boxes.
    Masks,
    /// Which masks are of one object.
    Consensus,
    /// The object of every Gaussian.
    Segment,
    /// Which objects are alike, and where they stand.
    Register,
    /// Given poses are fitted to the objects.
    RefinePoses,
    /// Templates and instances.
    Merge,
}

impl Stage {
    const ALL: [Self; 6] =
        [Self::Masks, Self::Consensus, Self::Segment, Self::Register, Self::RefinePoses, Self::Merge];

    /// As in reports.
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

    /// Begins the stage, and tells so.
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
    /// Ends the stage, and tells so.
    pub(super) fn end(self, observer: &mut dyn Observer) -> Result<StageTime, IoError> {
        let time = StageTime::since(self.stage.name(), self.start);
        observer.notify(Message::StageFinished(&time))?;
        Ok(time)
    }
}

/// True for what stands between the plain cloud's training and the joint phase's: from masks to templates.
pub fn is_preparation(stage: &StageTime) -> bool {
    Stage::of(stage).is_some_and(|stage| stage != Stage::Masks)
}

/// True for what a scene needs: training, its preparation, and making masks; not loading, evaluating and drawing.
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
