//! L6: the standalone player: a window on a scene, at the speed of the device.
//!
//! ```text
//!   window.rs      winit's events, one picture after another, only while something changes
//!     controls.rs  what a person does -> what changes            (knows no window system)
//!     navigation.rs   where the camera is                        (pure)
//!     window/opening.rs   devices and scenes; input.rs events; keeping.rs files; playing.rs scripts
//!     window/editing.rs   what is dragged and typed -> edits; key_steps.rs keys
//!     editor.rs    what is chosen, changed and taken back         (pure; scene::edit), steps.rs what was there
//!     gizmo.rs     arrows, rings and circle on what is chosen     (pure)
//!     window/boxing.rs   boxes around objects: clicks, drags, the search for the rest, files
//!     boxes.rs     the list of boxes, and what can be taken back    (pure)
//!     box_handles.rs  dots and other handles on a box, its edges     (pure)
//!     search.rs    what is like a box, on a thread of its own
//!     hud.rs       what is written over the picture              (egui), hud_gizmo.rs handles, hud_edit.rs the panel,
//!                  hud_boxes.rs boxes and their panel
//!       views.rs   what can be shown of a picture                (egui)
//!     resolution.rs   smaller pictures while things move         (pure)
//!     recording.rs    a camera path as it was flown              (pure)
//!     script.rs    what a person does, from a text file
//!   stage.rs       scene on the device, render passes, kernel `present`
//!     -> swapchain.rs     copy into the window's image, interface over it, show
//!   headless.rs    the same pictures without a window
//! ```
//!
//! A picture goes from the blend pass to the screen without a copy on the host: kernel `present` packs it into the pixels of
//! the window, which are copied into one of the window's images.

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
pub mod program;
pub mod recording;
pub mod resolution;
pub mod script;
pub mod search;
pub mod stage;
mod steps;
pub mod swapchain;
#[cfg(test)]
mod test_screen;
pub mod ui_painter;
pub mod views;
pub mod window;

pub use error::PlayerError;
pub use stage::{Stage, StageOptions};
