//! What the stages of a run are for.

use crate::train::facts::StageTime;

/// From masks to templates.
const PREPARATION: [&str; 5] = ["consensus", "segment", "register", "refine poses", "merge"];

/// True for what stands between the plain cloud's training and the joint phase's.
pub fn is_preparation(stage: &StageTime) -> bool {
    PREPARATION.contains(&stage.name.as_str())
}

/// True for what a scene needs: training, its preparation, and making masks; not loading, evaluating and drawing.
pub fn makes_scene(stage: &StageTime) -> bool {
    stage.name.ends_with("train") || stage.name == "masks" || is_preparation(stage)
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
    }
}
