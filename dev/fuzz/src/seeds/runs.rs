//! Files of a run folder, and scripts of the player.

use std::path::Path;

use instgs_io::Checkpoint;
use instgs_objects::pipeline::config::RunConfig;
use instgs_train::config::{ConfigError, Layers, to_toml};

use crate::SeedError;

/// A checkpoint with a tensor of each type.
pub fn checkpoint(folder: &Path) -> Result<Vec<u8>, SeedError> {
    let mut out = Checkpoint { step: 12, ..Checkpoint::default() };
    out.metadata.insert("config".into(), "steps = 12\n".into());
    out.put("means", &[2, 3], vec![1.0f32, -2.0, 3.5, 1e-8, f32::MAX, 0.25]);
    out.put("counts", &[3], vec![1u32, 2, u32::MAX]);
    out.put("streams", &[1], vec![u64::MAX]);
    let path = folder.join("seed.safetensors");
    out.write(&path)?;
    Ok(std::fs::read(path)?)
}

/// A log with events of several kinds, the last one cut off.
pub const EVENTS: &str = r#"{"event":"started","step":0,"steps":32,"resumed":false,"method":"3dgs","device":"x","gaussians":9,"views":10,"test_views":2}
{"event":"step","step":10,"loss":0.25,"mean_loss":null,"view_losses":[[3,0.25],[1,0.5]],"l1":0.1,"ssim":0.5,"psnr":20.5,"gaussians":9,"steps_per_second":7.5,"seconds":1.5}
{"event":"densified","step":16,"cloned":2,"split":1,"pruned":0,"gaussians":12}
{"event":"checkpoint","step":16,"path":"run/checkpoints/step_0000016.safetensors"}
{"event":"step","step":20,"loss":null,"l1":0.1,"ssim":0.5,"psnr":null,"gaussians":12,"steps_per_second":7.5,"seconds":2.5}
{"event":"finished","step":32,"seconds":4.5,"interrupted":false,"gaussians":12}
{"event":"step","st"#;

/// Exposures of two photos.
pub const EXPOSURES: &str = r#"[{"view":"a.png","photo_from_scene":[[1.5,0,0,0.1],[0,1,0,0],[0,0,0.75,-0.1]]},
    {"view":"b.png","photo_from_scene":[[1,0,0,0],[0,1,0,0],[0,0,1,0]]}]"#;

/// The configuration of a run with all keys.
pub fn config() -> Result<String, ConfigError> {
    to_toml(&Layers::<RunConfig>::new().finish()?)
}

/// A configuration as one would write it.
pub const SHORT_CONFIG: &str =
    "steps = 500\nmax_gaussians = 20000\n[densify]\nevery = 50\n[joint]\ngrow_fraction = 0.25\n";

/// Assignments of `--set`, one a line.
pub const SETTINGS: &str = "steps=500\ndensify.every = 50\nrates.opacity=0.05\n";

/// A script of the player.
pub const SCRIPT: &str = "# a comment\nsize 640 480\nclick 3 4.5 # there\ndrag middle 0 0 16 8\nwheel -1\nkey ctrl+shift+KeyZ\nhold KeyW 2\n\
    frames 3\nshot a.png\ncounts a.json\nboxes b.json\nfound\nlose\ndrop c.ply\ndouble 5 6\nclose\nquit\n";
