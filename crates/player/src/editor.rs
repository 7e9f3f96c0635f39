//! Selecting and changing instances, with undo.
//!
//! Hiding belongs to the session: hidden instances are not drawn and cannot be selected, but stay in the scene and in
//! the files written from it. Locking does, too: locked instances are drawn, but cannot be selected. Both are undo steps like
//! changes.

use std::collections::BTreeSet;

use glam::DVec3;

use instgs_vk::math::similarity::Similarity;
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::edit::{Edit, EditError, EditOutcome, Selector, apply, instance_centres};

pub use super::steps::Changed;
use super::steps::{Parts, Step};

/// Largest number of changes that can be undone.
const MOST_STEPS: usize = 200;
/// Memory in bytes that the undo steps may take before the oldest are dropped: changes of large templates keep a copy
/// of the templates. The last step is kept whatever its size.
const MOST_BYTES: u64 = 1 << 30;

/// Selection, hidden instances and undo history of one scene.
#[derive(Default)]
pub struct Editor {
    chosen: BTreeSet<usize>,
    hidden: BTreeSet<usize>,
    locked: BTreeSet<usize>,
    undo: Vec<Step>,
    redo: Vec<Step>,
    /// True if the oldest changes can no longer be undone.
    has_forgotten: bool,
    /// The state before the change in progress.
    in_progress: Option<Step>,
    /// True if the last edit of a change in progress was not possible, so that there is none now.
    live_failed: bool,
    unsaved: bool,
    /// Counts changes of the scene, undone and redone ones included.
    revision: u64,
    /// Counts changes of which instances there are and how they are called, those of a drag included.
    listing: u64,
    /// Counts changes of the background.
    background: u64,
}

/// What an undo step is called that changes nothing of the scene.
const HIDE: &str = "hide";
const SHOW: &str = "show";
const LOCK: &str = "lock";
const UNLOCK: &str = "unlock";

impl Editor {
    /// Indices of the selected instances.
    pub fn chosen(&self) -> &BTreeSet<usize> {
        &self.chosen
    }

    /// Per instance, whether it is selected.
    pub fn chosen_flags(&self, scene: &InstancedScene) -> Vec<bool> {
        (0..scene.instances.len()).map(|k| self.chosen.contains(&k)).collect()
    }

    /// Mean of the selected instances' centres, world units; `None` without a selection.
    pub fn chosen_centre(&self, scene: &InstancedScene) -> Option<DVec3> {
        let centres = instance_centres(scene, self.chosen.iter().copied());
        (!centres.is_empty()).then(|| centres.iter().sum::<DVec3>() / centres.len() as f64)
    }

    /// True if the scene was changed since it was opened or saved.
    pub fn is_unsaved(&self) -> bool {
        self.unsaved || self.in_progress.is_some()
    }

    /// Marks the scene as saved in its present state, which also completes a change in progress.
    pub fn saved(&mut self) {
        self.finish();
        self.unsaved = false;
    }

    /// The number of changes so far, of which a file that is being written holds some; completes a change in progress.
    pub fn revision(&mut self) -> u64 {
        self.finish();
        self.revision
    }

    /// A number that changes whenever a list of the instances, their templates and names may have become wrong; moving instances
    /// does not change it.
    pub fn listing(&self) -> u64 {
        self.listing
    }

    /// A number that changes whenever Gaussians leave the background or come back to it.
    pub fn background(&self) -> u64 {
        self.background
    }

    /// True if the oldest changes were dropped, so that the scene as it was opened cannot be had back.
    pub fn has_forgotten(&self) -> bool {
        self.has_forgotten
    }

    /// A copy of the scene as it was before the first change that can be undone: as it was opened, unless the oldest changes were
    /// dropped. Completes a change in progress; nothing else changes.
    pub fn first_state(&mut self, scene: &mut InstancedScene) -> InstancedScene {
        self.finish();
        let (unsaved, revision, steps) = (self.unsaved, self.revision, self.undo.len());
        (0..steps).for_each(|_| drop(self.undo(scene)));
        let first = scene.clone();
        (0..steps).for_each(|_| drop(self.redo(scene)));
        (self.unsaved, self.revision) = (unsaved, revision);
        first
    }

    /// True if nothing was changed since a revision, and no change is in progress.
    pub fn is_at(&self, revision: u64) -> bool {
        self.revision == revision && self.in_progress.is_none()
    }

    /// Marks the scene as saved if nothing was changed since a revision.
    pub fn saved_at(&mut self, revision: u64) {
        self.unsaved &= self.revision != revision;
    }

