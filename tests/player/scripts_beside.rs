//! What the window shows beside the present scene: a file that is read meanwhile, the scene as it was opened; and touchpads,
//! whose input only scripts can play here.

use std::path::Path;

use crate::common::program::error_of;
use crate::scripts::{open_display, pixels, player};

/// A file is read beside the picture: it moves meanwhile, and the scene appears when the file has been read. What was changed
/// meanwhile is not thrown away.
#[test]
fn a_file_is_opened_beside_the_picture() {
    let Some((display, folder, file)) = open_display() else { return };
    let shot = |name: &str| folder.path().join(name);
    std::fs::copy(&file, shot("other.instgs")).unwrap();
    for (meanwhile, opens) in [("drag right 400 200 460 230", true), ("key ctrl+KeyA\nkey Delete", false)] {
        let script = shot("script.txt");
        let text = format!(
            "frames 2\nshot before.png\nbegin other.instgs\nframes 3\n{meanwhile}\nframes 2\nshot during.png\nopened\nframes 2\n\
             shot after.png\nquit\n"
        );
        std::fs::write(&script, text).unwrap();
        let mut player = player();
        player.env("DISPLAY", &display.1).args(["--size", "640x480", "--script"]).arg(&script).arg(&file);
        player.assert().success();
        let [before, during, after] = ["before.png", "during.png", "after.png"].map(|name| pixels(&shot(name)));
        assert!(during != before, "{meanwhile}: the picture goes on");
        assert_eq!(
            after == before,
            opens,
            "{meanwhile}: the other file has the same scene, and opens with the first view"
        );
        assert_eq!(after == during, !opens, "{meanwhile}");
    }
}

/// A file that cannot be read is said in the window, which stays and takes another one. `over` fails if the words are not there.
#[test]
fn a_window_without_a_scene_says_why_and_takes_another() {
    let Some((display, folder, file)) = open_display() else { return };
    let [bad, script, picture] = ["bad.instgs", "script.txt", "after.png"].map(|name| folder.path().join(name));
    std::fs::write(&bad, "no scene").unwrap();
    let error = error_of(player().arg(&bad).args(["--headless", "--frames", "1"]));
    let words = error.trim().trim_start_matches("error: ");
    let text = format!("frames 2\nover {words}\ndrop {}\nframes 2\nshot after.png\nquit\n", file.display());
    std::fs::write(&script, text).unwrap();
    let play = |of: &Path| {
        let mut player = player();
        player.env("DISPLAY", &display.1).args(["--size", "640x480", "--script"]).arg(&script).arg(of);
        player.assert().success();
        pixels(&picture)
    };
    let dropped = play(&bad);
    std::fs::write(&script, "frames 2\nshot after.png\nquit\n").unwrap();
    assert!(dropped == play(&file), "the scene that was dropped, as if it were the first");
}

/// Two fingers on a touchpad: spreading zooms in, moving orbits.
#[test]
fn fingers_on_a_touchpad_move_the_camera() {
    let Some((display, folder, file)) = open_display() else { return };
    let shot = |name: &str| folder.path().join(name);
    let script = shot("script.txt");
    let text = "key KeyH\nframes 1\nshot a.png\npinch 0.5\nframes 1\nshot near.png\npinch -0.3333333333333333\nframes 1\n\
                shot back.png\npan 40 0\nframes 1\nshot turned.png\npointer 0 0\npress left\npointer 0 0\nrelease left\nkey KeyR\n\
                drag left 0 0 40 0\nframes 1\nshot dragged.png\nquit\n";
    std::fs::write(&script, text).unwrap();
    let mut player = player();
    player.env("DISPLAY", &display.1).args(["--size", "320x180", "--script"]).arg(&script).arg(&file);
    player.assert().success();
    let [first, near, back, turned, dragged] =
        ["a.png", "near.png", "back.png", "turned.png", "dragged.png"].map(|name| pixels(&shot(name)).2);
    let differ = |a: &[u8], b: &[u8]| a.iter().zip(b).filter(|(a, b)| a.abs_diff(**b) > 8).count();
    assert!(differ(&first, &near) > 500, "{}", differ(&first, &near));
    assert!(differ(&first, &back) < 20, "{}", differ(&first, &back));
    assert!(differ(&first, &turned) > 500 && differ(&turned, &dragged) < 20, "{}", differ(&turned, &dragged));
}

/// Left of the line is the scene as it was opened, right of it as it is now; the line can be dragged.
#[test]
fn the_scene_as_opened_is_shown_left_of_a_line() {
    let Some((display, folder, file)) = open_display() else { return };
    let shot = |name: &str| folder.path().join(name);
    let script = shot("script.txt");
    let text = "key KeyH\nframes 2\nscreen opened.png\nkey ctrl+KeyA\nkey Home\nkey Home\nkey Home\nkey Home\nkey Escape\nframes 1\n\
                screen edited.png\nkey KeyK\nframes 2\nscreen split.png\ndrag left 160 90 80 90\nframes 2\nscreen dragged.png\n\
                key KeyK\nframes 1\nscreen off.png\nquit\n";
    std::fs::write(&script, text).unwrap();
    let mut player = player();
    player.env("DISPLAY", &display.1).args(["--size", "320x180", "--script"]).arg(&script).arg(&file);
    player.assert().success();
    let [opened, edited, split, dragged, off] = ["opened", "edited", "split", "dragged", "off"]
        .map(|name| image::open(shot(name).with_extension("png")).unwrap().to_rgb8());
    assert!(opened != edited && off == edited);
    // Names and the line cover a part of the picture.
    let alike = |a: &image::RgbImage, b: &image::RgbImage, columns: std::ops::Range<u32>| {
        columns.flat_map(|x| (80..180).map(move |y| (x, y))).all(|(x, y)| a.get_pixel(x, y) == b.get_pixel(x, y))
    };
    assert!(
        !alike(&opened, &edited, 85..155) && !alike(&opened, &edited, 165..320),
        "both parts show something that has moved"
    );
    assert!(alike(&split, &opened, 0..155) && alike(&split, &edited, 165..320));
    assert!(alike(&dragged, &opened, 0..75) && alike(&dragged, &edited, 85..320));
}
