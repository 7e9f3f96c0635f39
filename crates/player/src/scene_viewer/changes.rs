//! Changes of the scene that a viewer shows: edits, undo and hiding, on the host and on the device, and the files they end in.

use std::path::Path;

use glam::DVec3;

use instgs_io::{ExportFormat, IoError, export_scene, save_scene};
use instgs_vk::scene::InstancedScene;
use instgs_vk::scene::edit::{Edit, EditError, EditOutcome, EditReason};

use super::SceneViewer;
use crate::editor::{Changed, Editor};
use crate::error::{ChangeError, PlayerError};
use crate::texts;

impl SceneViewer {
    /// A copy of the scene as it was opened, or as far back as changes can be undone; see [`Editor::first_state`].
    pub fn first_state(&mut self) -> InstancedScene {
        self.editor.first_state(&mut self.scene)
    }

    /// Selection and undo history.
    pub fn editor(&self) -> &Editor {
        &self.editor
    }

    /// The editor, to select instances or to complete a change. Edits, undo and hiding go through this type, which
    /// keeps the device's scene up to date.
    pub fn editor_mut(&mut self) -> &mut Editor {
        &mut self.editor
    }

    /// The editor with the scene, for selections that depend on it.
    pub fn editor_and_scene(&mut self) -> (&mut Editor, &InstancedScene) {
        (&mut self.editor, &self.scene)
    }

    /// Hides the selected instances, in the editor and on the device; false without a selection.
    pub fn hide_chosen(&mut self) -> Result<bool, PlayerError> {
        let done = self.editor.hide_chosen();
        done.map_or(Ok(false), |changed| self.follow(&changed).map(|()| true))
    }

    /// Shows all hidden instances, in the editor and on the device; false if nothing is hidden.
    pub fn show_all(&mut self) -> Result<bool, PlayerError> {
        let done = self.editor.show_all();
        done.map_or(Ok(false), |changed| self.follow(&changed).map(|()| true))
    }

    /// Hides or shows instances, in the editor and on the device; false if they are so already.
    pub fn set_hidden(&mut self, instances: &[usize], hidden: bool) -> Result<bool, PlayerError> {
        let done = self.editor.set_hidden(instances, hidden);
        done.map_or(Ok(false), |changed| self.follow(&changed).map(|()| true))
    }

    /// Applies an edit to the scene and the device.
    ///
    /// # Errors
    /// The edit is not possible, or the device refuses the changed scene; see [`ChangeError`].
    pub fn edit(&mut self, edit: &Edit) -> Result<EditOutcome, ChangeError> {
        self.edit_by(edit, Editor::apply)
    }

    /// Applies an edit of a key that is held; see [`Editor::apply_again`].
    ///
    /// # Errors
    /// The same errors as [`SceneViewer::edit`]; where the device refuses the scene, what the key has done so far is reverted.
    pub fn edit_again(&mut self, edit: &Edit) -> Result<EditOutcome, ChangeError> {
        self.edit_by(edit, Editor::apply_again)
    }

    fn edit_by(
        &mut self,
        edit: &Edit,
        apply: impl FnOnce(&mut Editor, &mut InstancedScene, &Edit) -> Result<(EditOutcome, Changed), EditError>,
    ) -> Result<EditOutcome, ChangeError> {
        self.check_editable(edit)?;
        let (unsaved, revision) = (self.editor.is_unsaved(), self.editor.revision());
        let (outcome, changed) = apply(&mut self.editor, &mut self.scene, edit).map_err(ChangeError::Rejected)?;
        self.follow_or(&changed, |editor, scene| {
            // An edit that changes nothing is no step.
            if !editor.is_at(revision) {
                editor.refuse(scene, unsaved);
            }
        })?;
        Ok(outcome)
    }

    /// Applies an edit in place of the previous one of a drag; see [`Editor::apply_live`].
    ///
    /// # Errors
    /// The same errors as [`SceneViewer::edit`]; the previous edit of the drag is reverted as well.
    pub fn edit_live(&mut self, edit: &Edit) -> Result<EditOutcome, ChangeError> {
        self.check_editable(edit)?;
        let (outcome, changed) = self.editor.apply_live(&mut self.scene, edit);
        self.follow_or(&changed, |editor, scene| drop(editor.cancel(scene)))?;
        outcome.map_err(ChangeError::Rejected)
    }

