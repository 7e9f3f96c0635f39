//! All texts of the window, in one place so that they can be translated. Errors of files and of the device come from the crates
//! that find them; keys are in `keys.rs`, questions in `questions.rs`.

mod keys;
mod questions;

use std::path::Path;

use super::swapchain::PresentMode;
use super::views::View;
use instgs_vk::render::Show;

pub(crate) use keys::KEYS;
pub(crate) use questions::{
    CLOSE_WINDOW, OPEN_UNSAVED, PATH_UNSAVED, PRESS_ESCAPE, QUIT_UNSAVED, STOP_WORK, boxes_unsaved, changes_unsaved,
    is_running, open_file, question, replace_again,
};

/// Titles of panels.
pub(super) const SCENE: &str = "Scene";
pub(super) const PROPERTIES: &str = "Properties";
pub(super) const VIEW: &str = "View";
pub(super) const STATISTICS: &str = "Statistics";
pub(super) const HISTORY: &str = "History";
pub(super) const CAMERAS: &str = "Cameras";
pub(super) const HELP: &str = "Help";
pub(super) const OPEN: &str = "Open";
pub(super) const SAVE_AS: &str = "Save as, export";
pub(super) const BOXES: &str = "Boxes";

/// Units and axes.
pub(super) const PX: &str = " px";
pub(super) const MS: &str = " ms";
pub(super) const DEGREES: &str = "°";
pub(super) const BYTES: [&str; 5] = ["B", "kB", "MB", "GB", "TB"];
/// Between width and height.
pub(super) const BY: &str = "x";
pub(super) const X: &str = "X";
pub(super) const Y: &str = "Y";
pub(super) const Z: &str = "Z";

/// A time in milliseconds.
pub(super) fn milliseconds(ms: f64) -> String {
    format!("{ms:.3} ms")
}

/// A part of a whole as percent.
pub(super) fn percent(part: f32) -> String {
    format!("{:.0} %", 100.0 * part)
}

/// A number of pixels of which 0 turns something off.
pub(super) fn pixels_or_off(px: f64) -> String {
    if px > 0.0 { format!("{px:.1} px") } else { "off".into() }
}

/// The window's title, for a file's name.
pub(super) fn window_title(file: &str) -> String {
    format!("{file} - instgs-player")
}

/// The tool bar.
pub(super) const STILL: &str = "still";

/// Frames per second, and the part of the pixels that are drawn.
pub(super) fn frame_rate(fps: f64, pixels: f64) -> String {
    // Below ten, a whole number says too little.
    let decimals = usize::from(fps < 9.95);
    let reduced = if pixels < 1.0 { format!(", {:.0} % of the pixels", 100.0 * pixels) } else { String::new() };
    format!("{fps:.decimals$} FPS{reduced}")
}

/// Tool tips of the tool bar, with their keys.
pub(super) const OPEN_TIP: &str = "Open a scene (Ctrl+O)";
pub(super) const SAVE_TIP: &str = "Save (Ctrl+S)";
pub(super) const SAVE_AS_TIP: &str = "Save as, export (Ctrl+Shift+S)";
pub(super) const UNDO_TIP: &str = "Undo (Ctrl+Z)";
pub(super) const REDO_TIP: &str = "Redo (Ctrl+Y)";
pub(super) const SELECT_TIP: &str = "Select only, no handles (N)";
pub(super) const MOVE_TIP: &str = "Move (M)";
pub(super) const ROTATE_TIP: &str = "Rotate (T)";
pub(super) const SCALE_TIP: &str = "Scale (X)";
pub(super) const FRAME_TIP: &str = "Frame the selection (F)";
pub(super) const SPLIT_TIP: &str = "Compare with the scene as it was opened (K)";
pub(super) const BOXES_TIP: &str = "Boxes: mark an object, find the rest (B)";
pub(super) const SCENE_TIP: &str = "Scene: what is in it (F2)";
pub(super) const PROPERTIES_TIP: &str = "Properties of the selection (F3)";
pub(super) const VIEW_TIP: &str = "View (F4)";
pub(super) const CAMERAS_TIP: &str = "Cameras and pictures (F5)";
pub(super) const HISTORY_TIP: &str = "History (F6)";
pub(super) const STATISTICS_TIP: &str = "Statistics (F7)";
pub(super) const HELP_TIP: &str = "Help (F1)";

