//! Editing in the window: drags of handles and of the brush, the panel, and keys.

use glam::DVec3;
use winit::keyboard::KeyCode;

use super::{Live, split};
use crate::actions::{Action, Panel};
use crate::error::{ChangeError, PlayerError};
use crate::gizmo::{Drag, Gizmo, GizmoMode, Handle};
use crate::texts;
use instgs_vk::scene::Camera;
use instgs_vk::scene::edit::{Edit, EditOutcome};

/// Spacing of the points of a brush stroke, pixels.
const BRUSH_STEP_PX: f64 = 3.0;

/// State of the pointer's editing tools.
#[derive(Default)]
pub(super) struct Editing {
    /// The kind of handles that are shown.
    pub(super) mode: GizmoMode,
    /// The drag in progress.
    grip: Option<Grip>,
    /// The handle under the pointer.
    hovered: Option<Handle>,
}

/// What a drag in progress holds.
enum Grip {
    Handle(Drag),
    Brush(Stroke),
}

/// A brush stroke, from the button's press on.
struct Stroke {
    template: u32,
    /// Centres of the brush in the template's frame.
    centres: Vec<DVec3>,
    /// Pointer positions since the last frame, pixels.
    pending_px: Vec<[f64; 2]>,
    last_px: [f64; 2],
}

impl Editing {
    /// The handle that is drawn highlighted.
    pub(super) fn hot(&self) -> Option<Handle> {
        match &self.grip {
            Some(Grip::Handle(drag)) => Some(drag.handle()),
            Some(Grip::Brush(_)) => None,
            None => self.hovered,
        }
    }

    /// True while a handle or the brush is dragged.
    pub(super) fn is_held(&self) -> bool {
        self.grip.is_some()
    }
}

impl Live {
    /// Position of the pointer, interface points.
    pub(super) fn pointer_points(&self) -> [f64; 2] {
        self.input.controls.pointer_px().map(|v| v / self.screen.per_point())
    }

    /// The camera with interface points for pixels, in which handles are laid out and dragged.
    pub(super) fn handle_camera(&self) -> Camera {
        let (camera, per_point) =
            (self.camera.navigator.camera(self.screen.swapchain.size_px()), self.screen.per_point());
        let [fx, fy, cx, cy] = [camera.fx, camera.fy, camera.cx, camera.cy].map(|v| v / per_point);
        Camera { fx, fy, cx, cy, ..camera }
    }

    /// The handles of the selection as the camera sees them now.
    pub(super) fn gizmo(&self) -> Option<Gizmo> {
        if self.has_brush() || self.input.boxing.on {
            return None;
        }
        let centre = self.session.viewer.editor().chosen_centre(self.session.viewer.scene())?;
        Gizmo::new(self.input.editing.mode, centre, &self.handle_camera())
    }

    /// True if clicks and drags erase; there must be a selection to erase from.
    fn has_brush(&self) -> bool {
        self.hud.edit.brush.on && !self.session.viewer.editor().chosen().is_empty()
    }

    /// Centre and radius of the brush at the selection's depth, window pixels; `None` if the brush is off.
    pub(super) fn brush_px(&self) -> Option<([f64; 2], f64)> {
        let (brush, scene, editor) = (self.hud.edit.brush, self.session.viewer.scene(), self.session.viewer.editor());
        let centre = if brush.on { editor.chosen_centre(scene) } else { None }?;
        let scale = scene.instances[*editor.chosen().first()?].world_from_template.scale();
        let camera = self.camera.navigator.camera(self.screen.swapchain.size_px());
        let depth = camera.view_from_point(centre).z;
        (depth > 0.0).then(|| (self.input.controls.pointer_px(), brush.radius * scale * camera.fy / depth))
    }

    /// The pointer moved, maybe over the overlay; true if that changes what is drawn.
    pub(super) fn hover(&mut self, over_interface: bool) -> bool {
        let at = self.input.controls.pointer_px();
        if self.split.as_mut().is_some_and(|split| split.follow(at)) {
            return true;
        }
        if self.input.boxing.on {
            return self.box_hover(over_interface);
        }
        let has_brush = self.has_brush();
        match &mut self.input.editing.grip {
            Some(Grip::Handle(_)) => return true,
            Some(Grip::Brush(stroke)) => {
                let far = (at[0] - stroke.last_px[0]).hypot(at[1] - stroke.last_px[1]) >= BRUSH_STEP_PX;
                if far {
                    stroke.last_px = at;
                    stroke.pending_px.push(at);
                }
                return true;
            }
            // The brush's circle follows the pointer.
            None if has_brush => return true,
            None => {}
        }
        let hovered = self.gizmo().filter(|_| !over_interface).and_then(|gizmo| gizmo.handle_at(self.pointer_points()));
        std::mem::replace(&mut self.input.editing.hovered, hovered) != hovered
    }

