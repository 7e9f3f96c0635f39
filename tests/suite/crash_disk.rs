//! A disk that is full, and folders that are read-only, removed or renamed: one line, and what was there before is still there.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use instgs_io::save_scene;

use crate::common::chairs::chairs;
use crate::common::crash::{rounds, run_whole, temporaries};
use crate::common::program::{built, repository, skips_gpu};
use crate::disturbed::{error_line, instgs_vk, photos, training};

/// Number of sizes of a full disk that are tried without INSTGS_CRASHES.
const FEW_SIZES: usize = 5;
/// Bytes of the blocks that `ulimit -f` counts.
const BLOCK_BYTES: u64 = 512;

/// The program, with files that end at `limit` blocks, as on a full disk: what is written beyond that is an error.
fn with_limit(limit: u64) -> Command {
    let mut command = Command::new("sh");
    command.args(["-c", "trap '' XFSZ; ulimit -f \"$0\" && exec \"$@\"", &limit.to_string()]).arg(built("instgs-vk"));
    // The driver's own cache is not what is tested.
    command.current_dir(repository()).env("MESA_SHADER_CACHE_DISABLE", "true");
    command
}

/// Less memory than lavapipe survives is one line.
#[test]
fn little_address_space_is_one_line() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let scene = folder.path().join("chairs.instgs");
    save_scene(&scene, &chairs()).unwrap();
    for kilobytes in ["400000", "700000", "900000"] {
        let mut command = Command::new("sh");
        command.args(["-c", "ulimit -v \"$0\" && exec \"$@\"", kilobytes]).arg(built("instgs-vk"));
        command.current_dir(repository()).args(["render", "--orbit", "1", "--size", "32x24", "--device", "llvmpipe"]);
        let output = command.arg("--scene").arg(&scene).arg("--out").arg(folder.path().join("out")).output().unwrap();
        let words = String::from_utf8_lossy(&output.stderr).into_owned();
        assert_eq!(output.status.code(), Some(1), "{kilobytes} kB: {words}");
        assert!(words.starts_with("error: ") && words.lines().count() == 1, "{kilobytes} kB: {words}");
    }
}

/// Sizes from one block to those of all of a file of `bytes`, in blocks.
fn sizes(bytes: u64) -> impl Iterator<Item = u64> {
    let (count, most) = (rounds(FEW_SIZES).clamp(2, 20), (bytes / BLOCK_BYTES).max(2) as f64);
    (0..count).map(move |k| most.powf(k as f64 / count as f64) as u64)
}

#[test]
fn a_full_disk_leaves_the_old_file() {
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    let scene = at.join("scene.instgs");
    save_scene(&scene, &chairs()).unwrap();
    let bytes = fs::read(&scene).unwrap();
    let mut failed = 0;
    for (arguments, file) in [
        (vec!["edit", "scene.instgs", "--recolour", "0", "rgb=0.2,0,0", "--out"], "scene.instgs"),
        (vec!["export", "--scene", "scene.instgs", "--to"], "out.ply"),
        (vec!["export", "--scene", "scene.instgs", "--to"], "out.sog"),
        (vec!["export", "--scene", "scene.instgs", "--to"], "out.html"),
    ] {
        let file = at.join(file);
        let run = |mut command: Command| {
            let given = arguments.iter().map(|a| if *a == "scene.instgs" { scene.clone() } else { PathBuf::from(a) });
            command.args(given).arg(&file).output().unwrap()
        };
        fs::write(&file, if file == scene { &bytes } else { &b"old"[..] }).unwrap();
        let old = fs::read(&file).unwrap();
        assert!(run(with_limit(1 << 20)).status.success());
        let whole = fs::metadata(&file).unwrap().len();
        fs::write(&file, &old).unwrap();
        for limit in sizes(whole) {
            let said = error_line(&run(with_limit(limit)));
            assert!(
                said.contains("cannot write") && said.contains(file.file_name().unwrap().to_str().unwrap()),
                "{said}"
            );
            assert!(fs::read(&file).unwrap() == old, "{} blocks: {} changed", limit, file.display());
            assert!(temporaries(at).is_empty(), "{:?}", temporaries(at));
            failed += 1;
        }
        fs::write(&scene, &bytes).unwrap();
    }
    println!("{failed} writes failed");
}

/// Steps and checkpoints of the trainings here.
const SETTINGS: [&str; 6] = ["--steps", "40", "--max-gaussians", "600", "--set", "checkpoint_every=10"];