/// The Scene panel.
pub(super) const SEARCH: &str = "Search";
pub(super) const NO_INSTANCES: &str = "This scene has no objects of its own, only Gaussians. Boxes (B) mark objects, \
     and training with them makes instances.";
pub(super) const NOTHING_FOUND: &str = "Nothing has this name.";
pub(super) const BACKGROUND: &str = "Background";
pub(super) const UNFOLD_TIP: &str = "Show or hide the instances in this list";
pub(super) const EYE_TIP: &str = "Hide or show";
pub(super) const LOCK_TIP: &str = "Lock or unlock: what is locked cannot be selected";
pub(super) const RENAME_TIP: &str = "Rename";
pub(super) const SHOW_ALL: &str = "Show all";
pub(super) const SELECT_ALL: &str = "Select all";

/// A template without a name of its own.
pub(super) fn template(number: u32) -> String {
    format!("template {number}")
}

/// Why a scene in pages cannot be edited or saved.
pub(super) const IN_PAGES: &str = "most of this scene is in its file, since memory is short: it can be looked at, and edited where all of it has room";
/// The file of a scene in pages was replaced by another one.
pub(super) const NO_PAGES: &str = "has no pages any more";

/// The number of Gaussians that belong to no instance.
pub(super) fn background_gaussians(count: &str) -> String {
    format!("{BACKGROUND}: {count} Gaussians")
}

/// The Properties panel.
pub(super) const NOTHING_SELECTED: &str =
    "Click an object in the picture or in the Scene panel to select it; Shift+click adds or removes one.";
pub(super) const HANDLES: &str = "Handles";
pub(super) const MOVE: &str = "Move";
pub(super) const ROTATE: &str = "Rotate";
pub(super) const SCALE: &str = "Scale";
pub(super) const NONE: &str = "None";
pub(super) const DUPLICATE: &str = "Duplicate";
pub(super) const DELETE: &str = "Delete";
pub(super) const HIDE: &str = "Hide";
pub(super) const SAME_TEMPLATE: &str = "Select same template";
pub(super) const SAME_GROUP: &str = "Select same group";
pub(super) const COLOUR: &str = "Colour";
pub(super) const TEMPLATE: &str = "Template and own Gaussians";
pub(super) const ARRANGE: &str = "Arrange";
pub(super) const SCATTER: &str = "Scatter copies";
pub(super) const EDIT_TEMPLATE: &str = "Edit the template";
pub(super) const REPLACE_BY: &str = "Replace by";
pub(super) const MAKE_UNIQUE: &str = "Make unique";
pub(super) const MAKE_UNIQUE_TIP: &str =
    "The selected objects get templates of their own: changes of the old template no longer reach them";
pub(super) const RESET: &str = "Reset to the template";
pub(super) const RESET_TIP: &str = "Removes offsets, own Gaussians and colours of the selected objects";
pub(super) const GIVE: &str = "Take from background";
pub(super) const GIVE_TIP: &str =
    "Gaussians of the background inside the object's box become its own, and move with it";
pub(super) const TAKE: &str = "Return to background";
pub(super) const TAKE_TIP: &str = "The object's own Gaussians become background where they are";
pub(super) const RELIGHT: &str = "Light of neighbours";
pub(super) const RELIGHT_TIP: &str = "Takes the colours of the nearest objects of the same template";
pub(super) const ALIGN: &str = "Align centres";
pub(super) const DISTRIBUTE: &str = "Distribute evenly";
pub(super) const MIRROR: &str = "Mirror";
pub(super) const UP: &str = "up";
pub(super) const ON_GROUND: &str = "Stand on one ground";
pub(super) const POSITION: &str = "Position";
pub(super) const ROTATION: &str = "Rotation";
pub(super) const MOVE_BY: &str = "Move by";
pub(super) const ROTATE_BY: &str = "Rotate by";
pub(super) const SCALE_BY: &str = "Scale by";
pub(super) const SHIFT: &str = "Shift";
pub(super) const CROP: &str = "Crop with a box";
pub(super) const FROM: &str = "from";
pub(super) const TO: &str = "to";
pub(super) const KEEP_INSIDE: &str = "Keep inside";
pub(super) const REMOVE_INSIDE: &str = "Remove inside";
pub(super) const ERASE: &str = "Erase by clicking and dragging";
pub(super) const RADIUS: &str = "Radius";

