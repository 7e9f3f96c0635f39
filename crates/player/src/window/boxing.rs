//! Boxes around objects, in the window: clicks that put them there, handles that are dragged, the search for the rest, files.

mod search;

use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use winit::keyboard::KeyCode;

use super::Live;
use crate::box_handles::{BoxDrag, BoxHandles, BoxPart, after, box_at_edge};
use crate::boxes::BoxList;
use crate::error::PlayerError;
use crate::hud_boxes::{BoxAction, BoxFacts, BoxPanel, paint_boxes};
use crate::search::Search;
use instgs_io::write_boxes;
use instgs_objects::segment::standing::{Standing, Surroundings, UprightBox};
use instgs_vk::scene::{Boxes, ObjectBox};

/// How often the window looks how far a search is.
const POLL: Duration = Duration::from_millis(100);

/// The tool and its state.
#[derive(Default)]
pub(super) struct Boxing {
    /// Clicks, keys and handles are for boxes.
    pub(super) on: bool,
    list: BoxList,
    grip: Option<BoxDrag>,
    hovered: Option<BoxPart>,
    /// Of the cloud; made when it is clicked first.
    around: Option<Surroundings>,
    search: Option<Search>,
    /// Searches find other sizes too.
    other_sizes: bool,
    panel: BoxPanel,
    /// The last click drew a box.
    drew: bool,
    /// Where the boxes are from or were saved.
    file: Option<PathBuf>,
}

impl Boxing {
    /// With boxes of a file.
    pub(super) fn from_file(path: PathBuf, boxes: Boxes) -> Self {
        Self { on: true, list: BoxList::from_file(boxes), file: Some(path), ..Self::default() }
    }

    /// True while something is dragged.
    pub(super) fn is_held(&self) -> bool {
        self.grip.is_some()
    }

    /// True while a search goes on.
    pub(super) fn is_searching(&self) -> bool {
        self.search.is_some()
    }

    /// What a file of the boxes holds.
    pub(super) fn boxes_of_file(&self) -> Boxes {
        self.list.to_file()
    }

    /// True if boxes were changed since they were saved.
    pub(super) fn is_unsaved(&self) -> bool {
        self.list.is_unsaved()
    }

    /// When the window should look again by itself.
    pub(super) fn wakes_at(&self) -> Option<Instant> {
        self.search.as_ref().map(|_| Instant::now() + POLL)
    }
}

impl Live {
    /// Takes the tool up or puts it away.
    pub(super) fn toggle_boxes(&mut self) -> Result<(), PlayerError> {
        self.let_go()?;
        // The outline of chosen instances is not for boxes.
        self.stage.click(None, false);
        self.boxing.on = !self.boxing.on;
        Ok(())
    }

    fn box_handles(&self) -> Option<BoxHandles> {
        let chosen = &self.boxing.list.chosen_box()?.object;
        Some(BoxHandles::new(chosen, self.editing.mode, &self.handle_camera()))
    }

    /// The pointer is somewhere else; true if the picture changes with it.
    pub(super) fn box_hover(&mut self, over_interface: bool) -> bool {
        if self.boxing.grip.is_some() {
            return true;
        }
        let at = self.pointer_points();
        let hovered = self.box_handles().filter(|_| !over_interface).and_then(|handles| handles.part_at(at));
        std::mem::replace(&mut self.boxing.hovered, hovered) != hovered
    }

    /// The left button goes down over the picture; true if it takes hold of a handle.
    pub(super) fn box_grab(&mut self) -> bool {
        let at = self.pointer_points();
        let handles = self.box_handles();
        self.boxing.grip = handles.and_then(|handles| handles.part_at(at).and_then(|part| handles.grab(part, at)));
        if self.boxing.grip.is_some() {
            self.controls.take_hold();
            // What a field of the panel began is a change of its own.
            self.boxing.list.finish();
        }
        self.boxing.grip.is_some()
    }

    /// What is held goes where the pointer is.
    pub(super) fn box_follow(&mut self) {
        let Some(drag) = self.boxing.grip.as_ref().filter(|_| !self.controls.holds_still()) else { return };
        if let Some(object) = drag.moved(&self.handle_camera(), self.pointer_points()) {
            self.boxing.list.change(object);
        }
    }

