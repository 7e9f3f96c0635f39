//! The player killed while it saves, and a device that is lost under it.

use std::process::Command;

use instgs_io::load_scene;
use instgs_vk::math::rng::Rng;

use crate::common::chairs::chairs;
use crate::common::crash::{End, kill_within, rounds, run_whole, temporaries};
use crate::common::program::built;
use crate::scripts::{chair_px, open_display};

/// Killed at random moments, the scene's file is what it was, or one of the two that are saved.
#[test]
fn a_killed_player_leaves_a_whole_scene() {
    let Some((display, folder, file)) = open_display() else { return };
    let old = std::fs::read(&file).unwrap();
    let [x, y] = chair_px(&chairs());
    let script = folder.path().join("script.txt");
    let text = format!(
        "key KeyH\n click {x} {y}\n key ctrl+KeyD\n key ctrl+KeyS\n frames 2\n key Delete\n key ctrl+KeyS\n quit\n"
    );
    std::fs::write(&script, text).unwrap();
    let play = || {
        let mut player = Command::new(built("instgs-player"));
        player.env("DISPLAY", &display.1).env_remove("WAYLAND_DISPLAY").env("WINIT_X11_SCALE_FACTOR", "1");
        player.arg(&file).args(["--size", "320x240", "--script"]).arg(&script);
        player
    };
    let instances = || load_scene(&file).unwrap().scene.instances.len();
    let count = instances();
    let mut time = run_whole(&mut play());
    let mut rng = Rng::new(5);
    let (mut killed, mut seen) = (0, std::collections::BTreeSet::new());
    // The first run may have compiled its pipelines: if later ones end before they are killed, they are killed earlier.
    for round in 0..20 {
        if round >= rounds(4) && killed > 0 {
            break;
        }
        std::fs::write(&file, &old).unwrap();
        match kill_within(&mut play(), time, &mut rng) {
            End::Killed => killed += 1,
            _ => time /= 2,
        }
        let found = instances();
        assert!(found == count || found == count + 1, "{found} of {count} instances");
        seen.insert((found, std::fs::read(&file).unwrap() == old));
    }
    println!("the player was killed {killed} times; found {seen:?}");
    std::fs::write(&file, &old).unwrap();
    run_whole(&mut play());
    assert!(temporaries(folder.path()).is_empty(), "{:?}", temporaries(folder.path()));
    assert!(killed > 0);
}

/// The device refuses a submission, or dies in one, at several moments: the player opens it anew, and what was changed is saved.
#[test]
fn a_device_that_is_lost_anywhere_is_opened_anew() {
    let Some((display, folder, file)) = open_display() else { return };
    let old = std::fs::read(&file).unwrap();
    let [x, y] = chair_px(&chairs());
    let script = folder.path().join("script.txt");
    let text = format!("key KeyH\n click {x} {y}\n frames 3\n key ctrl+KeyD\n frames 3\n key ctrl+KeyS\n quit\n");
    std::fs::write(&script, text).unwrap();
    let play = |faults: &str| {
        let mut player = Command::new(built("instgs-player"));
        player.env("DISPLAY", &display.1).env_remove("WAYLAND_DISPLAY").env("WINIT_X11_SCALE_FACTOR", "1");
        player.env("INSTGS_FAULTS", faults).arg(&file).args(["--size", "320x240", "--script"]).arg(&script);
        player.output().unwrap()
    };
    let (mut reopened, mut ended, mut saved) = (0, 0, 0);
    for round in 0..rounds(4) {
        // The first submissions upload the scene.
        let number = [40, 30, 20, 50].get(round).copied().unwrap_or(1 + round);
        for kind in ["lost", "dies"] {
            std::fs::write(&file, &old).unwrap();
            let output = play(&format!("{kind}={number}"));
            let words = String::from_utf8_lossy(&output.stderr).into_owned();
            if output.status.success() {
                // The click that the loss interrupts chooses nothing; then there is nothing to copy and to save.
                let more = load_scene(&file).unwrap().scene.instances.len() - chairs().instances.len();
                assert!(more <= 1, "{kind}={number}: {more} {words}");
                saved += more;
                reopened += 1;
            } else {
                // Before there is a scene to lose, or if the new device fails within seconds, too, it ends in words.
                let lines = words.lines().filter(|line| line.starts_with("error: ")).count();
                assert!(output.status.code() == Some(1) && lines == 1, "{kind}={number}: {words}");
                // The new device may have lived until the copy was saved.
                let is_saved = || load_scene(&file).unwrap().scene.instances.len() == chairs().instances.len() + 1;
                assert!(std::fs::read(&file).unwrap() == old || is_saved(), "{kind}={number}: {words}");
                ended += 1;
            }
        }
    }
    println!("{reopened} times the device was opened anew, {ended} times the player ended with one line");
    assert!(reopened > 2 && saved > 2, "{reopened} {ended} {saved}");
}