/// Several selected instances.
pub(super) fn instances(count: usize) -> String {
    format!("{count} instances")
}

/// An instance by its number, and the id of the object in the masks.
pub(super) fn instance(k: usize, id: Option<u32>) -> String {
    let id = id.map_or_else(String::new, |id| format!(", id {id}"));
    format!("instance {k}{id}")
}

/// What an instance is made of: Gaussians of its template and its own, and the name of its group.
pub(super) fn template_and_group(template: u32, count: u32, own: u32, group: Option<&str>) -> String {
    let own = if own > 0 { format!(", {own} of its own") } else { String::new() };
    format!("template {template} ({count} Gaussians{own}), group {}", group.unwrap_or("none"))
}

/// A change of colour for a whole template.
pub(super) fn all_of_template(template: u32) -> String {
    format!("all instances of template {template}")
}

/// What edits of a template do.
pub(super) fn changes_all_of(template: u32) -> String {
    format!("Changes all instances of template {template}. Coordinates are those of the template's frame.")
}

/// There is nothing of a template to edit.
pub(super) fn empty_template(template: u32) -> String {
    format!("template {template} has no Gaussians")
}

/// Scattering.
pub(super) const COPIES: &str = "Copies";
pub(super) const WIDTH_DEPTH: &str = "Width, depth";
pub(super) const LEAST_DISTANCE: &str = "Least distance";
pub(super) const RANDOM_ROTATION: &str = "Random rotation";
pub(super) const SEED: &str = "Seed";
pub(super) const AROUND: &str = "Area";
pub(super) const PATH: &str = "Path";
pub(super) const POLYGON: &str = "Polygon";
pub(super) const CLICK_POINTS: &str = "Click points in the picture; Backspace removes the last one.";
pub(super) const DRAW_POINTS: &str = "Draw points";
pub(super) const PREVIEW: &str = "Preview";
pub(super) const APPLY: &str = "Apply";
pub(super) const CANCEL: &str = "Cancel";

/// The View panel.
pub(super) const FIELD_OF_VIEW: &str = "Field of view";
pub(super) const BACKGROUND_COLOUR: &str = "Background colour";
pub(super) const GRID: &str = "Grid";
pub(super) const AXES: &str = "Axes";
pub(super) const DETAIL: &str = "Level-of-detail error";
pub(super) const OCCLUSION: &str = "Leave out what is hidden";
pub(super) const WHY_OCCLUSION: &str =
    "The same picture, faster where the front of the scene hides much, slower elsewhere";
pub(super) const LOWER_RESOLUTION: &str = "Lower resolution in motion above";
pub(super) const PRESENTATION: &str = "Vertical sync";
pub(super) const SHOWN: &str = "shown";
pub(super) const TOP_OF_SCALE: &str = "top of the scale";
pub(super) const LEAST_ALPHA: &str = "least alpha";
pub(super) const THEME: &str = "Colours of panels";
pub(super) const DARK: &str = "dark";
pub(super) const LIGHT: &str = "light";
pub(super) const SIZE_OF_TEXT: &str = "Size of panels";
pub(super) const LOOK_ALONG: &str = "Look from";

/// How frames wait for the screen.
pub(super) const fn present_mode(mode: PresentMode) -> &'static str {
    match mode {
        PresentMode::Fifo => "on",
        PresentMode::Mailbox => "fast",
        PresentMode::Immediate => "off",
    }
}

/// The name of a view.
pub(super) const fn view_name(view: View) -> &'static str {
    match view {
        View::Color => "colour",
        View::Alpha => "coverage",
        View::Depth => "depth",
        View::Instances => "instances",
        View::Templates => "templates",
        View::TileLoad => "tile load",
        View::Offsets => "offsets",
        View::Points => "points",
        View::Ellipses => "ellipses",
    }
}

/// Explains the colours of a view; `slabs` is the number of depth slabs of the frame.
pub(super) fn legend(show: Show, slabs: u32) -> String {
    match show {
        Show::Color => "rendered colours".into(),
        Show::Alpha => "white: opaque; black: nothing".into(),
        Show::Depth([white, black]) => format!("white at depth {white:.3}, black from {black:.3}"),
        Show::Instances => "one colour each; black: background".into(),
        Show::Templates => "one colour each; grey: background".into(),
        Show::TileLoad(top) if slabs > 1 => {
            format!("0 to {top:.0} intersections per tile, in the last of {slabs} depth slabs")
        }
        Show::TileLoad(top) => format!("0 to {top:.0} intersections per tile"),
        Show::Offsets(top) => format!("position offset of 0 to {:.1} % of the template's radius", 100.0 * top),
        Show::Points => "a disc of 1.5 pixels at each centre".into(),
        Show::Ellipses(alpha) => format!("one standard deviation, where alpha is at least {alpha:.2}"),
    }
}