    /// What can be undone and what can be redone, by the names of the edits, the next one first.
    pub fn history(&self) -> [Vec<&'static str>; 2] {
        [&self.undo, &self.redo].map(|steps| steps.iter().rev().map(|step| step.what).collect())
    }

    /// Number of changes that can be undone and redone.
    pub fn steps(&self) -> [usize; 2] {
        [self.undo.len(), self.redo.len()]
    }

    /// True if an instance of the template is selected.
    pub fn has_chosen_of(&self, scene: &InstancedScene, template: u32) -> bool {
        self.chosen.iter().any(|&k| scene.instances[k].template == template)
    }

    /// True if an instance can be selected: it is neither locked nor hidden.
    fn is_free(&self, instance: usize) -> bool {
        !self.locked.contains(&instance) && !self.hidden.contains(&instance)
    }

    /// Selects an instance (`None` for a click beside all of them) unless it is locked or hidden, replacing the selection; with
    /// `more`, toggles it in the selection.
    pub fn click(&mut self, instance: Option<usize>, more: bool) {
        self.finish();
        if !more {
            self.chosen.clear();
        }
        if let Some(instance) = instance.filter(|&k| self.is_free(k))
            && !self.chosen.insert(instance)
        {
            self.chosen.remove(&instance);
        }
    }

    /// Selects these instances, but for locked and hidden ones; with `more`, in addition to those that are selected.
    pub fn choose(&mut self, instances: impl IntoIterator<Item = usize>, more: bool) {
        self.finish();
        if !more {
            self.chosen.clear();
        }
        let free: Vec<usize> = instances.into_iter().filter(|&k| self.is_free(k)).collect();
        self.chosen.extend(free);
    }

    /// Selects what is not selected, and the other way round.
    pub fn choose_others(&mut self, scene: &InstancedScene) {
        let others: Vec<usize> = (0..scene.instances.len()).filter(|k| !self.chosen.contains(k)).collect();
        self.choose(others, false);
    }

    /// Selects all visible instances of the selected instances' templates.
    pub fn choose_alike(&mut self, scene: &InstancedScene) {
        self.choose_same(|k| scene.instances[k].template, scene.instances.len());
    }

    /// Selects all visible instances of the selected instances' groups; an instance without a group stays selected.
    pub fn choose_group(&mut self, scene: &InstancedScene) {
        let labels = scene.instance_labels();
        // An instance without a group matches only itself.
        self.choose_same(|k| labels[k].group.ok_or(k), labels.len());
    }

    fn choose_same<T: Ord>(&mut self, kind_of: impl Fn(usize) -> T, instances: usize) {
        self.finish();
        let kinds: BTreeSet<T> = self.chosen.iter().map(|&k| kind_of(k)).collect();
        let wanted = |&k: &usize| self.is_free(k) && kinds.contains(&kind_of(k));
        self.chosen = (0..instances).filter(wanted).collect();
    }

    /// Indices of the hidden instances.
    pub fn hidden(&self) -> &BTreeSet<usize> {
        &self.hidden
    }

    /// Hides the selected instances and clears the selection; `None` without a selection.
    pub fn hide_chosen(&mut self) -> Option<Changed> {
        let chosen: Vec<usize> = self.chosen.iter().copied().collect();
        self.set_hidden(&chosen, true)
    }

    /// Shows and selects all hidden instances; `None` if there are none.
    pub fn show_all(&mut self) -> Option<Changed> {
        let hidden: Vec<usize> = self.hidden.iter().copied().collect();
        let changed = self.set_hidden(&hidden, false);
        if changed.is_some() {
            self.chosen = hidden.into_iter().filter(|k| !self.locked.contains(k)).collect();
        }
        changed
    }

    /// Hides instances, which leave the selection, or shows them; `None` if they are so already.
    pub fn set_hidden(&mut self, instances: &[usize], hidden: bool) -> Option<Changed> {
        self.finish();
        let other: Vec<usize> = instances.iter().copied().filter(|k| self.hidden.contains(k) != hidden).collect();
        if other.is_empty() {
            return None;
        }
        let step = self.here(if hidden { HIDE } else { SHOW }, Parts::default());
        for &k in &other {
            if hidden {
                self.hidden.insert(k);
                self.chosen.remove(&k);
            } else {
                self.hidden.remove(&k);
            }
        }
        self.push(step);
        Some(Changed::Shown(other))
    }

    /// Indices of the locked instances.
    pub fn locked(&self) -> &BTreeSet<usize> {
        &self.locked
    }

