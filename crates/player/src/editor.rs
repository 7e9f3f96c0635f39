//! Choosing and changing instances: what is chosen, and what was there before each change.
//!
//! Hidden instances are a matter of the session: they are not drawn and cannot be chosen, but they stay in the scene, and
//! in what is saved of it. Hiding can be taken back like a change.

use std::collections::BTreeSet;

use glam::DVec3;

use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::edit::{Edit, EditError, EditOutcome, Selector, apply, instance_centres};

pub use super::steps::Changed;
use super::steps::{Parts, Step};

/// Changes that can be taken back.
const MOST_STEPS: usize = 200;
/// Bytes that steps may take before the oldest are forgotten: changes of large templates keep the templates. The last step
/// is kept whatever it takes.
const MOST_BYTES: u64 = 1 << 30;

/// The state of editing one scene.
#[derive(Default)]
pub struct Editor {
    chosen: BTreeSet<usize>,
    hidden: BTreeSet<usize>,
    undo: Vec<Step>,
    redo: Vec<Step>,
    /// A change that goes on: what was there before it began.
    in_progress: Option<Step>,
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

    /// The middle of what is chosen: the mean of the instances' centres, world units; `None` if nothing is.
    pub fn chosen_centre(&self, scene: &InstancedScene) -> Option<DVec3> {
        let centres = instance_centres(scene, self.chosen.iter().copied());
        (!centres.is_empty()).then(|| centres.iter().sum::<DVec3>() / centres.len() as f64)
    }

    /// True if something was changed since the scene was opened or saved.
    pub fn is_unsaved(&self) -> bool {
        self.unsaved || self.in_progress.is_some()
    }

    /// The scene was saved as it is; a change that goes on ends with it.
    pub fn saved(&mut self) {
        self.finish();
        self.unsaved = false;
    }

    /// How many changes can be taken back and done again.
    pub fn steps(&self) -> [usize; 2] {
        [self.undo.len(), self.redo.len()]
    }

    /// True if an instance of the template is chosen.
    pub fn has_chosen_of(&self, scene: &InstancedScene, template: u32) -> bool {
        self.chosen.iter().any(|&k| scene.instances[k].template == template)
    }

    /// A click on an instance (`None`: beside all of them) chooses it alone; with `more` it adds it, or takes it out again.
    pub fn click(&mut self, instance: Option<usize>, more: bool) {
        self.finish();
        if !more {
            self.chosen.clear();
        }
        if let Some(instance) = instance
            && !self.chosen.insert(instance)
        {
            self.chosen.remove(&instance);
        }
    }

    /// Chooses all instances of the templates of what is chosen, hidden ones aside.
    pub fn choose_alike(&mut self, scene: &InstancedScene) {
        self.choose_same(|k| scene.instances[k].template, scene.instances.len());
    }

    /// Chooses all instances of the groups of what is chosen, hidden ones aside; what has no group stays chosen.
    pub fn choose_group(&mut self, scene: &InstancedScene) {
        let labels = scene.instance_labels();
        // One without a group is only like itself.
        self.choose_same(|k| labels[k].group.ok_or(k), labels.len());
    }

    fn choose_same<T: Ord>(&mut self, kind_of: impl Fn(usize) -> T, instances: usize) {
        self.finish();
        let kinds: BTreeSet<T> = self.chosen.iter().map(|&k| kind_of(k)).collect();
        let wanted = |k: &usize| !self.hidden.contains(k) && kinds.contains(&kind_of(*k));
        self.chosen = (0..instances).filter(wanted).collect();
    }

    /// Indices of the instances that are not drawn.
    pub fn hidden(&self) -> &BTreeSet<usize> {
        &self.hidden
    }

    /// Hides what is chosen, which is not chosen then; `None` if nothing is.
    pub fn hide_chosen(&mut self) -> Option<Changed> {
        self.finish();
        if self.chosen.is_empty() {
            return None;
        }
        let step = self.here(Parts::default());
        let chosen = std::mem::take(&mut self.chosen);
        self.hidden.extend(&chosen);
        self.push(step);
        Some(Changed::Shown(chosen.into_iter().collect()))
    }

    /// Shows all that is hidden and chooses it; `None` if nothing is.
    pub fn show_all(&mut self) -> Option<Changed> {
        self.finish();
        if self.hidden.is_empty() {
            return None;
        }
        let step = self.here(Parts::default());
        self.chosen = std::mem::take(&mut self.hidden);
        self.push(step);
        Some(Changed::Shown(self.chosen.iter().copied().collect()))
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
        self.finish();
        let (step, outcome, changed) = self.change(scene, edit)?;
        self.push(step);
        Ok((outcome, changed))
    }

    /// Does an edit in place of the one before: both begin with the scene as it was when the first of them came, so that
    /// all that a drag does is one change, of which [`Editor::finish`] makes a step to take back. If it cannot be done, the
    /// scene is as it was then.
    pub fn apply_live(&mut self, scene: &mut InstancedScene, edit: &Edit) -> (Result<EditOutcome, EditError>, Changed) {
        let back = self.cancel(scene);
        match self.change(scene, edit) {
            Ok((step, outcome, changed)) => {
                self.in_progress = Some(step);
                (Ok(outcome), back.and(changed))
            }
            Err(error) => (Err(error), back),
        }
    }

