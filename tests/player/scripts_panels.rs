//! Panels, keys and files of the player in windows of usual sizes, on screens of usual and of twice the resolution.

use std::path::Path;

use glam::DVec3;
use instgs_io::{load_scene, save_scene};
use instgs_player::navigation::Navigator;
use instgs_vk::scene::edit::instance_centres;
use instgs_vk::scene::trajectory::Orbit;

use crate::common::chairs::chairs;
use crate::common::program::{error_of, skips_gpu};
use crate::scripts::{VirtualDisplay, open_display, player};

/// Select, lock, hide, move, duplicate, open and close every panel, undo all, save, reopen: the same scene, at every size.
#[test]
fn everything_is_undone_and_saved_at_every_size() {
    let Some(display) = (if skips_gpu() { None } else { VirtualDisplay::open_of("1920x1080x24") }) else { return };
    let before = chairs();
    for (size, per_point) in [([1280, 720], 1), ([1280, 720], 2), ([1920, 1080], 1), ([1920, 1080], 2)] {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("scene.instgs");
        save_scene(&file, &before).unwrap();
        let camera = Navigator::around(&Orbit::around(&before, None)).camera(size);
        let chair = |k: usize| {
            let point = DVec3::from_array(before.templates.means[2].map(f64::from));
            camera.pixel_of(before.instances[k].world_from_template.transform_point(point)).unwrap()
        };
        let [x, y] = chair(1);
        let panels: String = (1..=7).map(|k| format!("key F{k}\n frames 1\n")).collect();
        let script = format!(
            "key KeyH\n shot start.png\n click {x} {y}\n key KeyL\n click {x} {y}\n key ArrowRight\n shot locked.png\n \
             key ctrl+KeyL\n click {x} {y}\n key ArrowRight\n key ctrl+KeyD\n key ctrl+KeyH\n shot hidden.png\n \
             key ctrl+shift+KeyH\n key KeyH\n {panels} key ctrl+KeyA\n {panels} key ctrl+KeyO\n frames 1\n key Escape\n \
             key ctrl+shift+KeyS\n frames 1\n key Escape\n key Escape\n \
             key ctrl+KeyS\n frames 2\n shot edited.png\n key ctrl+KeyZ\n key ctrl+KeyZ\n key ctrl+KeyZ\n key ctrl+KeyZ\n \
             key ctrl+KeyZ\n key ctrl+KeyZ\n key ctrl+KeyZ\n key Escape\n frames 1\n shot undone.png\n key ctrl+KeyS\n quit\n"
        );
        play(&display, &file, (size, per_point), &script);
        let pixels = |name: &str| image::open(folder.path().join(name)).unwrap().to_rgb8().into_raw();
        let name = format!("{size:?} at {per_point}");
        assert!(pixels("locked.png") == pixels("start.png"), "{name}: what is locked is neither selected nor moved");
        assert!(pixels("edited.png") != pixels("start.png"), "{name}");
        assert!(pixels("undone.png") == pixels("start.png"), "{name}");
        assert!(load_scene(&file).unwrap().scene == load_scene_of(&before), "{name}");
    }
}

/// What a person does in the panels, from selecting in the list to opening what was saved. Each step is played in the panels' own
/// code, and its picture can be looked at: INSTGS_PANEL_PICTURES=DIR keeps them.
fn script_in_panels(again: &Path, edited: &Path) -> String {
    let search = format!("{} Search", egui_phosphor::regular::MAGNIFYING_GLASS);
    // On a small window the panel of the selection is scrolled; the pointer is on it.
    let down = "wheel -50\n frames 3";
    let section = |title: &str| format!("over Edit the template\n {down}\n tap {title}\n {down}");
    let save_as = |path: &Path| format!("key ctrl+shift+KeyS\n frames 2\n type {}\n frames 1", path.display());
    let all = [
        "key F2\n tap chair (3) -1\n tap chair 7\n screen 01_select.png".into(),
        "tap chair (3) +3\n type stool\n frames 1\n screen 02_rename.png\n enter\n tap stool 11 +1\n screen 03_hide.png".into(),
        "tap stool 3 +2\n screen 04_lock.png".into(),
        format!("tap {search}\n type 7\n frames 1\n screen 05_search.png\n type\n key F2"),
        "tap Position +1\n type 0.75\n enter\n screen 06_move.png\n tap Duplicate\n screen 07_duplicate.png".into(),
        format!("{down}\n tap Scatter copies\n {down}\n tap Preview\n frames 1\n screen 08_preview.png"),
        "tap Apply\n screen 09_scatter.png\n tap Scatter copies\n key F2\n tap stool 7\n key F2".into(),
        section("Template and own Gaussians"),
        "tap Make unique\n screen 10_unique.png\n tap Template and own Gaussians".into(),
        section("Edit the template"),
        format!("tap Crop with a box\n {down}\n tap X to -1\n type 0.05\n enter\n screen 11_crop.png\n tap Apply"),
        "key KeyK\n frames 2\n screen 12_compare.png\n key KeyK".into(),
        format!("{}\n screen 13_save_as.png\n enter\n frames 2", save_as(edited)),
        "key F6\n frames 1\n screen 14_history.png".into(),
        "tap Undo\n".repeat(8),
        "frames 1\n screen 15_undone.png\n key F6".into(),
        format!("{}\n enter\n frames 2\n key ctrl+KeyO\n frames 2\n screen 16_open.png", save_as(again)),
        format!("type {}\n frames 1\n enter\n opened\n frames 2\n screen 17_reopened.png\n quit\n", again.display()),
    ];
    all.join("\n")
}