/// The Statistics panel.
pub(super) const INSTANCES: &str = "Instances";
pub(super) const TEMPLATES: &str = "Templates";
pub(super) const STORED: &str = "Gaussians in the file";
pub(super) const EXPANDED: &str = "with every instance";
pub(super) const DRAWN: &str = "drawn in this view";
pub(super) const IN_TILES: &str = "parts of them in tiles";
pub(super) const DEVICE_MEMORY: &str = "Memory of the device";
pub(super) const SCENE_MEMORY: &str = "of it, the scene";
pub(super) const SCENE_ON_HOST: &str = "Scene in memory of the host";
pub(super) const OFFSETS: &str = "Offsets of instances";
pub(super) const OWN: &str = "Own Gaussians";
pub(super) const DEVICE_TIMES: &str = "Times of the device";
pub(super) const ALL_PASSES: &str = "all scene passes";
pub(super) const TO_SCREEN: &str = "to the screen";
pub(super) const INTERFACE: &str = "panels";

/// The window's size in pixels, and the device's name.
pub(super) fn size_and_device([width, height]: [u32; 2], device: &str) -> String {
    format!("{width} x {height}, {device}")
}

/// Median and slow frame times in milliseconds.
pub(super) fn frame_times(median: f64, slow: f64) -> String {
    format!("{:.1} FPS: {median:.1} ms a frame, the slowest 1 % {slow:.1} ms", 1e3 / median)
}

/// The Cameras panel.
pub(super) const KEEP_CAMERA: &str = "Keep this camera (C)";
pub(super) const FIRST_VIEW: &str = "First view (R)";
pub(super) const NO_CAMERAS: &str = "No cameras are kept yet.";
pub(super) const PICTURE: &str = "Picture";
pub(super) const SAVE_PICTURE: &str = "Save picture";
pub(super) const TURNTABLE: &str = "Turntable";
pub(super) const ALONG_CAMERAS: &str = "Along kept cameras";
pub(super) const FRAMES: &str = "Frames";
pub(super) const REMOVE: &str = "Remove";

/// The Open and Save panels.
pub(super) const FILE: &str = "File";
pub(super) const BROWSE: &str = "Browse";
pub(super) const RECENT: &str = "Recent files";
pub(super) const FORMATS: &str = ".instgs saves; .glb, .usda, .usdc, .html, .ply, .spz and .sog export.";
pub(super) const OPENS: &str = ".instgs, .ply, .spz, .sog, .splat or .glb; files can be dropped on the window, too.";
pub(super) const NO_DIALOG: &str = "There is no file dialog here, or nothing was chosen: type the path of the file.";
pub(super) const SAVE: &str = "Save";

/// Work beside the picture.
pub(super) const CANCELLED: &str = "cancelled";
pub(super) const CANNOT_WRITE: &str = "cannot write";
pub(super) const WRITER_BROKE: &str = "the thread that writes the file has failed";
pub(super) const READER_BROKE: &str = "the thread that reads the file has failed";

fn name_of(path: &Path) -> std::borrow::Cow<'_, str> {
    path.file_name().unwrap_or_default().to_string_lossy()
}

pub(super) fn saving(to: &Path) -> String {
    format!("Saving {}", name_of(to))
}

pub(super) fn exporting(to: &Path) -> String {
    format!("Exporting {}", name_of(to))
}

pub(super) fn making(to: &Path) -> String {
    format!("Making {}", name_of(to))
}

pub(super) fn frames_of(count: usize, [width, height]: [u32; 2]) -> String {
    format!("{count} frames of {width} x {height}")
}

pub(super) fn saved(to: &Path) -> String {
    format!("saved to {}", to.display())
}

pub(super) fn exported(to: &Path) -> String {
    format!("exported to {}", to.display())
}

/// What was done, with the first note about it and the number of further ones.
pub(super) fn with_notes(done: String, notes: &[String]) -> String {
    if notes.is_empty() { done } else { format!("{done}; {}", first_note(notes)) }
}

