//! Choosing and changing instances: what is chosen, and what was there before each change.

use std::collections::{BTreeMap, BTreeSet};

use crate::scene::edit::{Edit, EditError, EditOutcome, Selector, apply};
use crate::scene::instanced_scene::ForeignTensor;
use crate::scene::{Group, Instance, InstancedScene, Offsets};

/// Changes that can be taken back.
const MOST_STEPS: usize = 200;

/// What of a scene must go to the device again.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Changed {
    /// The places of these instances.
    Places(Vec<usize>),
    /// All of it.
    Everything,
}

/// What edits change of a scene, as it was at a moment. Parts that an edit left alone are absent.
#[derive(Default)]
struct Parts {
    instances: Option<Vec<Instance>>,
    groups: Option<Vec<Group>>,
    offsets: Option<Offsets>,
    template_sh: Option<Vec<[f32; 3]>>,
    foreign_tensors: Option<BTreeMap<String, ForeignTensor>>,
}

/// One change: what was there, and what was chosen.
struct Step {
    parts: Parts,
    chosen: BTreeSet<usize>,
}

/// The state of editing one scene.
#[derive(Default)]
pub struct Editor {
    chosen: BTreeSet<usize>,
    undo: Vec<Step>,
    redo: Vec<Step>,
    unsaved: bool,
}

impl Editor {
    /// Indices of the chosen instances.
    pub fn chosen(&self) -> &BTreeSet<usize> {
        &self.chosen
    }

    /// By instance, whether it is chosen.
    pub fn chosen_flags(&self, scene: &InstancedScene) -> Vec<bool> {
        (0..scene.instances.len()).map(|k| self.chosen.contains(&k)).collect()
    }

    /// True if something was changed since the scene was opened or saved.
    pub fn is_unsaved(&self) -> bool {
        self.unsaved
    }

    /// The scene was saved as it is.
    pub fn saved(&mut self) {
        self.unsaved = false;
    }

    /// How many changes can be taken back and done again.
    pub fn steps(&self) -> [usize; 2] {
        [self.undo.len(), self.redo.len()]
    }

    /// A click on an instance (`None`: beside all of them) chooses it alone; with `more` it adds it, or takes it out again.
    pub fn click(&mut self, instance: Option<usize>, more: bool) {
        if !more {
            self.chosen.clear();
        }
        if let Some(instance) = instance
            && !self.chosen.insert(instance)
        {
            self.chosen.remove(&instance);
        }
    }

    /// Chooses all instances of the templates of what is chosen.
    pub fn choose_alike(&mut self, scene: &InstancedScene) {
        let templates: BTreeSet<u32> = self.chosen.iter().map(|&k| scene.instances[k].template).collect();
        let alike = |k: &usize| templates.contains(&scene.instances[*k].template);
        self.chosen = (0..scene.instances.len()).filter(alike).collect();
    }

    /// Names what is chosen; `None` if nothing is.
    pub fn selector(&self) -> Option<Selector> {
        (!self.chosen.is_empty()).then(|| Selector::Indices(self.chosen.iter().copied().collect()))
    }

    /// Does an edit, which can be taken back. What it adds is chosen; what it removes is not.
    ///
    /// # Errors
    /// The edit cannot be done: the scene is as it was.
    pub fn apply(&mut self, scene: &mut InstancedScene, edit: &Edit) -> Result<(EditOutcome, Changed), EditError> {
        let before = Parts {
            instances: Some(scene.instances.clone()),
            groups: Some(scene.groups.clone()),
            offsets: Some(scene.offsets.clone()),
            template_sh: Some(scene.templates.sh.clone()),
            foreign_tensors: Some(scene.foreign_tensors.clone()),
        };
        let outcome = apply(scene, edit)?;
        let parts = before.that_differ_from(scene);
        let changed = parts.changed(scene);
        self.undo.push(Step { parts, chosen: self.chosen.clone() });
        if self.undo.len() > MOST_STEPS {
            self.undo.remove(0);
        }
        self.redo.clear();
        self.unsaved = true;
        if !outcome.added.is_empty() {
            self.chosen = outcome.added.iter().copied().collect();
        } else if !outcome.removed.is_empty() {
            self.chosen.clear();
        }
        Ok((outcome, changed))
    }

    /// Takes the last change back; `None` if there is none.
    pub fn undo(&mut self, scene: &mut InstancedScene) -> Option<Changed> {
        let step = self.undo.pop()?;
        let (back, changed) = self.exchange(scene, step);
        self.redo.push(back);
        Some(changed)
    }

    /// Does again what was taken back last; `None` if there is nothing.
    pub fn redo(&mut self, scene: &mut InstancedScene) -> Option<Changed> {
        let step = self.redo.pop()?;
        let (back, changed) = self.exchange(scene, step);
        self.undo.push(back);
        Some(changed)
    }

    /// Puts a step's parts into the scene and returns those that were there.
    fn exchange(&mut self, scene: &mut InstancedScene, mut step: Step) -> (Step, Changed) {
        let changed = step.parts.changed(scene);
        let parts = &mut step.parts;
        swap(&mut parts.instances, &mut scene.instances);
        swap(&mut parts.groups, &mut scene.groups);
        swap(&mut parts.offsets, &mut scene.offsets);
        swap(&mut parts.template_sh, &mut scene.templates.sh);
        swap(&mut parts.foreign_tensors, &mut scene.foreign_tensors);
        std::mem::swap(&mut step.chosen, &mut self.chosen);
        self.unsaved = true;
        (step, changed)
    }
}