    /// Locks instances, which leave the selection, or unlocks them; false if they are so already.
    pub fn set_locked(&mut self, instances: &[usize], locked: bool) -> bool {
        self.finish();
        let other: Vec<usize> = instances.iter().copied().filter(|k| self.locked.contains(k) != locked).collect();
        if other.is_empty() {
            return false;
        }
        let step = self.here(if locked { LOCK } else { UNLOCK }, Parts::default());
        for &k in &other {
            if locked {
                self.locked.insert(k);
                self.chosen.remove(&k);
            } else {
                self.locked.remove(&k);
            }
        }
        self.push(step);
        true
    }

    /// The selector of the selected instances; `None` without a selection.
    pub fn selector(&self) -> Option<Selector> {
        (!self.chosen.is_empty()).then(|| Selector::Indices(self.chosen.iter().copied().collect()))
    }

    /// Applies an edit as one undo step, or as none if it changes nothing. Added instances are selected, removed ones leave the
    /// selection.
    ///
    /// # Errors
    /// The edit cannot be applied; the scene is unchanged.
    pub fn apply(&mut self, scene: &mut InstancedScene, edit: &Edit) -> Result<(EditOutcome, Changed), EditError> {
        self.finish();
        let (step, outcome, changed) = self.change(scene, edit)?;
        if !step.parts.is_empty() {
            self.push(step);
        }
        Ok((outcome, changed))
    }

    /// Applies an edit as [`Editor::apply`] does. If the last undo step moved the same instances in the same way, both are one step:
    /// a key that is held moves them many times.
    ///
    /// # Errors
    /// The edit cannot be applied; the scene is unchanged.
    pub fn apply_again(
        &mut self,
        scene: &mut InstancedScene,
        edit: &Edit,
    ) -> Result<(EditOutcome, Changed), EditError> {
        self.finish();
        let (step, outcome, changed) = self.change(scene, edit)?;
        let goes_on = |last: &Step| {
            (last.what, &last.chosen) == (step.what, &step.chosen) && last.parts.are_places() && step.parts.are_places()
        };
        if self.redo.is_empty() && self.undo.last().is_some_and(goes_on) {
            // The last step restores what was before both.
            self.note(&step);
        } else if !step.parts.is_empty() {
            self.push(step);
        }
        Ok((outcome, changed))
    }

    /// Applies an edit in place of the previous one of the change in progress: each starts from the scene before the
    /// first of them, so that a whole drag is one change, which [`Editor::finish`] makes one undo step. If the edit
    /// fails, the scene is as it was at the start.
    pub fn apply_live(&mut self, scene: &mut InstancedScene, edit: &Edit) -> (Result<EditOutcome, EditError>, Changed) {
        let back = self.cancel(scene);
        match self.change(scene, edit) {
            Ok((step, outcome, changed)) => {
                self.in_progress = Some(step);
                (Ok(outcome), back.and(changed))
            }
            Err(error) => {
                self.live_failed = true;
                (Err(error), back)
            }
        }
    }

    /// True if the last edit of a change in progress was not possible: there is none now, but the fields that asked for it stay.
    pub fn has_live_failed(&self) -> bool {
        self.live_failed
    }

    /// Pose of an instance before the change in progress, or its present one if there is none.
    ///
    /// # Panics
    /// If there is no such instance.
    pub fn place_before(&self, scene: &InstancedScene, k: usize) -> Similarity {
        let before = self.in_progress.as_ref().and_then(|step| step.parts.place_of(k));
        before.unwrap_or(scene.instances[k].world_from_template)
    }

    /// True while a change is in progress.
    pub fn is_live(&self) -> bool {
        self.in_progress.is_some()
    }

    /// Completes the change in progress as one undo step. Does nothing if there is none.
    pub fn finish(&mut self) {
        self.live_failed = false;
        // Moving an object back to its start is no change.
        if let Some(step) = self.in_progress.take().filter(|step| !step.parts.is_empty()) {
            self.push(step);
        }
    }

    /// Reverts and drops the change in progress. Does nothing if there is none.
    pub fn cancel(&mut self, scene: &mut InstancedScene) -> Changed {
        self.live_failed = false;
        match self.in_progress.take() {
            Some(step) => self.exchange(scene, step).1,
            None => Changed::Places(Vec::new()),
        }
    }

    /// Undoes the last change; `None` if there is none.
    pub fn undo(&mut self, scene: &mut InstancedScene) -> Option<Changed> {
        self.finish();
        let step = self.undo.pop()?;
        let (back, changed) = self.exchange(scene, step);
        self.note(&back);
        self.redo.push(back);
        Some(changed)
    }

    /// Reverts the last change without a redo step, since the device has no memory for it. `unsaved` is the flag from
    /// before the change.
    pub fn refuse(&mut self, scene: &mut InstancedScene, unsaved: bool) {
        if self.undo(scene).is_some() {
            self.redo.pop();
        }
        self.unsaved = unsaved;
    }