    /// The left button is pressed over the view; true if it grabs something.
    pub(super) fn grab(&mut self) -> Result<bool, PlayerError> {
        self.let_go()?;
        self.input.controls.forget_hold();
        let at = self.input.controls.pointer_px();
        if self.split.as_mut().is_some_and(|split| split.grab(at)) {
            return Ok(true);
        }
        if self.input.controls.shift {
            // A click adds to the selection, a drag pans.
            return Ok(false);
        }
        if self.input.boxing.on {
            return Ok(self.box_grab());
        }
        self.input.editing.grip = if self.has_brush() {
            let at = self.input.controls.pointer_px();
            let touched = self.instance_at(at)?;
            let (scene, editor) = (self.session.viewer.scene(), self.session.viewer.editor());
            let template = touched.map(|k| scene.instances[k].template);
            // Only on selected templates: a stroke that begins elsewhere orbits.
            template.filter(|&template| editor.has_chosen_of(scene, template)).map(|template| {
                Grip::Brush(Stroke { template, centres: Vec::new(), pending_px: vec![at], last_px: at })
            })
        } else {
            let (gizmo, at) = (self.gizmo(), self.pointer_points());
            let drag = gizmo.and_then(|gizmo| gizmo.handle_at(at).and_then(|handle| gizmo.grab(handle, at)));
            if drag.is_some() {
                self.input.controls.take_hold();
            }
            drag.map(Grip::Handle)
        };
        if self.input.editing.grip.is_some() {
            // A change that a field of the panel started is an undo step of its own.
            self.session.viewer.editor_mut().finish();
        }
        Ok(self.input.editing.grip.is_some())
    }

    /// Applies the drag at the pointer's position: once per frame, however many events came before it.
    pub(super) fn follow_grip(&mut self) -> Result<(), PlayerError> {
        match self.input.editing.grip.take() {
            Some(Grip::Handle(drag)) => {
                let moves = !self.input.controls.holds_still();
                let motion = moves.then(|| drag.motion(&self.handle_camera(), self.pointer_points())).flatten();
                if let (Some(motion), Some(which)) = (motion, self.session.viewer.editor().selector()) {
                    let done = self.session.viewer.edit_live(&motion.edit(which));
                    self.show_outcome(done)?;
                }
                self.input.editing.grip = Some(Grip::Handle(drag));
            }
            Some(Grip::Brush(mut stroke)) => {
                self.stroke(&mut stroke)?;
                self.input.editing.grip = Some(Grip::Brush(stroke));
            }
            None => self.box_follow(),
        }
        Ok(())
    }

    /// Erases along the brush's path since the last frame.
    fn stroke(&mut self, stroke: &mut Stroke) -> Result<(), PlayerError> {
        let before = stroke.centres.len();
        for at in std::mem::take(&mut stroke.pending_px) {
            let touched = self.session.viewer.template_point_at(self.in_picture(at));
            let touched = self.found(touched)?;
            stroke.centres.extend(touched.filter(|touched| touched.0 == stroke.template).map(|touched| touched.1));
        }
        if stroke.centres.len() == before {
            return Ok(());
        }
        let (template, radius) = (stroke.template, self.hud.edit.brush.radius);
        let erase = |centres: &[DVec3]| Edit::Erase { template, centres: centres.to_vec(), radius };
        let done = self.session.viewer.edit_live(&erase(&stroke.centres));
        if let Err(ChangeError::Rejected(_) | ChangeError::Reverted(_)) = done {
            // The template would be empty: keeps what was erased before.
            stroke.centres.truncate(before);
            if before > 0 {
                notice_of(self.session.viewer.edit_live(&erase(&stroke.centres)))?;
            }
        }
        self.show_outcome(done)
    }

    /// Completes the drag as one change; false if there was none.
    pub(super) fn let_go(&mut self) -> Result<bool, PlayerError> {
        self.follow_grip()?;
        let held = self.input.editing.grip.take().is_some();
        if held {
            self.session.viewer.editor_mut().finish();
        }
        let line = self.split.as_mut().is_some_and(split::Split::let_go);
        Ok(held | line | self.box_let_go())
    }

    /// Reverts the drag or the change that waits for a button, or turns the brush off; false if there was none of them.
    pub(super) fn drop_grip(&mut self) -> Result<bool, PlayerError> {
        if self.input.editing.grip.take().is_some() {
            self.session.viewer.cancel_live()?;
            return Ok(true);
        }
        let drew = self.hud.edit.stop_points();
        // The preview of a scattering, or the box of a cut.
        let editor = self.session.viewer.editor();
        if self.hud.edit.is_busy() && (editor.is_live() || editor.has_live_failed()) {
            self.session.viewer.cancel_live()?;
            return Ok(true);
        }
        Ok(std::mem::take(&mut self.hud.edit.brush.on) || drew)
    }

