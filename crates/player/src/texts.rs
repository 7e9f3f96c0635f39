//! The texts of the window's panels and tool bar, in one place so that they can be translated.

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

/// Scattering.
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
pub(super) const LOWER_RESOLUTION: &str = "Lower resolution in motion above";
pub(super) const PRESENTATION: &str = "Presentation";
pub(super) const THEME: &str = "Colours of panels";
pub(super) const DARK: &str = "dark";
pub(super) const LIGHT: &str = "light";
pub(super) const SIZE_OF_TEXT: &str = "Size of panels";
pub(super) const LOOK_ALONG: &str = "Look from";

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
pub(super) const FORMATS: &str = ".instgs saves; .glb, .usda, .html, .ply, .spz and .sog export.";
pub(super) const OPENS: &str = ".instgs, .ply, .spz, .sog, .splat or .glb; files can be dropped on the window, too.";
pub(super) const NO_DIALOG: &str = "There is no file dialog here, or nothing was chosen: type the path of the file.";
pub(super) const SAVE: &str = "Save";

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

/// A section of the Help panel: its heading, and what each key or movement of the mouse does.
pub(super) type KeySection = (&'static str, &'static [(&'static str, &'static str)]);

/// Keys and mouse by purpose, for the Help panel: two columns of sections.
pub(super) const KEYS: [[KeySection; 3]; 2] = [
    [
        (
            "Camera",
            &[
                ("left drag", "orbit"),
                ("right drag", "look around"),
                ("middle or Shift+drag", "pan"),
                ("wheel", "zoom at the pointer"),
                ("double click", "orbit around that point"),
                ("W A S D, E Q", "fly; up, down; Shift: faster"),
                ("[  ]", "fly slower, faster"),
                ("R, F", "first view; frame the selection"),
                ("Page Up, Page Down", "cameras of the data set"),
                ("C, V", "keep this camera; next kept camera"),
                ("P", "record a camera path; P stops"),
            ],
        ),
        (
            "Boxes around objects",
            &[
                ("B, click", "mark an object with a box"),
                ("F, O", "find all like it; in other sizes too"),
                ("Shift+click", "remove a box"),
            ],
        ),
        ("Size of panels", &[("Ctrl + and -", "larger, smaller; Ctrl 0: as it was")]),
    ],
    [
        (
            "Objects",
            &[
                ("click, Shift+click", "select; add or remove one"),
                ("Ctrl+A, Ctrl+I, G", "all; the others; same template"),
                ("M  T  X  N", "move, rotate, scale, no handles"),
                ("arrows, Home, End", "move; Shift: a tenth as far"),
                (",  .    +  -", "rotate; larger, smaller"),
                ("Ctrl+D, Delete", "duplicate; delete"),
                ("Ctrl+H, Ctrl+Shift+H", "hide; show all"),
                ("L, Ctrl+L", "lock; unlock all"),
                ("Ctrl+Z, Ctrl+Y", "undo; redo"),
                ("Esc", "cancel, clear the selection, quit"),
            ],
        ),
        (
            "Files and panels",
            &[
                ("Ctrl+O, Ctrl+S", "open; save"),
                ("Ctrl+Shift+S", "save as, export"),
                ("F1 to F7", "help and the other panels"),
                ("H, F11, F12", "hide all panels; full screen; picture"),
                ("Tab, Space, Enter", "step through panels; press"),
            ],
        ),
        ("Show", &[("1 to 9", "colour, coverage, depth, instances, ...")]),
    ],
];
