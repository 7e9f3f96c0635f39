//! The standalone player: an interactive window on a scene, drawn by the engine's renderer.
//!
//! ```text
//! window.rs             winit's events, one frame after another, only while something changes
//!   controls.rs         mouse and keyboard -> camera motion        (independent of the window system)
//!   navigation.rs       the camera's pose and motion               (pure)
//!   window/opening.rs   devices and scenes; input.rs events; keeping.rs files; leaving.rs questions; playing.rs scripts
//!   window/editing.rs   drags and panel actions -> edits; key_steps.rs keys
//!   editor.rs           selection, edits, undo history             (pure; scene::edit); steps.rs undo steps
//!   gizmo.rs            arrows, rings and circle on the selection  (pure)
//!   window/boxing.rs    boxes around objects: clicks, drags, the search for similar objects, files
//!   window/split.rs     the scene as it was opened beside the present one
//!   boxes.rs            the list of boxes, its undo history        (pure)
//!   box_handles.rs      the handles and edges of a box             (pure)
//!   search.rs           the search for similar objects, on a thread of its own
//!   window/work.rs      work beside the picture: files, frames, videos; remembered.rs recent files, settings
//!   hud.rs              tool bar and panels (egui), a file each in hud/; hud_edit.rs and hud_boxes.rs the panels of the
//!                       selection and of boxes, hud_gizmo.rs handles; texts.rs their texts, actions.rs what they ask for, path_field.rs
//!                       fields for paths
//!   views.rs            the views: colours, depth, instances ...   (egui)
//!   resolution.rs       lower resolution while the view changes    (pure)
//!   recording.rs        a recorded camera path                     (pure)
//!   script.rs           user input from a text file; panel_texts.rs finds widgets by their texts
//! scene_viewer.rs        scene on the device, render passes, kernel `present`
//!   -> swapchain.rs     copy into the window's image, overlay on top, present
//! headless.rs           the same frames without a window
//! ```
//!
//! A frame goes from the blend pass to the screen without a copy on the host: kernel `present` packs it into pixels in
//! the window's format, which are copied into one of the swapchain's images.

mod actions;
pub mod box_handles;
pub mod boxes;
pub mod clock;
pub mod controls;
pub mod editor;
pub mod error;
pub mod gizmo;
pub mod headless;
mod hud;
mod hud_boxes;
mod hud_edit;
mod hud_gizmo;
pub mod navigation;
pub mod panel_texts;
mod path_field;
pub mod program;
pub mod recording;
mod remembered;
pub mod resolution;
pub mod scene_viewer;
pub mod script;
pub mod search;
mod steps;
pub mod swapchain;
#[cfg(test)]
mod test_screen;
mod texts;
pub mod ui_painter;
pub mod views;
pub mod window;

pub use error::{ChangeError, PlayerError};
pub use scene_viewer::{SceneViewer, ViewerOptions};