/// The first note, and the number of further ones.
pub(super) fn first_note(notes: &[String]) -> String {
    match notes {
        [] => String::new(),
        [note] => note.clone(),
        [note, rest @ ..] => format!("{note} (and {} more)", rest.len()),
    }
}

/// A page does not begin at a training camera.
pub(super) fn page_without_cameras(error: &dyn std::fmt::Display) -> String {
    format!("{error}: the page begins with the whole scene")
}

pub(super) fn no_ffmpeg(count: usize, folder: &Path) -> String {
    format!("{count} frames in {}; no video: ffmpeg is not installed", folder.display())
}

pub(super) fn still_running(work: &str) -> String {
    format!("{}: wait, or cancel it", is_running(work))
}

pub(super) fn was_cancelled(work: &str) -> String {
    format!("{work} was cancelled")
}

pub(super) fn nothing_to_save(path: &Path) -> String {
    format!("{} could not be opened, so there is nothing to save", path.display())
}

pub(super) fn opening(path: &Path) -> String {
    format!("Opening {}", name_of(path))
}

/// A file is read, but was not opened since that would lose what was done meanwhile.
pub(super) fn changed_meanwhile(path: &Path) -> String {
    format!("{} was not opened: the scene, boxes or the camera path were changed while it was read", path.display())
}

/// The two sides of a comparison.
pub(super) const AS_OPENED: &str = "as opened";
pub(super) const OLDEST_STATE: &str = "before the oldest change that can be undone";
pub(super) const NOW: &str = "now";
pub(super) const NO_SPLIT: &str = "the comparison is off";

/// Cameras.
pub(super) const RECORDING: &str = "recording the camera path: P stops";
pub(super) const NO_CAMERAS_TO_STEP: &str =
    "there are no cameras to step through: start with --data DIR, or keep one with C";

pub(super) fn path_written(cameras: usize, per_second: f64, path: &Path) -> String {
    format!("{cameras} cameras, {per_second} per second: instgs-vk render --camera {}", path.display())
}

pub(super) fn camera_of(number: usize, count: usize, name: &str) -> String {
    format!("camera {number} of {count}: {name}")
}

pub(super) fn camera_saved(number: usize, path: &Path) -> String {
    format!("camera {number} saved to {}", path.display())
}

/// A scene was saved where cameras were kept before.
pub(super) fn cameras_are_of(path: &Path) -> String {
    format!("the kept cameras are now those of {}", path.display())
}

pub(super) fn not_overwritten(error: &dyn std::fmt::Display) -> String {
    format!("{error}; the file is not overwritten")
}

/// What the device cannot do, and what happens instead.
pub(super) const NO_LEVELS: &str = "levels of detail are off";
pub(super) const BACK_TO_COLOURS: &str = "the view is back to colours";
pub(super) const SELECTION_CLEARED: &str = "the selection was cleared";

pub(super) fn device_reopened(reason: &dyn std::fmt::Display) -> String {
    format!("{reason}; drawing continues on a reopened device")
}

pub(super) fn no_such_mode(wanted: PresentMode, instead: PresentMode) -> String {
    let [wanted, instead] = [wanted, instead].map(present_mode);
    format!("this window cannot have vertical sync {wanted}: it is {instead}")
}

/// Keys that have nothing to do.
pub(super) const NOTHING_TO_HIDE: &str = "there is nothing to hide or show";
pub(super) const NOTHING_TO_UNLOCK: &str = "there is nothing to unlock";
pub(super) const NOTHING_TO_UNDO_OR_REDO: &str = "there is nothing to undo or redo";
pub(super) const NOTHING_TO_UNDO: &str = "there is nothing to undo";
pub(super) const NOTHING_TO_REDO: &str = "there is nothing to redo";