    /// Reverts an [`Editor::undo`], or with `redone` an [`Editor::redo`], that the device has no memory for. `unsaved`
    /// is the flag from before the step.
    pub fn refuse_step(&mut self, scene: &mut InstancedScene, redone: bool, unsaved: bool) {
        if redone {
            self.undo(scene);
        } else {
            self.redo(scene);
        }
        self.unsaved = unsaved;
    }

    /// Redoes the change that was undone last; `None` if there is none.
    pub fn redo(&mut self, scene: &mut InstancedScene) -> Option<Changed> {
        self.finish();
        let step = self.redo.pop()?;
        let (back, changed) = self.exchange(scene, step);
        self.note(&back);
        self.undo.push(back);
        Some(changed)
    }

    /// Applies an edit to scene and selection; the step holds the previous state.
    fn change(&mut self, scene: &mut InstancedScene, edit: &Edit) -> Result<(Step, EditOutcome, Changed), EditError> {
        let before = Parts::before(scene, edit);
        let outcome = apply(scene, edit)?;
        let parts = before.that_differ_from(scene);
        let changed = parts.changed(scene);
        self.note_listing(&parts, &changed);
        let step = self.here(edit.name(), parts);
        if !outcome.removed.is_empty() {
            self.hidden = renumbered(&self.hidden, &outcome.removed);
            self.locked = renumbered(&self.locked, &outcome.removed);
        }
        if !outcome.added.is_empty() {
            self.chosen = outcome.added.iter().copied().collect();
        } else if !outcome.removed.is_empty() {
            self.chosen.clear();
        }
        Ok((step, outcome, changed))
    }

    /// A step that restores the present selection, hidden and locked instances, and `parts` of the scene.
    fn here(&self, what: &'static str, parts: Parts) -> Step {
        let (chosen, hidden, locked) = (self.chosen.clone(), self.hidden.clone(), self.locked.clone());
        Step { what, parts, chosen, hidden, locked }
    }

    /// Appends an undo step and drops the redo history.
    fn push(&mut self, step: Step) {
        self.note(&step);
        self.undo.push(step);
        self.redo.clear();
        self.forget_oldest(MOST_STEPS, MOST_BYTES);
    }

    /// Records that a step changed the scene, if it did.
    fn note(&mut self, step: &Step) {
        let changes = !step.parts.is_empty();
        self.unsaved |= changes;
        self.revision += u64::from(changes);
    }

    /// Records that lists of instances, or what is known of the background, are out of date, if a change may have made them so.
    fn note_listing(&mut self, parts: &Parts, changed: &Changed) {
        self.listing += u64::from(parts.has_groups() || *changed == Changed::Everything);
        self.background += u64::from(parts.has_background());
    }

    fn forget_oldest(&mut self, most_steps: usize, most_bytes: u64) {
        let mut bytes: u64 = self.undo.iter().map(|step| step.parts.bytes()).sum();
        let mut gone = 0;
        while self.undo.len() - gone > 1 && (self.undo.len() - gone > most_steps || bytes > most_bytes) {
            bytes -= self.undo[gone].parts.bytes();
            gone += 1;
        }
        self.undo.drain(..gone);
        self.has_forgotten |= gone > 0;
    }

    /// Swaps a step's parts with those of the scene; the returned step reverts the swap.
    fn exchange(&mut self, scene: &mut InstancedScene, mut step: Step) -> (Step, Changed) {
        // Removing instances counts as a change of everything, so that lists with different indices are never compared.
        let changed = if step.parts.is_empty() {
            let shown: Vec<usize> = step.hidden.symmetric_difference(&self.hidden).copied().collect();
            // A drag that has not moved anything yet: nothing needs to be uploaded.
            if shown.is_empty() { Changed::Places(shown) } else { Changed::Shown(shown) }
        } else {
            step.parts.changed(scene)
        };
        self.note_listing(&step.parts, &changed);
        step.parts.exchange(scene);
        std::mem::swap(&mut step.chosen, &mut self.chosen);
        std::mem::swap(&mut step.hidden, &mut self.hidden);
        std::mem::swap(&mut step.locked, &mut self.locked);
        (step, changed)
    }
}

/// Indices renumbered after instances were removed; both lists are ascending.
fn renumbered(indices: &BTreeSet<usize>, removed: &[usize]) -> BTreeSet<usize> {
    let kept = indices.iter().filter(|k| removed.binary_search(k).is_err());
    kept.map(|&k| k - removed.partition_point(|&r| r < k)).collect()
}

#[cfg(test)]
mod tests;
