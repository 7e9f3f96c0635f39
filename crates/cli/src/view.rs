//! `instgs-vk view`: opens a scene in the player.

use std::ffi::OsString;
use std::path::PathBuf;
use std::process::ExitCode;

use clap::Args;

use super::programs;
use instgs_console::CliError;
use instgs_console::device::DeviceArgs;

const PROGRAM: &str = "instgs-player";

/// Opens a scene in the player, the program instgs-player.
///
/// What follows the scene goes to the player as it is; `instgs-player --help` lists its flags and keys. The player is looked
/// for beside this program, then in the folders of PATH.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk view runs/park/scene.instgs\n  \
    instgs-vk view room.instgs --data room --show templates\n  \
    instgs-vk view room.instgs --headless --frames 1 --screenshot room.png")]
pub(super) struct ViewArgs {
    /// Scene to open: .instgs, .ply, .spz, .sog, .splat or .glb
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// Flags of the player
    #[arg(value_name = "PLAYER_FLAGS", trailing_var_arg = true, allow_hyphen_values = true)]
    flags: Vec<OsString>,
}

pub(super) fn run(args: &ViewArgs, device_args: &DeviceArgs) -> Result<ExitCode, CliError> {
    let program = programs::beside(PROGRAM)?.or_else(|| programs::on_path(PROGRAM)).ok_or_else(|| {
        CliError::msg(format!(
            "{PROGRAM} is neither beside this program nor in a folder of PATH: cargo build --release -p {PROGRAM} makes it"
        ))
    })?;
    // The scene comes last, behind "--": its name may begin with "-".
    let mut all = args.flags.clone();
    if let Some(device) = device_args.as_given() {
        all.extend(["--device", device].map(OsString::from));
    }
    all.extend(["--".into(), args.scene.clone().into_os_string()]);
    programs::become_program(&program, &all)
}
