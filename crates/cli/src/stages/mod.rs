//! The stages between the two phases of `train --method instgs` as commands: `segment`, `register`, `merge`. They pass
//! their results in a folder that has the layout of a run folder.

pub(super) mod merge;
pub(super) mod register;
pub(super) mod segment;

use std::path::PathBuf;

use clap::Args;

use instgs_console::CliError;
use instgs_io::RunFolder;
use instgs_objects::pipeline::CloudLabels;
use instgs_objects::pipeline::config::{ConfigBuilder, RunConfig};
use instgs_objects::pipeline::label_gaussians::{read_cloud, require_segments};
use instgs_vk::scene::InstancedScene;

/// The folder of the earlier stages, and changes to its configuration.
#[derive(Args)]
struct SegmentsArgs {
    /// Folder written by segment, or a run folder of train --method instgs
    #[arg(long, value_name = "DIR")]
    segments: PathBuf,
    /// One value of the configuration, replacing that of the folder; may be repeated
    #[arg(long, value_name = "KEY=VALUE")]
    set: Vec<String>,
}

/// Contents of the folder.
struct Segments {
    config: RunConfig,
    cloud: InstancedScene,
    labels: CloudLabels,
}

impl SegmentsArgs {
    /// The folder's configuration with `--set` applied; the caller adds its own flags.
    fn config(&self) -> Result<ConfigBuilder, CliError> {
        let folder = RunFolder::new(&self.segments);
        require_segments(&folder)?;
        let own = folder.config();
        let builder = ConfigBuilder::new().file(&own.display().to_string())?;
        with_sets(builder, &self.set)
    }

    /// Reads all files of the folder.
    fn open(&self, config: RunConfig) -> Result<Segments, CliError> {
        let folder = RunFolder::new(&self.segments);
        let cloud = read_cloud(&folder)?;
        let labels = CloudLabels::read(&folder, cloud.background.len())?;
        Ok(Segments { config, cloud, labels })
    }
}

/// Applies the values of `--set` in the order given.
fn with_sets(builder: ConfigBuilder, sets: &[String]) -> Result<ConfigBuilder, CliError> {
    Ok(sets.iter().try_fold(builder, |builder, assignment| builder.set(assignment))?)
}