    /// Carries out the panel's actions.
    pub(super) fn act(&mut self, actions: Vec<Action>) -> Result<(), PlayerError> {
        for action in actions {
            // These two may answer the question that is displayed; the others withdraw it.
            if !matches!(action, Action::Open(_) | Action::Write { .. }) {
                self.input.asked = None;
            }
            match action {
                Action::Edit(edit) => {
                    let done = self.session.viewer.edit(&edit);
                    self.show_outcome(done)?;
                }
                Action::Live(edit) => {
                    let done = self.session.viewer.edit_live(&edit);
                    self.show_outcome(done)?;
                }
                Action::Finish => self.session.viewer.editor_mut().finish(),
                Action::Cancel => self.session.viewer.cancel_live()?,
                Action::Undo => self.hud.message = notice_of(self.session.viewer.undo())?,
                Action::Redo => self.hud.message = notice_of(self.session.viewer.redo())?,
                Action::Hide => drop(self.session.viewer.hide_chosen()?),
                Action::ShowAll => drop(self.session.viewer.show_all()?),
                Action::ChooseAlike => {
                    let (editor, scene) = self.session.viewer.editor_and_scene();
                    editor.choose_alike(scene);
                }
                Action::ChooseGroup => {
                    let (editor, scene) = self.session.viewer.editor_and_scene();
                    editor.choose_group(scene);
                }
                Action::Mode(mode) => self.input.editing.mode = mode,
                Action::Travel(by) => self.travel(by)?,
                Action::SetHidden(which, hidden) => drop(self.session.viewer.set_hidden(&which, hidden)?),
                Action::SetLocked(which, locked) => {
                    self.session.viewer.editor_mut().set_locked(&which, locked);
                }
                Action::Choose(which, more) => self.session.viewer.editor_mut().choose(which, more),
                Action::Toggle(k) => self.session.viewer.editor_mut().click(Some(k), true),
                Action::TogglePanel(panel) => self.toggle_panel(panel),
                Action::Boxes => self.toggle_boxes()?,
                Action::Split => self.toggle_split()?,
                Action::Save => self.write_beside(&self.session.save_path(), false),
                Action::Write { to, may_replace } => self.write_beside(&to, may_replace),
                Action::Open(path) => {
                    // The panel stays until the question is answered.
                    let asks = !self.ask_and_open(&path);
                    self.hud.panels.open |= asks;
                }
                Action::CancelWork => self.cancel_work(),
                Action::Draw { take, size_px, frames } => self.draw_frames(take, size_px, frames),
                Action::Frame
                | Action::LookAlong(_)
                | Action::FirstView
                | Action::KeepCamera
                | Action::ShowKept(_)
                | Action::RemoveKept(_) => self.act_on_camera(&action)?,
            }
        }
        Ok(())
    }

    /// Undoes or redoes a number of steps of the list.
    fn travel(&mut self, by: isize) -> Result<(), PlayerError> {
        // A preview is not in the list: it would become a step of its own, after which nothing can be redone.
        self.session.viewer.cancel_live()?;
        for _ in 0..by.unsigned_abs() {
            let done = if by < 0 { self.session.viewer.undo() } else { self.session.viewer.redo() };
            if let Err(error) = done {
                self.hud.message = Some(error.notice()?);
                break;
            }
        }
        Ok(())
    }

    /// Shows or hides a panel. The Properties panel is open by default, but needs a selection.
    pub(super) fn toggle_panel(&mut self, panel: Panel) {
        let flag = self.hud.panels.flag(panel);
        *flag = !*flag;
        let empty = self.session.viewer.editor().chosen().is_empty();
        if panel == Panel::Properties && *flag && empty {
            self.hud.message = Some(texts::NOTHING_SELECTED.into());
        }
        self.hud.visible = true;
    }

    /// Displays why an edit was not carried out, or its first warning.
    fn show_outcome(&mut self, done: Result<EditOutcome, ChangeError>) -> Result<(), PlayerError> {
        self.hud.message = match done {
            Ok(outcome) => outcome.warnings.into_iter().next(),
            Err(error) => Some(error.notice()?),
        };
        self.input.asked = None;
        Ok(())
    }

