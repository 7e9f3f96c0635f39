//! The tool for boxes around objects, in the window: clicks that draw boxes, drags of handles, the search for similar
//! objects, files.

mod search;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use winit::keyboard::KeyCode;

use super::Live;
use super::leaving::is_same_file;
use crate::box_handles::{BoxDrag, BoxHandles, BoxPart, after, box_at_edge};
use crate::boxes::BoxList;
use crate::error::PlayerError;
use crate::hud_boxes::{BoxAction, BoxFacts, BoxPanel, paint_boxes};
use crate::search::Search;
use crate::texts;
use instgs_io::write_boxes;
use instgs_objects::segment::standing::{Standing, Surroundings, UprightBox};
use instgs_vk::scene::{Boxes, ObjectBox};

/// How often the window polls the progress of a search.
const POLL: Duration = Duration::from_millis(100);

/// State of the tool for boxes.
#[derive(Default)]
pub(super) struct Boxing {
    /// True if clicks, keys and handles are for boxes.
    pub(super) on: bool,
    list: BoxList,
    grip: Option<BoxDrag>,
    hovered: Option<BoxPart>,
    /// Surroundings of the cloud, computed at the first click, and the editor's number of the background that they are of.
    around: Option<(u64, Surroundings)>,
    search: Option<Search>,
    /// True if searches also find objects of other sizes.
    other_sizes: bool,
    panel: BoxPanel,
    /// True if the last click drew a box.
    drew: bool,
    /// The file that the boxes were read from or saved to.
    file: Option<PathBuf>,
}

impl Boxing {
    /// The tool with the boxes of a file, active at once.
    pub(super) fn from_file(path: PathBuf, boxes: Boxes) -> Self {
        Self { on: true, list: BoxList::from_file(boxes), file: Some(path), ..Self::default() }
    }

    /// True while a part of a box is dragged.
    pub(super) fn is_held(&self) -> bool {
        self.grip.is_some()
    }

    /// True while a search is running.
    pub(super) fn is_searching(&self) -> bool {
        self.search.is_some()
    }

    /// The contents of a file with the present boxes.
    pub(super) fn boxes_of_file(&self) -> Boxes {
        self.list.to_file()
    }

    /// True if boxes were changed since they were saved.
    pub(super) fn is_unsaved(&self) -> bool {
        self.list.is_unsaved()
    }

    /// When the window should redraw by itself to show a search's progress.
    pub(super) fn wakes_at(&self) -> Option<Instant> {
        self.search.as_ref().map(|_| Instant::now() + POLL)
    }
}

impl Live {
    /// Activates or deactivates the tool.
    pub(super) fn toggle_boxes(&mut self) -> Result<(), PlayerError> {
        self.let_go()?;
        // The outline of selected instances does not belong to boxes.
        self.session.viewer.editor_mut().click(None, false);
        self.input.boxing.on = !self.input.boxing.on;
        Ok(())
    }

    fn box_handles(&self) -> Option<BoxHandles> {
        let chosen = &self.input.boxing.list.chosen_box()?.object;
        Some(BoxHandles::new(chosen, self.input.editing.mode, &self.handle_camera()))
    }

    /// The pointer moved; true if that changes the overlay.
    pub(super) fn box_hover(&mut self, over_interface: bool) -> bool {
        if self.input.boxing.grip.is_some() {
            return true;
        }
        let at = self.pointer_points();
        let hovered = self.box_handles().filter(|_| !over_interface).and_then(|handles| handles.part_at(at));
        std::mem::replace(&mut self.input.boxing.hovered, hovered) != hovered
    }

    /// The left button is pressed over the view; true if it grabs a handle.
    pub(super) fn box_grab(&mut self) -> bool {
        let at = self.pointer_points();
        let handles = self.box_handles();
        self.input.boxing.grip =
            handles.and_then(|handles| handles.part_at(at).and_then(|part| handles.grab(part, at)));
        if self.input.boxing.grip.is_some() {
            self.input.controls.take_hold();
            // A change that a field of the panel started is an undo step of its own.
            self.input.boxing.list.finish();
        }
        self.input.boxing.grip.is_some()
    }

    /// Drags the held part to the pointer.
    pub(super) fn box_follow(&mut self) {
        let Some(drag) = self.input.boxing.grip.as_ref().filter(|_| !self.input.controls.holds_still()) else { return };
        if let Some(object) = drag.moved(&self.handle_camera(), self.pointer_points()) {
            self.input.boxing.list.change(object);
        }
    }

    /// Completes the drag; false if nothing was held.
    pub(super) fn box_let_go(&mut self) -> bool {
        self.box_follow();
        let held = self.input.boxing.grip.take().is_some();
        if held {
            self.input.boxing.list.finish();
        }
        held
    }