/// Select, rename, hide, lock, search, move by number, duplicate, scatter, make unique, edit the template, compare, save as, undo
/// all, save as, open: in the panels, where there is least room. What was saved before undoing has all changes, what was saved
/// after it none.
#[test]
fn everything_is_done_in_the_panels() {
    in_the_panels(&[([1280, 720], 2)]);
}

/// The same where there is more room.
#[ignore = "each size takes half a minute"]
#[test]
fn everything_is_done_in_the_panels_at_other_sizes() {
    in_the_panels(&[([1280, 720], 1), ([1920, 1080], 1), ([1920, 1080], 2)]);
}

/// Plays the script of panels in windows of these sizes (pixels, then pixels per point), and compares the files that it
/// saves.
fn in_the_panels(sizes: &[([u32; 2], u32)]) {
    let Some(display) = (if skips_gpu() { None } else { VirtualDisplay::open_of("1920x1080x24") }) else { return };
    let pictures = std::env::var_os("INSTGS_PANEL_PICTURES").map(std::path::PathBuf::from);
    for &(size, per_point) in sizes {
        let folder = tempfile::tempdir().unwrap();
        let [file, again, edited] =
            ["scene", "again", "edited"].map(|name| folder.path().join(name).with_extension("instgs"));
        save_scene(&file, &chairs()).unwrap();
        play(&display, &file, (size, per_point), &script_in_panels(&again, &edited));
        if let Some(pictures) = &pictures {
            let to = pictures.join(format!("{}x{}_{per_point}", size[0], size[1]));
            std::fs::create_dir_all(&to).unwrap();
            for entry in folder.path().read_dir().unwrap().map(Result::unwrap) {
                if entry.path().extension().is_some_and(|ending| ending == "png") {
                    std::fs::copy(entry.path(), to.join(entry.file_name())).unwrap();
                }
            }
        }
        let name = format!("{size:?} at {per_point}");
        let changed = load_scene(&edited).unwrap().scene;
        assert_eq!(changed.groups[0].name.as_deref(), Some("stool"), "{name}");
        assert_eq!(changed.instances.len(), 3 + 1 + 5, "{name}: one copy, and five scattered");
        let of: Vec<u32> = changed.template_ranges.iter().map(|range| range.count).collect();
        assert_eq!((of.as_slice(), changed.instances[1].template), (&[4, 3][..], 1), "{name}: unique, and cropped");
        // The crop moves the centre of what is left.
        let moved = changed.instances[1].world_from_template.translation().x - 1.0;
        let by = 0.75 - instance_centres(&chairs(), [1])[0].x;
        assert!((moved - by).abs() < 1e-3, "{name}: {moved} {by}");
        assert!(load_scene(&again).unwrap().scene == load_scene_of(&chairs()), "{name}");
        let picture = |name: &str| image::open(folder.path().join(name)).unwrap().to_rgb8();
        assert_eq!(picture("01_select.png").dimensions(), (size[0], size[1]));
        assert!(
            picture("05_search.png") != picture("04_lock.png") && picture("17_reopened.png") != picture("11_crop.png")
        );
    }
}

/// A script that asks for what is not in the panels ends with an error that says what is.
#[test]
fn a_script_that_finds_no_widget_says_so() {
    let Some((display, _folder, file)) = open_display() else { return };
    let script = file.with_file_name("script.txt");
    std::fs::write(&script, "key F2\ntap no such thing\nquit\n").unwrap();
    let error = error_of(player().env("DISPLAY", &display.1).arg(&file).arg("--script").arg(&script));
    assert!(error.contains("no such thing") && error.contains("Select all"), "{error}");
}

/// The scene as a file has it.
fn load_scene_of(scene: &instgs_vk::scene::InstancedScene) -> instgs_vk::scene::InstancedScene {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.instgs");
    save_scene(&file, scene).unwrap();
    load_scene(&file).unwrap().scene
}

fn play(display: &VirtualDisplay, file: &Path, ([width, height], per_point): ([u32; 2], u32), script: &str) {
    let path = file.with_file_name("script.txt");
    std::fs::write(&path, script).unwrap();
    let mut player = player();
    player.env("WINIT_X11_SCALE_FACTOR", per_point.to_string()).env("DISPLAY", &display.1).arg(file);
    player.arg("--size").arg(format!("{width}x{height}")).arg("--script").arg(&path);
    let output = player.timeout(std::time::Duration::from_secs(900)).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