    /// Where an instance stood before the change that goes on, or stands without one.
    ///
    /// # Panics
    /// If there is no such instance.
    pub fn place_before(&self, scene: &InstancedScene, k: usize) -> Similarity {
        let before = self.in_progress.as_ref().and_then(|step| step.parts.place_of(k));
        before.unwrap_or(scene.instances[k].world_from_template)
    }

    /// True while edits take each other's place.
    pub fn is_live(&self) -> bool {
        self.in_progress.is_some()
    }

    /// Ends a change that goes on; from now on it is one step. Without one it does nothing.
    pub fn finish(&mut self) {
        // A thing that was put back where it stood is no change.
        if let Some(step) = self.in_progress.take().filter(|step| !step.parts.is_empty()) {
            self.push(step);
        }
    }

    /// Takes a change that goes on back, and forgets it. Without one it does nothing.
    pub fn cancel(&mut self, scene: &mut InstancedScene) -> Changed {
        match self.in_progress.take() {
            Some(step) => self.exchange(scene, step).1,
            None => Changed::Places(Vec::new()),
        }
    }

    /// Takes the last change back; `None` if there is none.
    pub fn undo(&mut self, scene: &mut InstancedScene) -> Option<Changed> {
        self.finish();
        let step = self.undo.pop()?;
        let (back, changed) = self.exchange(scene, step);
        self.unsaved |= !back.parts.is_empty();
        self.redo.push(back);
        Some(changed)
    }

    /// Takes the last change back for good: the device has no room for it. `unsaved` was so before it.
    pub fn refuse(&mut self, scene: &mut InstancedScene, unsaved: bool) {
        if self.undo(scene).is_some() {
            self.redo.pop();
        }
        self.unsaved = unsaved;
    }

    /// Undoes an [`Editor::undo`] that the device has no room for, or with `redone` an [`Editor::redo`]. `unsaved` was so before
    /// it.
    pub fn refuse_step(&mut self, scene: &mut InstancedScene, redone: bool, unsaved: bool) {
        if redone {
            self.undo(scene);
        } else {
            self.redo(scene);
        }
        self.unsaved = unsaved;
    }

    /// Does again what was taken back last; `None` if there is nothing.
    pub fn redo(&mut self, scene: &mut InstancedScene) -> Option<Changed> {
        self.finish();
        let step = self.redo.pop()?;
        let (back, changed) = self.exchange(scene, step);
        self.unsaved |= !back.parts.is_empty();
        self.undo.push(back);
        Some(changed)
    }

    /// Changes the scene and what is chosen; the step holds what was there.
    fn change(&mut self, scene: &mut InstancedScene, edit: &Edit) -> Result<(Step, EditOutcome, Changed), EditError> {
        let before = Parts::before(scene, edit);
        let outcome = apply(scene, edit)?;
        let parts = before.that_differ_from(scene);
        let changed = parts.changed(scene);
        let step = self.here(parts);
        if !outcome.removed.is_empty() {
            self.hidden = renumbered(&self.hidden, &outcome.removed);
        }
        if !outcome.added.is_empty() {
            self.chosen = outcome.added.iter().copied().collect();
        } else if !outcome.removed.is_empty() {
            self.chosen.clear();
        }
        Ok((step, outcome, changed))
    }

    /// A step back to what is chosen and hidden now.
    fn here(&self, parts: Parts) -> Step {
        Step { parts, chosen: self.chosen.clone(), hidden: self.hidden.clone() }
    }

    /// A step that can be taken back from now on.
    fn push(&mut self, step: Step) {
        self.unsaved |= !step.parts.is_empty();
        self.undo.push(step);
        self.redo.clear();
        self.forget_oldest(MOST_STEPS, MOST_BYTES);
    }

    fn forget_oldest(&mut self, most_steps: usize, most_bytes: u64) {
        let mut bytes: u64 = self.undo.iter().map(|step| step.parts.bytes()).sum();
        let mut gone = 0;
        while self.undo.len() - gone > 1 && (self.undo.len() - gone > most_steps || bytes > most_bytes) {
            bytes -= self.undo[gone].parts.bytes();
            gone += 1;
        }
        self.undo.drain(..gone);
    }

    /// Puts a step's parts into the scene and returns those that were there.
    fn exchange(&mut self, scene: &mut InstancedScene, mut step: Step) -> (Step, Changed) {
        // What removes instances changes everything, so that lists of different numbering are never compared.
        let changed = if step.parts.is_empty() {
            let shown: Vec<usize> = step.hidden.symmetric_difference(&self.hidden).copied().collect();
            // A drag that has not moved anything yet: nothing must go to the device again.
            if shown.is_empty() { Changed::Places(shown) } else { Changed::Shown(shown) }
        } else {
            step.parts.changed(scene)
        };
        step.parts.exchange(scene);
        std::mem::swap(&mut step.chosen, &mut self.chosen);
        std::mem::swap(&mut step.hidden, &mut self.hidden);
        (step, changed)
    }
}

/// Indices after some instances went, given in ascending order.
fn renumbered(indices: &BTreeSet<usize>, removed: &[usize]) -> BTreeSet<usize> {
    let kept = indices.iter().filter(|k| removed.binary_search(k).is_err());
    kept.map(|&k| k - removed.partition_point(|&r| r < k)).collect()
}

#[cfg(test)]
mod tests;
