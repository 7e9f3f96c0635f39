//! The stages between the two phases of `train --method instgs` as commands: `segment`, `register`, `merge`. The folder of
//! segments that leads from one to the next is laid out as a run folder.

pub(super) mod merge;
pub(super) mod register;
pub(super) mod segment;

use std::path::{Path, PathBuf};

use clap::Args;

use instgs_console::CliError;
use instgs_io::RunFolder;
use instgs_objects::pipeline::CloudLabels;
use instgs_objects::pipeline::config::{ConfigBuilder, RunConfig};
use instgs_objects::pipeline::label_gaussians::{read_cloud, require_segments};
use instgs_vk::scene::InstancedScene;

/// Where the earlier stage left its files.
#[derive(Args)]
struct SegmentsArgs {
    /// Folder that segment made, or a run folder of train --method instgs
    #[arg(long, value_name = "DIR")]
    segments: PathBuf,
    /// One value of the configuration, over the folder's own; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// What is in the folder.
struct Segments {
    config: RunConfig,
    cloud: InstancedScene,
    labels: CloudLabels,
}

impl SegmentsArgs {
    /// The folder's configuration with `--set` above it; flags are the caller's to add.
    fn config(&self) -> Result<ConfigBuilder, CliError> {
        let folder = RunFolder::new(&self.segments);
        require_segments(&folder)?;
        let own = folder.config();
        let builder = ConfigBuilder::new().file(&own.display().to_string())?;
        with_sets(builder, &self.set)
    }

    /// Reads everything.
    fn open(&self, config: RunConfig) -> Result<Segments, CliError> {
        let folder = RunFolder::new(&self.segments);
        let cloud = read_cloud(&folder)?;
        let labels = CloudLabels::read(&folder, cloud.background.len())?;
        Ok(Segments { config, cloud, labels })
    }
}

/// `--set`, in the order given.
fn with_sets(builder: ConfigBuilder, sets: &[String]) -> Result<ConfigBuilder, CliError> {
    Ok(sets.iter().try_fold(builder, |builder, assignment| builder.set(assignment))?)
}

/// Makes the folder of a file that is to be written, before the work that fills it.
fn create_folder_of(file: &Path) -> Result<(), CliError> {
    match file.parent() {
        Some(folder) if !folder.as_os_str().is_empty() => instgs_console::args::create_folder(folder),
        _ => Ok(()),
    }
}