    /// Reverts the drag; false if nothing was held.
    fn box_drop(&mut self) -> bool {
        let held = self.input.boxing.grip.take().is_some();
        if held {
            self.input.boxing.list.cancel();
        }
        held
    }

    /// A click on the scene: selects the box there, or draws one around the object there. With Shift it removes the
    /// box.
    pub(super) fn box_click(&mut self, at_px: [f64; 2]) -> Result<(), PlayerError> {
        self.hud.message = None;
        self.input.boxing.drew = false;
        let in_picture = self.in_picture(at_px);
        let place = self.session.viewer.point_at(in_picture);
        let place = self.found(place)?;
        let objects = self.input.boxing.list.boxes().iter().map(|listed| &listed.object);
        let at_edge = box_at_edge(objects, &self.handle_camera(), at_px.map(|v| v / self.screen.per_point()));
        let there = at_edge.or_else(|| self.input.boxing.list.containing(place?));
        match (there, place) {
            (Some(index), _) if self.input.controls.shift => self.input.boxing.list.remove(index),
            (None, _) if self.input.controls.shift => self.says(texts::NO_BOX_HERE),
            (Some(index), _) => self.input.boxing.list.choose(Some(index)),
            (None, None) => self.input.boxing.list.choose(None),
            (None, Some(place)) => match self.instance_at(at_px)? {
                Some(k) => self.says(texts::is_an_instance(k)),
                None => self.box_around(place),
            },
        }
        self.input.asked = None;
        Ok(())
    }

    /// The last click was the first of a double click, which has another meaning: removes the box it drew.
    pub(super) fn box_unclick(&mut self) {
        if std::mem::take(&mut self.input.boxing.drew) && self.input.boxing.on {
            self.input.boxing.list.undraw();
            self.hud.message = None;
        }
    }

    /// The next click or key is unrelated to the box that the last click drew.
    pub(super) fn box_stays(&mut self) {
        self.input.boxing.drew = false;
    }

    /// Draws a box around the object at a point in world coordinates.
    fn box_around(&mut self, place: glam::DVec3) {
        if self.session.viewer.is_in_pages() {
            return self.says(texts::IN_PAGES);
        }
        let [_, _, up] = self.camera.navigator.level_axes();
        let cloud = &self.session.viewer.scene().background;
        // What was given to an object since, or came back, changes what stands there.
        let background = self.session.viewer.editor().background();
        self.input.boxing.around.take_if(|(of, _)| *of != background);
        let (_, around) = self.input.boxing.around.get_or_insert_with(|| (background, Surroundings::new(cloud, up)));
        match around.at(place, self.camera.navigator.eye()) {
            Standing::Object(found) => {
                self.input.boxing.list.draw(object_of(found));
                self.input.boxing.drew = true;
            }
            Standing::Unclear(usual) => {
                self.input.boxing.list.draw(object_of(usual));
                self.input.boxing.drew = true;
                self.says(texts::UNCLEAR_OBJECT);
            }
            Standing::Ground => {
                self.input.boxing.list.choose(None);
                self.says(texts::IS_GROUND);
            }
        }
    }

    fn says(&mut self, words: impl Into<String>) {
        self.hud.message = Some(words.into());
    }

    /// Handles the keys of the tool; false for other keys. With `repeats` the key is held.
    pub(super) fn box_key(&mut self, code: KeyCode, repeats: bool) -> Result<bool, PlayerError> {
        self.box_stays();
        if self.input.controls.control {
            let action = match code {
                KeyCode::KeyZ if self.input.controls.shift => BoxAction::Redo,
                KeyCode::KeyZ => BoxAction::Undo,
                KeyCode::KeyY => BoxAction::Redo,
                // With Shift, it is for the scene.
                KeyCode::KeyS if !self.input.controls.shift => {
                    BoxAction::Save(self.input.boxing.panel.file().unwrap_or_else(|| self.box_file()))
                }
                _ => return Ok(false),
            };
            self.box_let_go();
            self.act_on_boxes(vec![action])?;
            return Ok(true);
        }
        match code {
            KeyCode::KeyF => self.find_rest(),
            KeyCode::Escape if self.box_drop() => {}
            KeyCode::Escape if self.input.boxing.is_searching() => self.stop_search(),
            KeyCode::Escape if self.input.boxing.list.chosen().is_some() => self.input.boxing.list.choose(None),
            KeyCode::Escape => self.toggle_boxes()?,
            _ => {
                let Some(index) = self.input.boxing.list.chosen() else { return Ok(false) };
                return Ok(self.key_of_chosen_box(code, index, repeats));
            }
        }
        Ok(true)
    }