    /// Handles keys that change the scene; false for other keys. With `repeats` the key is held: what it moves is one undo step, and,
    /// with Ctrl, what is to be done once is not done again.
    pub(super) fn edit_key(&mut self, code: KeyCode, repeats: bool) -> Result<bool, PlayerError> {
        if repeats && self.input.controls.control && !matches!(code, KeyCode::KeyZ | KeyCode::KeyY) {
            return Ok(true);
        }
        if self.input.boxing.on {
            if self.box_key(code, repeats)? {
                return Ok(true);
            }
            if !is_for_boxes_too(code, self.input.controls.control) {
                return Ok(false);
            }
        }
        if self.input.controls.control {
            if matches!(code, KeyCode::KeyZ | KeyCode::KeyY | KeyCode::KeyS) {
                self.let_go()?;
            }
            let done = match code {
                KeyCode::KeyZ if self.input.controls.shift => self.session.viewer.redo(),
                KeyCode::KeyZ => self.session.viewer.undo(),
                KeyCode::KeyY => self.session.viewer.redo(),
                KeyCode::KeyS if self.input.controls.shift => {
                    self.toggle_panel(Panel::SaveAs);
                    Ok(true)
                }
                KeyCode::KeyS => {
                    self.write_beside(&self.session.save_path(), false);
                    Ok(true)
                }
                KeyCode::KeyO => {
                    self.toggle_panel(Panel::Open);
                    Ok(true)
                }
                KeyCode::KeyA | KeyCode::KeyI => {
                    self.let_go()?;
                    let (editor, scene) = self.session.viewer.editor_and_scene();
                    if code == KeyCode::KeyI {
                        editor.choose_others(scene);
                    } else {
                        editor.choose(0..scene.instances.len(), false);
                    }
                    Ok(true)
                }
                KeyCode::KeyL => {
                    self.let_go()?;
                    let all: Vec<usize> = self.session.viewer.editor().locked().iter().copied().collect();
                    Ok(self.session.viewer.editor_mut().set_locked(&all, false))
                }
                KeyCode::KeyH => {
                    self.let_go()?;
                    Ok(if self.input.controls.shift {
                        self.session.viewer.show_all()?
                    } else {
                        self.session.viewer.hide_chosen()?
                    })
                }
                KeyCode::KeyD => Ok(true),
                _ => return Ok(false),
            };
            match done {
                Ok(true) => {}
                Ok(false) => {
                    let nothing = match code {
                        KeyCode::KeyH => texts::NOTHING_TO_HIDE,
                        KeyCode::KeyL => texts::NOTHING_TO_UNLOCK,
                        _ => texts::NOTHING_TO_UNDO_OR_REDO,
                    };
                    self.hud.message = Some(nothing.into());
                }
                Err(error) => self.hud.message = Some(error.notice()?),
            }
            if code != KeyCode::KeyD {
                return Ok(true);
            }
        }
        let mode = match code {
            KeyCode::KeyM => Some(GizmoMode::Move),
            KeyCode::KeyT => Some(GizmoMode::Turn),
            KeyCode::KeyX => Some(GizmoMode::Scale),
            KeyCode::KeyN => Some(GizmoMode::Off),
            _ => None,
        };
        if let Some(mode) = mode {
            self.let_go()?;
            self.input.editing.mode = mode;
            return Ok(true);
        }
        if code == KeyCode::Backspace && self.hud.edit.remove_point() {
            return Ok(true);
        }
        let Some(which) = self.session.viewer.editor().selector() else { return Ok(false) };
        let edit = match code {
            KeyCode::KeyD if self.input.controls.control => Edit::Duplicate { which, by: self.beside(), turn: None },
            KeyCode::Delete | KeyCode::Backspace => Edit::Delete { which },
            // With Ctrl, plus and minus change the size of the panels.
            _ if self.input.controls.control => return Ok(false),
            _ => match self.key_motion(code) {
                Some(motion) => motion.edit(which),
                None => return Ok(false),
            },
        };
        self.let_go()?;
        let viewer = &mut self.session.viewer;
        let done = if repeats { viewer.edit_again(&edit) } else { viewer.edit(&edit) };
        self.show_outcome(done)?;
        Ok(true)
    }
}

/// True for keys of the editor that serve the tool for boxes as well: kinds of handles, and the panels of files. The others change
/// instances, which its undo does not bring back.
fn is_for_boxes_too(code: KeyCode, control: bool) -> bool {
    match code {
        KeyCode::KeyO | KeyCode::KeyS => control,
        KeyCode::KeyM | KeyCode::KeyT | KeyCode::KeyX | KeyCode::KeyN => !control,
        _ => false,
    }
}

/// The notice about a change that was not carried out; `None` if it was.
fn notice_of<T>(done: Result<T, ChangeError>) -> Result<Option<String>, PlayerError> {
    done.err().map(ChangeError::notice).transpose()
}