    /// What was held stays; false if nothing was.
    pub(super) fn box_let_go(&mut self) -> bool {
        self.box_follow();
        let held = self.boxing.grip.take().is_some();
        if held {
            self.boxing.list.finish();
        }
        held
    }

    /// What was held goes back; false if nothing was.
    fn box_drop(&mut self) -> bool {
        let held = self.boxing.grip.take().is_some();
        if held {
            self.boxing.list.cancel();
        }
        held
    }

    /// A click on the scene: chooses the box that is there, or puts one around what is there. With shift it takes the box
    /// away.
    pub(super) fn box_click(&mut self, at_px: [f64; 2]) -> Result<(), PlayerError> {
        self.hud.message = None;
        self.boxing.drew = false;
        let in_picture = self.in_picture(at_px);
        let place = self.stage.point_at(in_picture);
        let place = self.found(place)?;
        let objects = self.boxing.list.boxes().iter().map(|listed| &listed.object);
        let at_edge = box_at_edge(objects, &self.handle_camera(), at_px.map(|v| v / self.per_point()));
        let there = at_edge.or_else(|| self.boxing.list.containing(place?));
        match (there, place) {
            (Some(index), _) if self.controls.shift => self.boxing.list.remove(index),
            (None, _) if self.controls.shift => self.says("there is no box to take away"),
            (Some(index), _) => self.boxing.list.choose(Some(index)),
            (None, None) => self.boxing.list.choose(None),
            (None, Some(place)) => match self.instance_at(at_px)? {
                Some(k) => self.says(format!("that is instance {k} of the scene: boxes are for what has no instance")),
                None => self.box_around(place),
            },
        }
        self.warned = None;
        Ok(())
    }

    /// The last click was the first of a double click, which is not for boxes: the box it drew goes.
    pub(super) fn box_unclick(&mut self) {
        if std::mem::take(&mut self.boxing.drew) && self.boxing.on {
            self.boxing.list.undraw();
            self.hud.message = None;
        }
    }

    /// What is clicked or pressed next has nothing to do with the box that the last click drew.
    pub(super) fn box_stays(&mut self) {
        self.boxing.drew = false;
    }

    /// Puts a box around what stands at a place of the world.
    fn box_around(&mut self, place: glam::DVec3) {
        let [_, _, up] = self.navigator.level_axes();
        let cloud = &self.stage.scene().background;
        let around = self.boxing.around.get_or_insert_with(|| Surroundings::new(cloud, up));
        match around.at(place, self.navigator.eye()) {
            Standing::Object(found) => {
                self.boxing.list.draw(object_of(found));
                self.boxing.drew = true;
            }
            Standing::Unclear(usual) => {
                self.boxing.list.draw(object_of(usual));
                self.boxing.drew = true;
                self.says("where it ends cannot be told from what is around it: drag the dots until the box fits");
            }
            Standing::Ground => {
                self.boxing.list.choose(None);
                self.says("that is the ground: click what stands on it");
            }
        }
    }

    fn says(&mut self, words: impl Into<String>) {
        self.hud.message = Some(words.into());
    }

    /// Keys of the tool; false for others.
    pub(super) fn box_key(&mut self, code: KeyCode) -> Result<bool, PlayerError> {
        self.box_stays();
        if self.controls.control {
            let action = match code {
                KeyCode::KeyZ if self.controls.shift => BoxAction::Redo,
                KeyCode::KeyZ => BoxAction::Undo,
                KeyCode::KeyY => BoxAction::Redo,
                KeyCode::KeyS => BoxAction::Save(self.boxing.panel.file().unwrap_or_else(|| self.box_file())),
                _ => return Ok(false),
            };
            self.box_let_go();
            self.act_on_boxes(vec![action])?;
            return Ok(true);
        }
        match code {
            KeyCode::KeyF => self.find_rest(),
            KeyCode::Escape if self.box_drop() => {}
            KeyCode::Escape if self.boxing.is_searching() => self.stop_search(),
            KeyCode::Escape if self.boxing.list.chosen().is_some() => self.boxing.list.choose(None),
            KeyCode::Escape => self.toggle_boxes()?,
            _ => {
                let Some(index) = self.boxing.list.chosen() else { return Ok(false) };
                return Ok(self.key_of_chosen_box(code, index));
            }
        }
        Ok(true)
    }