    fn key_of_chosen_box(&mut self, code: KeyCode, index: usize, repeats: bool) -> bool {
        if matches!(code, KeyCode::Delete | KeyCode::Backspace) {
            self.box_let_go();
            self.input.boxing.list.remove(index);
            return true;
        }
        let Some(motion) = self.key_motion(code) else { return false };
        self.box_let_go();
        if let Some(listed) = self.input.boxing.list.chosen_box() {
            let moved = after(&listed.object, motion);
            let list = &mut self.input.boxing.list;
            list.change(moved);
            if repeats { list.finish_again() } else { list.finish() }
        }
        true
    }

    /// The file to save boxes to: the one they are from, or an unused name beside the scene.
    fn box_file(&self) -> PathBuf {
        let beside = self.session.path.with_extension("boxes.json");
        let free = || if beside.exists() { self.session.free_name("boxes.json") } else { beside.clone() };
        self.input.boxing.file.clone().unwrap_or_else(free)
    }

    /// Saves the boxes to the file that the user has named; asks first if that replaces a file other than their own.
    fn ask_and_save_boxes(&mut self, path: &Path) {
        let is_own = self.input.boxing.file.as_deref().is_some_and(|own| is_same_file(own, path));
        let writes_nothing = self.input.boxing.list.has_nothing_to_save();
        if !self.asks_to_replace(path, is_own || writes_nothing) {
            self.save_boxes(path);
        }
    }

    /// Saves the boxes to a file.
    pub(super) fn save_boxes(&mut self, path: &Path) {
        self.box_let_go();
        if self.input.boxing.list.has_nothing_to_save() {
            return self.says(texts::NO_BOXES);
        }
        let written = write_boxes(path, &self.input.boxing.list.to_file());
        if written.is_ok() {
            self.input.boxing.list.saved();
            self.input.boxing.panel.saved_to(path);
            self.input.boxing.file = Some(path.to_path_buf());
        }
        let [drawn, found] = self.input.boxing.list.counts();
        self.says(match written {
            Ok(()) => texts::boxes_saved(drawn + found, path),
            Err(error) => error.to_string(),
        });
    }

    /// Lays out the tool, while it is active, and returns the user's actions.
    pub(super) fn lay_out_boxes(&mut self, ctx: &egui::Context) -> Vec<BoxAction> {
        if !self.input.boxing.on {
            return Vec::new();
        }
        let (camera, handles) = (self.handle_camera(), self.box_handles());
        let held = self.input.boxing.grip.as_ref().map(BoxDrag::part);
        paint_boxes(ctx, &self.input.boxing.list, &camera, handles.as_ref(), held.or(self.input.boxing.hovered));
        if !self.hud.visible {
            return Vec::new();
        }
        let [_, _, up] = self.camera.navigator.level_axes();
        let (file, step) = (self.box_file(), self.number_step());
        let Boxing { list, panel, around, search, other_sizes, .. } = &mut self.input.boxing;
        let facts = BoxFacts {
            list,
            up: around.as_ref().map_or(up, |(_, around)| around.up()),
            step,
            mode: self.input.editing.mode,
            searched: search.as_ref().map(Search::part),
            other_sizes: *other_sizes,
            file,
        };
        panel.lay_out(ctx, &facts)
    }

    /// Carries out the panel's actions.
    pub(super) fn act_on_boxes(&mut self, actions: Vec<BoxAction>) -> Result<(), PlayerError> {
        for action in actions {
            // Saving may answer the question that is displayed; the others withdraw it.
            if !matches!(action, BoxAction::Save(_)) {
                self.input.asked = None;
            }
            let list = &mut self.input.boxing.list;
            match action {
                BoxAction::Change(object) => list.change(object),
                BoxAction::Finish => list.finish(),
                BoxAction::Undo => {
                    if !list.undo() {
                        self.says(texts::NOTHING_TO_UNDO);
                    }
                }
                BoxAction::Redo => {
                    if !list.redo() {
                        self.says(texts::NOTHING_TO_REDO);
                    }
                }
                BoxAction::Choose(index) => list.choose(Some(index)),
                BoxAction::Remove(index) => list.remove(index),
                BoxAction::Find => self.find_rest(),
                BoxAction::CancelSearch => self.stop_search(),
                BoxAction::OtherSizes(other_sizes) => self.look_for_other_sizes(other_sizes),
                BoxAction::Mode(mode) => self.input.editing.mode = mode,
                BoxAction::Save(path) => self.ask_and_save_boxes(&path),
                BoxAction::Leave => self.toggle_boxes()?,
            }
        }
        Ok(())
    }
}

/// A box with id 0, which the list replaces.
fn object_of(upright: UprightBox) -> ObjectBox {
    let UprightBox { center, size, world_from_box } = upright;
    ObjectBox { id: 0, category: None, center, size, world_from_box }
}