    fn check_editable(&self, edit: &Edit) -> Result<(), ChangeError> {
        let refused = || EditError { operation: edit.name(), reason: EditReason::Value(texts::IN_PAGES.into()) };
        if self.is_in_pages() { Err(ChangeError::Rejected(refused())) } else { Ok(()) }
    }

    fn check_whole(&self, path: &Path) -> Result<(), PlayerError> {
        if self.is_in_pages() { Err(IoError::new(path, texts::IN_PAGES).into()) } else { Ok(()) }
    }

    /// Reverts the change in progress, in the scene and on the device.
    pub fn cancel_live(&mut self) -> Result<(), PlayerError> {
        let changed = self.editor.cancel(&mut self.scene);
        self.follow(&changed)
    }

    /// Undoes the last edit; false if there is none.
    ///
    /// # Errors
    /// The device refuses the changed scene: [`ChangeError::Reverted`] or [`ChangeError::Failed`].
    pub fn undo(&mut self) -> Result<bool, ChangeError> {
        self.step(false)
    }

    /// Redoes the edit that was undone last; false if there is none.
    ///
    /// # Errors
    /// The same errors as [`SceneViewer::undo`].
    pub fn redo(&mut self) -> Result<bool, ChangeError> {
        self.step(true)
    }

    fn step(&mut self, redo: bool) -> Result<bool, ChangeError> {
        let unsaved = self.editor.is_unsaved();
        let done = if redo { self.editor.redo(&mut self.scene) } else { self.editor.undo(&mut self.scene) };
        let Some(changed) = done else { return Ok(false) };
        self.follow_or(&changed, |editor, scene| editor.refuse_step(scene, redo, unsaved))?;
        Ok(true)
    }

    /// Saves the scene as `.instgs`.
    pub fn save(&mut self, path: &Path) -> Result<(), PlayerError> {
        self.write_copy(path)?;
        self.editor.saved();
        Ok(())
    }

    /// Like [`SceneViewer::save`], but unsaved changes stay marked as unsaved.
    pub fn write_copy(&self, path: &Path) -> Result<(), PlayerError> {
        self.check_whole(path)?;
        Ok(save_scene(path, &self.scene)?)
    }

    /// Writes the scene, including hidden instances, in the format of the file's extension; see [`export_scene`].
    pub fn export(&self, path: &Path, up: DVec3) -> Result<(), PlayerError> {
        self.check_whole(path)?;
        export_scene(path, &self.scene, ExportFormat::of(path, None)?, up)?;
        Ok(())
    }

    /// Like [`SceneViewer::follow`], but a change that the device refuses without being lost is reverted with
    /// `take_back`.
    fn follow_or(
        &mut self,
        changed: &Changed,
        take_back: impl FnOnce(&mut Editor, &mut InstancedScene),
    ) -> Result<(), ChangeError> {
        match self.follow(changed) {
            Err(error) if !error.is_lost() => {
                take_back(&mut self.editor, &mut self.scene);
                self.upload()?;
                Err(ChangeError::Reverted(error))
            }
            done => Ok(done?),
        }
    }

    /// Updates the device's scene after a change of the host's.
    fn follow(&mut self, changed: &Changed) -> Result<(), PlayerError> {
        match changed {
            Changed::Places(instances) => {
                let place = |&k: &usize| (k, self.scene.instances[k].world_from_template);
                let places: Vec<_> = instances.iter().map(place).collect();
                self.on_device.device_mut().place_instances(&places)?;
            }
            Changed::Shown(instances) => self.show(instances.iter().copied())?,
            Changed::Everything => self.upload()?,
        }
        Ok(())
    }

    /// Updates on the device which of these instances are drawn, from the editor's hidden set.
    pub(super) fn show(&mut self, instances: impl IntoIterator<Item = usize>) -> Result<(), PlayerError> {
        let shown: Vec<_> = instances.into_iter().map(|k| (k, !self.editor.hidden().contains(&k))).collect();
        Ok(self.on_device.device_mut().show_instances(&shown)?)
    }
}
