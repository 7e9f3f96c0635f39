//! What the user asks for in panels and with keys.

use std::path::PathBuf;

use crate::gizmo::GizmoMode;
use instgs_vk::scene::edit::Edit;

/// The panels that can be shown and hidden.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Panel {
    Help,
    Scene,
    Properties,
    View,
    Cameras,
    History,
    Statistics,
    Open,
    SaveAs,
}

/// Which frames are drawn into files.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Take {
    /// The view as it is: one picture.
    Still,
    /// A full turn around the target.
    Turntable,
    /// From kept camera to kept camera.
    AlongKept,
}

/// An action that the user asked for.
#[derive(Clone, Debug, PartialEq)]
pub(super) enum Action {
    Edit(Edit),
    /// Replaces the edit of the change in progress.
    Live(Edit),
    Finish,
    Cancel,
    Undo,
    Redo,
    /// Undoes (negative) or redoes a number of steps.
    Travel(isize),
    Hide,
    ShowAll,
    SetHidden(Vec<usize>, bool),
    SetLocked(Vec<usize>, bool),
    /// Selects instances; with true in addition to those that are selected.
    Choose(Vec<usize>, bool),
    /// Adds an instance to the selection or removes it.
    Toggle(usize),
    ChooseAlike,
    ChooseGroup,
    Mode(GizmoMode),
    /// Moves the camera so that the selection fills the view.
    Frame,
    /// Looks at the target along a direction, world frame.
    LookAlong(glam::DVec3),
    FirstView,
    KeepCamera,
    /// Shows a kept camera.
    ShowKept(usize),
    RemoveKept(usize),
    /// Draws frames of a size in pixels into files.
    Draw {
        take: Take,
        size_px: [u32; 2],
        frames: u32,
    },
    /// Cancels the work that runs beside the picture.
    CancelWork,
    TogglePanel(Panel),
    Boxes,
    /// Shows or hides the scene as it was opened beside the present one.
    Split,
    Save,
    Open(PathBuf),
    /// Writes a file, in the format that its extension names.
    Write {
        to: PathBuf,
        /// True if the user has agreed that a file which is there already is replaced.
        may_replace: bool,
    },
}
