//! Frame times in a window, measured from outside: docs/measurements.md has the figures.

use std::path::Path;
use std::time::Instant;

use glam::DVec3;
use instgs_io::{load_scene, save_scene};
use instgs_player::navigation::Navigator;
use instgs_vk::math::similarity::Similarity;
use instgs_vk::math::statistics::median;
use instgs_vk::scene::edit::instance_centres;
use instgs_vk::scene::trajectory::Orbit;
use instgs_vk::scene::{Instance, InstancedScene};

use crate::common::chairs::chairs;
use crate::scripts::{VirtualDisplay, arrow_tip, open_display, player};

/// Frames of a measurement, and how often it is made.
const FRAMES: usize = 150;
const RUNS: usize = 5;

/// A square of 1,000 chairs, of which the first is the middle one.
fn thousand_chairs() -> InstancedScene {
    let mut scene = chairs();
    let [first, ..] = scene.instances.as_slice() else { panic!("there are chairs") };
    let place = |k: usize| {
        let at = (k + 500) % 1000;
        DVec3::new((at % 32) as f64 - 16.0, 0.0, (at / 32) as f64 - 16.0)
    };
    let instance = |k: usize| {
        let world_from_template =
            Similarity::from_parts(first.world_from_template.rotation(), first.world_from_template.scale(), place(k));
        Instance { world_from_template, ..first.clone() }
    };
    scene.instances = (0..1000).map(instance).collect();
    scene.groups.clear();
    scene
}

/// Seconds that the player takes for a script.
fn seconds(display: &VirtualDisplay, scene: &Path, text: &str) -> f64 {
    let script = scene.with_file_name("script.txt");
    std::fs::write(&script, text).unwrap();
    let mut player = player();
    player.env_remove("INSTGS_VALIDATION").env("DISPLAY", &display.1).arg(scene);
    player.args(["--size", "640x360", "--present", "immediate", "--script"]).arg(&script);
    let start = Instant::now();
    player.timeout(std::time::Duration::from_secs(300)).assert().success();
    start.elapsed().as_secs_f64()
}

/// Dragging one of 1,000 instances takes a frame at most a tenth longer than standing still with it selected.
#[test]
#[ignore = "a measurement of minutes, on a machine that does nothing else"]
fn dragging_one_of_a_thousand() {
    let Some((display, folder, _)) = open_display() else { return };
    let (scene, file) = (thousand_chairs(), folder.path().join("thousand.instgs"));
    save_scene(&file, &scene).unwrap();
    let camera = Navigator::around(&Orbit::around(&scene, None)).camera([640, 360]);
    let centre = instance_centres(&scene, [0])[0];
    let seen = DVec3::from_array(scene.templates.means[3].map(f64::from));
    let [x, y] = camera.pixel_of(scene.instances[0].world_from_template.transform_point(seen)).unwrap();
    let (_, [tip_x, tip_y]) = arrow_tip(centre, &camera);
    let [to_x, to_y] = [(x, tip_x), (y, tip_y)].map(|(from, tip)| 0.9 * (tip - from));
    let begin = format!("key KeyH\nkey F3\nkey KeyM\nclick {x} {y}\nframes 3\npointer {tip_x} {tip_y}\n");
    let drag: String = (1..=FRAMES)
        .map(|k| {
            let part = k as f64 / FRAMES as f64;
            format!("pointer {} {}\n", tip_x + part * to_x, tip_y + part * to_y)
        })
        .collect();
    let of_frames = |middle: &str| -> f64 {
        // What starts and ends the program is measured, too, and taken off.
        let whole = seconds(&display, &file, &format!("{begin}{middle}quit\n"));
        let rest = seconds(&display, &file, &format!("{begin}quit\n"));
        1e3 * (whole - rest) / FRAMES as f64
    };
    seconds(&display, &file, &format!("{begin}press left\n{drag}release left\nkey ctrl+KeyS\nquit\n"));
    let moved = load_scene(&file).unwrap().scene.instances;
    let differ: Vec<usize> = (0..1000).filter(|&k| moved[k] != scene.instances[k]).collect();
    assert_eq!(differ, [0], "the drag moves the instance, and no other");
    let mut ratios = Vec::new();
    for _ in 0..RUNS {
        let still = of_frames(&format!("frames {FRAMES}\n"));
        let dragged = of_frames(&format!("press left\n{drag}release left\nkey ctrl+KeyZ\n"));
        println!("still {still:.1} ms, dragged {dragged:.1} ms: {:.2}x", dragged / still);
        ratios.push(dragged / still);
    }
    assert!(median(&ratios) <= 1.1, "{ratios:?}");
}
