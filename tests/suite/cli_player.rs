//! `instgs-player` as a user runs it: without a window, and in a real one on a virtual display.

use std::io::{BufRead, BufReader};
use std::path::{Path, PathBuf};
use std::process::{Child, Stdio};

use assert_cmd::Command;
use instgs_vk::io::save_scene;
use serde_json::Value;

use crate::common::chairs::chairs;
use crate::common::program::{error_of, program, skips_gpu};

fn player() -> Command {
    let mut player = Command::new(env!("CARGO_BIN_EXE_instgs-player"));
    player.env("INSTGS_VALIDATION", "1").env_remove("DISPLAY").env_remove("WAYLAND_DISPLAY");
    player
}

fn scene(folder: &Path) -> PathBuf {
    let scene = folder.join("scene.instgs");
    save_scene(&scene, &chairs()).unwrap();
    scene
}

fn pixels(path: &Path) -> (u32, u32, Vec<u8>) {
    let picture = image::open(path).unwrap().to_rgb8();
    (picture.width(), picture.height(), picture.into_raw())
}

/// An X server without a screen, killed when dropped.
struct VirtualDisplay(Child, String);

impl VirtualDisplay {
    /// # Panics
    /// Without Xvfb, unless INSTGS_SKIP_WINDOW=1 says that tests with a window are not wanted.
    #[allow(clippy::print_stderr, reason = "a skipped test must be heard")]
    fn open() -> Option<Self> {
        if std::env::var_os("INSTGS_SKIP_WINDOW").is_some_and(|v| v == "1") {
            eprintln!("INSTGS_SKIP_WINDOW=1: A TEST THAT NEEDS A VIRTUAL DISPLAY IS SKIPPED");
            return None;
        }
        let mut server = std::process::Command::new("Xvfb")
            .args(["-displayfd", "1", "-screen", "0", "800x600x24", "-nolisten", "tcp"])
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xvfb starts (package xvfb; tools/setup installs it; INSTGS_SKIP_WINDOW=1 skips this test)");
        let mut number = String::new();
        BufReader::new(server.stdout.take().unwrap()).read_line(&mut number).unwrap();
        Some(Self(server, format!(":{}", number.trim())))
    }
}

impl Drop for VirtualDisplay {
    fn drop(&mut self) {
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

/// The picture without a window is that of `render`; the one from a window is the same, byte for byte.
#[test]
fn pictures_are_those_of_render_with_and_without_a_window() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let (size, frames) = ("160x90", "3");
    let shot = |name: &str| folder.path().join(name);
    let play = |player: &mut Command, shot: &Path| -> Value {
        player.arg(&scene).args(["--frames", frames, "--size", size, "--background", "0.2,0.4,0.6", "--json", "-"]);
        serde_json::from_slice(&player.arg("--screenshot").arg(shot).assert().success().get_output().stdout).unwrap()
    };
    let report = play(player().arg("--headless"), &shot("headless.png"));
    assert_eq!((&report["frames"], &report["window"]), (&3.into(), &false.into()));
    assert_eq!(report["resolution"], serde_json::json!([160, 90]));
    assert!(report["fps"].as_f64().unwrap() > 0.0 && report["gaussians"]["visible"].as_u64().unwrap() > 0);
    assert!(report["passes_ms"]["tile_blend"].as_f64().unwrap() > 0.0 && report["present_ms"].as_f64().unwrap() > 0.0);

    let out = folder.path().join("rendered");
    let mut render = program();
    render.args(["render", "--orbit", frames, "--size", size, "--background", "0.2,0.4,0.6", "--scene"]).arg(&scene);
    render.arg("--out").arg(&out).assert().success();
    let (want, got) = (pixels(&out.join("002.png")), pixels(&shot("headless.png")));
    assert_eq!((want.0, want.1), (got.0, got.1));
    // Host and device round to bytes alike, but for a device that fuses the product with the sum.
    assert!(want.2.iter().zip(&got.2).all(|(a, b)| a.abs_diff(*b) <= 1));
    assert!(want.2.iter().zip(&got.2).filter(|(a, b)| a != b).count() * 1000 <= want.2.len());
    assert!(want.2.chunks_exact(3).any(|rgb| rgb != [51, 102, 153]), "there is something to see");

    let Some(display) = VirtualDisplay::open() else { return };
    let report = play(player().env("DISPLAY", &display.1), &shot("window.png"));
    assert_eq!((&report["frames"], &report["window"]), (&3.into(), &true.into()));
    assert_eq!(pixels(&shot("window.png")), got);
}

/// Without a display, --frames goes on without a window and says so; alone it is an error that says what to do.
#[test]
fn without_a_display_it_says_what_to_do() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = scene(folder.path());
    let text = error_of(player().arg(&scene));
    assert!(text.contains("window") && text.contains("--headless"), "{text}");
    let output =
        player().arg(&scene).args(["--frames", "1", "--size", "33x17"]).assert().success().get_output().clone();
    let warning = String::from_utf8(output.stderr).unwrap();
    assert!(warning.starts_with("warning: ") && warning.contains("without a window"), "{warning}");
    assert!(String::from_utf8(output.stdout).unwrap().contains("1 pictures of 33x17"));
}

#[test]
fn bad_files_and_flags_end_in_one_line() {
    let folder = tempfile::tempdir().unwrap();
    let bad = folder.path().join("bad.instgs");
    std::fs::write(&bad, "no scene").unwrap();
    let text = error_of(player().arg(&bad).args(["--headless", "--frames", "1"]));
    assert!(text.contains("bad.instgs"), "{text}");
    for usage in [&["--headless"][..], &["--json", "-"], &["--frames", "0"], &["--size", "0x1", "--frames", "1"]] {
        player().arg(&bad).args(usage).assert().code(2);
    }
}