/// Boxes around objects.
pub(super) const CLOSE: &str = "Close";
pub(super) const CATEGORY: &str = "Category";
pub(super) const CATEGORY_HINT: &str = "car, chair ...";
pub(super) const CENTRE: &str = "Centre";
pub(super) const SIZE: &str = "Size";
pub(super) const DOTS_ONLY: &str = "Dots only";
pub(super) const FIND_REST: &str = "Find the rest (F)";
pub(super) const OTHER_SIZES: &str = "Other sizes too (O)";
pub(super) const OTHER_SIZES_TIP: &str = "half to twice the size; searches take longer";
pub(super) const REMOVE_BOX_TIP: &str = "remove this box";
pub(super) const SAVE_BOXES_TIP: &str = "for instgs-vk masks --boxes and train --boxes";
pub(super) const SEARCHING: &str = "Searching for similar objects; Esc stops the search.";
pub(super) const SEARCHING_SIZES: &str = "Searching for similar objects, in other sizes too; Esc stops the search.";
pub(super) const HINT_NO_BOX: &str = "Click an object to draw a box around it.  (B closes this tool)";
pub(super) const HINT_BOXES: &str = "Click an object or a box; Shift+click removes a box; Ctrl+S saves.";
pub(super) const HINT_DRAWN: &str =
    "Drag the dots until the box fits; M moves it, T rotates it. Then F finds all similar objects.";
pub(super) const HINT_FOUND: &str = "Shift+click or Delete removes a wrong box; Ctrl+S saves; F searches again.";
pub(super) const NO_BOX_HERE: &str = "there is no box here to remove";
pub(super) const UNCLEAR_OBJECT: &str =
    "the object cannot be separated from its surroundings: drag the dots until the box fits";
pub(super) const IS_GROUND: &str = "this is the ground: click an object that stands on it";
pub(super) const NO_BOXES: &str = "there are no boxes to save";
pub(super) const IS_SEARCHING: &str = "a search is running: Esc stops it";
pub(super) const CLICK_FIRST: &str = "click an object first: F finds objects like it";
pub(super) const FINDS_OTHER_SIZES: &str = "F also finds objects of half to twice the size";
pub(super) const FINDS_SAME_SIZE: &str = "F finds objects of the same size";
pub(super) const SEARCH_STOPPED: &str = "the search was stopped";
pub(super) const SEARCH_BOX_GONE: &str = "the search's box was removed meanwhile";
pub(super) const SEARCH_BROKE: &str = "the search failed: this is a bug in the player";

pub(super) fn box_of(id: u32) -> String {
    format!("box {id}")
}

pub(super) fn box_counts(drawn: usize, found: usize) -> String {
    format!("{drawn} drawn, {found} found")
}

/// A row of the list: the box's id and category, and the box that it was found by.
pub(super) fn box_row(id: u32, category: Option<&str>, like: Option<u32>) -> String {
    let from = like.map_or_else(String::new, |like| format!(", like {like}"));
    format!("{id}: {}{from}", category.unwrap_or("no category"))
}

pub(super) fn is_an_instance(k: usize) -> String {
    format!("this is instance {k} already: boxes are for objects that are not instances yet")
}

pub(super) fn boxes_saved(count: usize, path: &Path) -> String {
    let boxes = if count == 1 { "1 box".into() } else { format!("{count} boxes") };
    format!("{boxes} saved to {}", path.display())
}

pub(super) fn none_found(like: u32, seconds: f64) -> String {
    format!("no other object is like the one in box {like} ({seconds:.1} s)")
}

pub(super) fn found(count: usize, seconds: f64) -> String {
    format!("{count} found in {seconds:.1} s; Shift+click removes a wrong box; Ctrl+S saves")
}

/// The History panel.
pub(super) const UNDO: &str = "Undo";
pub(super) const REDO: &str = "Redo";
pub(super) const NO_CHANGES: &str = "Nothing was changed yet.";

/// What an edit is called in the list of changes, by its name on the command line.
pub(super) fn edit_name(name: &str) -> &str {
    match name {
        "duplicate" => "Duplicate",
        "move" => "Move",
        "rotate" => "Rotate",
        "scale" => "Scale",
        "delete" => "Delete",
        "recolour" => "Colour",
        "swap" => "Replace",
        "scatter" => "Scatter",
        "crop" => "Crop template",
        "erase" => "Erase in template",
        "align" => "Align",
        "distribute" => "Distribute",
        "mirror" => "Mirror",
        "unique" => "Make unique",
        "reset" => "Reset to template",
        "give" => "Take from background",
        "take" => "Return to background",
        "relight" => "Light of neighbours",
        "rename" => "Rename",
        "hide" => "Hide",
        "show" => "Show",
        "lock" => "Lock",
        "unlock" => "Unlock",
        other => other,
    }
}

#[cfg(test)]
mod tests;