    fn key_of_chosen_box(&mut self, code: KeyCode, index: usize) -> bool {
        if matches!(code, KeyCode::Delete | KeyCode::Backspace) {
            self.box_let_go();
            self.boxing.list.remove(index);
            return true;
        }
        let Some(motion) = self.key_motion(code) else { return false };
        self.box_let_go();
        if let Some(listed) = self.boxing.list.chosen_box() {
            let moved = after(&listed.object, motion);
            self.boxing.list.change(moved);
            self.boxing.list.finish();
        }
        true
    }

    /// Where boxes are saved: where they are from, or beside the scene under a name that is free.
    fn box_file(&self) -> PathBuf {
        let beside = self.path.with_extension("boxes.json");
        let free = || if beside.exists() { self.free_name("boxes.json") } else { beside.clone() };
        self.boxing.file.clone().unwrap_or_else(free)
    }

    /// Writes the boxes.
    pub(super) fn save_boxes(&mut self, path: &Path) {
        self.box_let_go();
        if self.boxing.list.boxes().is_empty() {
            return self.says("there are no boxes to save");
        }
        let written = write_boxes(path, &self.boxing.list.to_file());
        if written.is_ok() {
            self.boxing.list.saved();
            self.boxing.panel.saved_to(path.display().to_string());
            self.boxing.file = Some(path.to_path_buf());
        }
        let [drawn, found] = self.boxing.list.counts();
        self.says(match written {
            Ok(()) if drawn + found == 1 => format!("1 box is in {}", path.display()),
            Ok(()) => format!("{} boxes are in {}", drawn + found, path.display()),
            Err(error) => error.to_string(),
        });
    }

    /// Lays out the tool, while it is on; what its user wants done.
    pub(super) fn lay_out_boxes(&mut self, ctx: &egui::Context) -> Vec<BoxAction> {
        if !self.boxing.on {
            return Vec::new();
        }
        let (camera, handles) = (self.handle_camera(), self.box_handles());
        let held = self.boxing.grip.as_ref().map(BoxDrag::part);
        paint_boxes(ctx, &self.boxing.list, &camera, (handles.as_ref(), held.or(self.boxing.hovered)));
        if !self.hud.visible {
            return Vec::new();
        }
        let [_, _, up] = self.navigator.level_axes();
        let (file, step) = (self.box_file().display().to_string(), self.number_step());
        let Boxing { list, panel, around, search, other_sizes, .. } = &mut self.boxing;
        let facts = BoxFacts {
            list,
            up: around.as_ref().map_or(up, Surroundings::up),
            step,
            mode: self.editing.mode,
            searched: search.as_ref().map(Search::part),
            other_sizes: *other_sizes,
            file,
        };
        panel.lay_out(ctx, &facts)
    }

    /// Does what the panel asks for.
    pub(super) fn act_on_boxes(&mut self, actions: Vec<BoxAction>) -> Result<(), PlayerError> {
        for action in actions {
            self.warned = None;
            let list = &mut self.boxing.list;
            match action {
                BoxAction::Change(object) => list.change(object),
                BoxAction::Finish => list.finish(),
                BoxAction::Undo => {
                    if !list.undo() {
                        self.says("there is nothing to take back");
                    }
                }
                BoxAction::Redo => {
                    if !list.redo() {
                        self.says("there is nothing to do again");
                    }
                }
                BoxAction::Choose(index) => list.choose(Some(index)),
                BoxAction::Remove(index) => list.remove(index),
                BoxAction::Find => self.find_rest(),
                BoxAction::CancelSearch => self.stop_search(),
                BoxAction::OtherSizes(other_sizes) => self.look_for_other_sizes(other_sizes),
                BoxAction::Mode(mode) => self.editing.mode = mode,
                BoxAction::Save(path) => self.save_boxes(&path),
                BoxAction::Leave => self.toggle_boxes()?,
            }
        }
        Ok(())
    }
}

/// A box without an id, which the list gives.
fn object_of(upright: UprightBox) -> ObjectBox {
    let UprightBox { center, size, world_from_box } = upright;
    ObjectBox { id: 0, category: None, center, size, world_from_box }
}