#[test]
fn a_training_goes_on_when_the_disk_has_room_again() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    photos(at);
    let start = |command: Command, out: &str| training(command, at, out, &SETTINGS);
    run_whole(&mut start(instgs_vk(), "whole"));
    let of = |out: &str, file: &str| fs::read(at.join(out).join(file)).unwrap();
    let checkpoint = "checkpoints/step_0000040.safetensors";
    for limit in sizes(of("whole", checkpoint).len() as u64) {
        let said = error_line(&start(with_limit(limit), "run").output().unwrap());
        assert!(said.contains(at.join("run").to_str().unwrap()), "{said}");
        assert!(temporaries(&at.join("run")).is_empty(), "{:?}", temporaries(&at.join("run")));
    }
    run_whole(&mut start(instgs_vk(), "run"));
    for file in [checkpoint, "scene.instgs", "point_cloud.ply"] {
        assert!(of("run", file) == of("whole", file), "{file}");
    }
}

/// The program as a user who may read the folder of a test and not write into it: root may write anywhere, and becomes another one.
fn stranger() -> Option<Command> {
    let id = Command::new("id").arg("-u").output().ok()?;
    if id.stdout != b"0\n" {
        return Some(instgs_vk());
    }
    let as_nobody = || {
        let mut command = Command::new("setpriv");
        command.args(["--reuid", "65534", "--regid", "65534", "--clear-groups"]).arg(built("instgs-vk"));
        command.current_dir(repository()).env("HOME", "/nonexistent");
        command
    };
    as_nobody().arg("--version").output().is_ok_and(|output| output.status.success()).then(as_nobody)
}

#[test]
fn a_read_only_folder_is_one_line_and_nothing_changes() {
    use std::os::unix::fs::PermissionsExt;
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    photos(at);
    save_scene(&at.join("scene.instgs"), &chairs()).unwrap();
    let set = |path: &Path, mode: u32| fs::set_permissions(path, fs::Permissions::from_mode(mode)).unwrap();
    set(at, 0o555);
    let scene = fs::read(at.join("scene.instgs")).unwrap();
    let commands: [fn(Command, &Path) -> Command; 3] = [
        |mut command, at| {
            command
                .arg("edit")
                .arg(at.join("scene.instgs"))
                .args(["--delete", "0", "--out"])
                .arg(at.join("scene.instgs"));
            command
        },
        |mut command, at| {
            command.args(["export", "--scene"]).arg(at.join("scene.instgs")).arg("--to").arg(at.join("x.ply"));
            command
        },
        |command, at| training(command, at, "run", &SETTINGS),
    ];
    for with in commands {
        let Some(command) = stranger() else {
            println!("not run: no other user can start the program here");
            break;
        };
        let said = error_line(&with(command, at).output().unwrap());
        assert!(said.to_lowercase().contains("permission denied"), "{said}");
        assert!(fs::read(at.join("scene.instgs")).unwrap() == scene && !at.join("run").exists());
    }
    set(at, 0o755);
}

/// The folder is renamed while it is trained in: the run makes a new one, and the renamed one goes on where it was left.
#[test]
fn a_renamed_folder_can_be_resumed() {
    if skips_gpu() {
        return;
    }
    let folder = tempfile::tempdir().unwrap();
    let at = folder.path();
    photos(at);
    let start = |out: &str| training(instgs_vk(), at, out, &SETTINGS);
    run_whole(&mut start("whole"));
    let mut child =
        start("run").stdout(std::process::Stdio::null()).stderr(std::process::Stdio::piped()).spawn().unwrap();
    let begun = Instant::now();
    while !at.join("run/checkpoints/step_0000010.safetensors").exists() {
        assert!(begun.elapsed() < Duration::from_secs(300) && child.try_wait().unwrap().is_none(), "no checkpoint");
        std::thread::sleep(Duration::from_millis(2));
    }
    fs::rename(at.join("run"), at.join("moved")).unwrap();
    let output = child.wait_with_output().unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    // The folder may have gone while a file in it was being written, which ends the run.
    if output.status.success() {
        assert!(said.contains("was removed"), "{said}");
    } else {
        assert!(said.contains("cannot write"), "{said}");
        run_whole(&mut start("run"));
    }
    run_whole(&mut start("moved"));
    let scene = |out: &str| fs::read(at.join(out).join("scene.instgs")).unwrap();
    assert!(scene("run") == scene("whole") && scene("moved") == scene("whole"));
}