impl Parts {
    /// What is different in a scene now.
    fn that_differ_from(self, scene: &InstancedScene) -> Self {
        Self {
            instances: self.instances.filter(|was| *was != scene.instances),
            groups: self.groups.filter(|was| *was != scene.groups),
            offsets: self.offsets.filter(|was| *was != scene.offsets),
            template_sh: self.template_sh.filter(|was| *was != scene.templates.sh),
            foreign_tensors: self.foreign_tensors.filter(|was| *was != scene.foreign_tensors),
        }
    }

    /// What goes to the device when a scene changes from one to the other.
    fn changed(&self, scene: &InstancedScene) -> Changed {
        let Some(instances) = &self.instances else { return Changed::Everything };
        let elsewhere = |(k, (a, b)): (usize, (&Instance, &Instance))| (a != b).then_some(k);
        let same_list = instances.len() == scene.instances.len()
            && instances
                .iter()
                .zip(&scene.instances)
                .all(|(a, b)| (a.template, a.first_offset) == (b.template, b.first_offset));
        if same_list && self.offsets.is_none() && self.template_sh.is_none() {
            Changed::Places(instances.iter().zip(&scene.instances).enumerate().filter_map(elsewhere).collect())
        } else {
            Changed::Everything
        }
    }
}

fn swap<T>(part: &mut Option<T>, value: &mut T) {
    if let Some(part) = part {
        std::mem::swap(part, value);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::io::scene_file::tests::sample_scene;
    use glam::DVec3;

    fn move_by(editor: &Editor, by: DVec3) -> Edit {
        Edit::MoveBy { which: editor.selector().unwrap(), by }
    }

    #[test]
    fn clicks_choose_one_or_more_and_alike_all_of_a_kind() {
        let scene = sample_scene();
        let mut editor = Editor::default();
        assert!(editor.selector().is_none());
        editor.click(Some(0), false);
        editor.click(Some(1), true);
        assert_eq!(editor.chosen_flags(&scene)[..2], [true, true]);
        editor.click(Some(0), true);
        assert_eq!(editor.selector(), Some(Selector::Indices(vec![1])));
        editor.choose_alike(&scene);
        let template = scene.instances[1].template;
        assert!(editor.chosen().iter().all(|&k| scene.instances[k].template == template));
        assert_eq!(editor.chosen().len(), scene.instances.iter().filter(|i| i.template == template).count());
        editor.click(None, true);
        assert!(!editor.chosen().is_empty(), "beside, with shift: no change");
        editor.click(None, false);
        assert!(editor.chosen().is_empty());
    }

    /// Every kind of change, all taken back and done again: the same scenes, bit for bit, at every step.
    #[test]
    fn changes_are_taken_back_and_done_again() {
        let mut scene = sample_scene();
        let mut editor = Editor::default();
        let which = || Selector::Indices(vec![0, 1]);
        let edits = [
            Edit::MoveBy { which: which(), by: DVec3::X },
            Edit::Duplicate { which: which(), by: DVec3::Y, turn: None },
            Edit::Recolour { which: Selector::Index(0), rgb: [0.1, 0.0, 0.0] },
            Edit::Recolour { which: Selector::Template(0), rgb: [0.0, 0.1, 0.0] },
            Edit::Scale { which: Selector::Index(1), by: 1.5 },
            Edit::Delete { which: which() },
        ];
        let mut states = vec![scene.clone()];
        for edit in &edits {
            let (outcome, changed) = editor.apply(&mut scene, edit).unwrap();
            let places = matches!(edit, Edit::MoveBy { .. } | Edit::Scale { .. });
            assert_eq!(matches!(changed, Changed::Places(_)), places, "{edit:?}");
            if !outcome.added.is_empty() {
                assert_eq!(editor.chosen().iter().copied().collect::<Vec<_>>(), outcome.added);
            }
            scene.validate().unwrap();
            states.push(scene.clone());
        }
        assert_eq!(editor.steps(), [edits.len(), 0]);
        for want in states.iter().rev().skip(1) {
            assert!(editor.undo(&mut scene).is_some() && scene == *want);
        }
        assert!(editor.undo(&mut scene).is_none());
        for want in states.iter().skip(1) {
            assert!(editor.redo(&mut scene).is_some() && scene == *want);
        }
        assert!(editor.redo(&mut scene).is_none() && editor.is_unsaved());
        editor.saved();
        assert!(!editor.is_unsaved());
        // A new change forgets what was taken back.
        editor.undo(&mut scene);
        editor.click(Some(0), false);
        let edit = move_by(&editor, DVec3::Z);
        editor.apply(&mut scene, &edit).unwrap();
        assert!(editor.redo(&mut scene).is_none());
    }

    #[test]
    fn an_edit_that_fails_leaves_no_step() {
        let mut scene = sample_scene();
        let before = scene.clone();
        let mut editor = Editor::default();
        editor.click(Some(0), false);
        let edit = move_by(&editor, DVec3::splat(f64::INFINITY));
        assert!(editor.apply(&mut scene, &edit).is_err());
        assert!(scene == before && editor.steps() == [0, 0] && !editor.is_unsaved());
    }
}
