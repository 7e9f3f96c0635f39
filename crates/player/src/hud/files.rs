//! The panels that open and save files: a path, the system's file dialog, and recent files.

use std::path::PathBuf;
use std::sync::mpsc::{Receiver, TryRecvError, channel};

use egui::{Align2, Context, TextEdit, Ui};

use super::{Facts, OpenPanels, Place, WIDTH, panel};
use crate::actions::Action;
use crate::path_field::PathField;
use crate::texts;

/// Endings of files that can be opened; below, of files that can be written.
const READ: [&str; 6] = ["instgs", "ply", "spz", "sog", "splat", "glb"];
const WRITTEN: [&str; 8] = ["instgs", "glb", "usda", "usdc", "html", "ply", "spz", "sog"];

/// State of both panels.
#[derive(Default)]
pub(crate) struct FilePanel {
    open: PathField,
    save: PathField,
    /// The dialog that is open, and whether it is for saving.
    dialog: Option<(Receiver<Option<PathBuf>>, bool)>,
    /// True if the last dialog gave no file.
    no_dialog: bool,
}

/// True if Enter went down, and is not just held: a key that is held is no answer to a question.
fn enter_was_pressed(input: &egui::InputState) -> bool {
    let is_enter = |event: &egui::Event| {
        matches!(event, egui::Event::Key { key: egui::Key::Enter, pressed: true, repeat: false, .. })
    };
    input.events.iter().any(is_enter)
}

impl FilePanel {
    /// True while the system's dialog is open.
    pub(crate) fn waits(&self) -> bool {
        self.dialog.is_some()
    }

    /// Lays out the panels that are open.
    pub(super) fn lay_out(
        &mut self,
        ctx: &Context,
        facts: &Facts<'_>,
        panels: &mut OpenPanels,
        actions: &mut Vec<Action>,
    ) {
        self.answer(ctx, panels, actions);
        if !panels.save_as {
            // The next time it begins with the scene's own file.
            self.save.clear();
        } else if self.save.is_empty() {
            self.save.give(facts.file);
        }
        let (mut opens, mut saves) = (panels.open, panels.save_as);
        panel(ctx, texts::OPEN, Place::of(ctx, Align2::CENTER_TOP), &mut opens, |ui| {
            if let Some(path) = self.opening(ui, facts) {
                actions.push(Action::Open(path));
                panels.open = false;
            }
        });
        panel(ctx, texts::SAVE_AS, Place::of(ctx, Align2::CENTER_TOP), &mut saves, |ui| {
            if let Some(to) = self.saving(ui) {
                actions.push(Action::Write { to, may_replace: false });
                panels.save_as = false;
            }
        });
        // The field has the focus, and takes the key before the window does.
        let stays = !ctx.input(|input| input.key_pressed(egui::Key::Escape));
        (panels.open, panels.save_as) = (panels.open && opens && stays, panels.save_as && saves && stays);
    }

    fn opening(&mut self, ui: &mut Ui, facts: &Facts<'_>) -> Option<PathBuf> {
        ui.set_min_width(1.5 * WIDTH);
        let mut chosen = self.path_row(ui, false);
        ui.label(texts::OPENS);
        if !facts.recent.is_empty() {
            ui.strong(texts::RECENT);
            for path in facts.recent {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                if ui.button(name).on_hover_text(path.display().to_string()).clicked() {
                    chosen = Some(path.clone());
                }
            }
        }
        chosen
    }

    fn saving(&mut self, ui: &mut Ui) -> Option<PathBuf> {
        ui.set_min_width(1.5 * WIDTH);
        let chosen = self.path_row(ui, true);
        ui.label(texts::FORMATS);
        chosen
    }

    /// The field of a path with its buttons; returns the path once it is confirmed.
    fn path_row(&mut self, ui: &mut Ui, saves: bool) -> Option<PathBuf> {
        let named = if saves { &mut self.save } else { &mut self.open };
        let mut done = false;
        ui.horizontal(|ui| {
            ui.label(texts::FILE);
            let field = ui.add(TextEdit::singleline(&mut named.text).desired_width(WIDTH));
            // Enter takes the focus from the field, which must not get it back before that is seen.
            done |= field.lost_focus() && ui.input(enter_was_pressed);
            if !done && ui.memory(|memory| memory.focused().is_none()) {
                field.request_focus();
            }
            done |= ui.button(if saves { texts::SAVE } else { texts::OPEN }).clicked();
        });
        let path = named.path();
        if ui.add_enabled(self.dialog.is_none(), egui::Button::new(texts::BROWSE)).clicked() {
            self.no_dialog = false;
            self.dialog = Some((ask(saves, path.clone().unwrap_or_default(), ui.ctx().clone()), saves));
        }
        if self.no_dialog {
            ui.label(texts::NO_DIALOG);
        }
        path.filter(|_| done)
    }

    /// Takes what the dialog gave.
    fn answer(&mut self, ctx: &Context, panels: &mut OpenPanels, actions: &mut Vec<Action>) {
        let Some((receiver, saves)) = &self.dialog else { return };
        let path = match receiver.try_recv() {
            Err(TryRecvError::Empty) => return,
            Ok(path) => path,
            Err(TryRecvError::Disconnected) => None,
        };
        match path {
            Some(to) if *saves => {
                // The system's dialog asks itself before it gives a file that is there already.
                actions.push(Action::Write { to, may_replace: true });
                panels.save_as = false;
            }
            Some(path) => {
                actions.push(Action::Open(path));
                panels.open = false;
            }
            None => self.no_dialog = true,
        }
        self.dialog = None;
        ctx.request_repaint();
    }
}

/// Opens the system's dialog beside the window; what it gives arrives later, none if it was closed or there is none.
fn ask(saves: bool, path: PathBuf, ctx: Context) -> Receiver<Option<PathBuf>> {
    let (sender, receiver) = channel();
    std::thread::spawn(move || {
        let endings: &[&str] = if saves { &WRITTEN } else { &READ };
        let mut dialog = rfd::FileDialog::new().add_filter(texts::SCENE, endings);
        if let Some(folder) = path.parent().filter(|folder| folder.is_dir()) {
            dialog = dialog.set_directory(folder);
        }
        if let Some(name) = path.file_name().filter(|_| saves) {
            dialog = dialog.set_file_name(name.to_string_lossy());
        }
        // The window may be gone.
        let _ = sender.send(if saves { dialog.save_file() } else { dialog.pick_file() });
        ctx.request_repaint();
    });
    receiver
}
