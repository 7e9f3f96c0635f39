//! Panels, keys and files of the player in windows of usual sizes, on screens of usual and of twice the resolution.

use std::path::Path;

use glam::DVec3;
use instgs_io::{load_scene, save_scene};
use instgs_player::navigation::Navigator;
use instgs_vk::scene::trajectory::Orbit;

use crate::common::chairs::chairs;
use crate::common::program::skips_gpu;
use crate::scripts::{VirtualDisplay, player};

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
        play(&display, &file, size, per_point, &script);
        let pixels = |name: &str| image::open(folder.path().join(name)).unwrap().to_rgb8().into_raw();
        let name = format!("{size:?} at {per_point}");
        assert!(pixels("locked.png") == pixels("start.png"), "{name}: what is locked is neither selected nor moved");
        assert!(pixels("edited.png") != pixels("start.png"), "{name}");
        assert!(pixels("undone.png") == pixels("start.png"), "{name}");
        assert!(load_scene(&file).unwrap().scene == load_scene_of(&before), "{name}");
    }
}

/// The scene as a file has it.
fn load_scene_of(scene: &instgs_vk::scene::InstancedScene) -> instgs_vk::scene::InstancedScene {
    let folder = tempfile::tempdir().unwrap();
    let file = folder.path().join("scene.instgs");
    save_scene(&file, scene).unwrap();
    load_scene(&file).unwrap().scene
}

fn play(display: &VirtualDisplay, file: &Path, [width, height]: [u32; 2], per_point: u32, script: &str) {
    let path = file.with_file_name("script.txt");
    std::fs::write(&path, script).unwrap();
    let mut player = player();
    player.env("WINIT_X11_SCALE_FACTOR", per_point.to_string()).env("DISPLAY", &display.1).arg(file);
    player.arg("--size").arg(format!("{width}x{height}")).arg("--script").arg(&path);
    let output = player.timeout(std::time::Duration::from_secs(300)).output().unwrap();
    assert!(output.status.success(), "{}", String::from_utf8_lossy(&output.stderr));
}
