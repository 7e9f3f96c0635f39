//! Keys and movements of the mouse, for the Help panel.

/// A section of the Help panel: its heading, and what each key or movement of the mouse does.
pub(crate) type KeySection = (&'static str, &'static [(&'static str, &'static str)]);

/// Keys and mouse by purpose, for the Help panel: two columns of sections.
pub(crate) const KEYS: [[KeySection; 3]; 2] = [
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
                ("K", "compare: as opened, and now"),
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
