//! Trains an instanced scene and the plain clouds that it is compared with, and measures them: for the commands
//! `compare`, `tables` and `demo`.

mod runs;
mod same_bytes;
mod seed;
mod summary;
mod timing;

use std::path::PathBuf;

use clap::ValueEnum;

pub(super) use self::runs::{Runs, Seen, work_seconds};
use self::seed::compare_seed;
use self::summary::{claims, markdown, print_summary, summary};
use crate::origin::Origin;
use crate::protocol::{DrawLimits, SeedResult};
use instgs_cli::training::Session;
use instgs_console::CliError;
use instgs_console::args::create_folder;
use instgs_eval::{Evaluated, Lpips};
use instgs_io::{Dataset, IoError, Split, View};
use instgs_objects::pipeline::config::RunConfig;
use instgs_train::{leave_out_masked, read_dataset};

/// File in the folder of a comparison that records its settings.
const CONFIG: &str = "config.toml";

/// A scene to measure in addition to the instanced scene, the cloud it starts from, and the cloud of the same time.
#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub(crate) enum Rival {
    /// A plain cloud that, packed as f16, takes at most as many bytes as the instanced scene packed as f16
    SameBytes,
    /// A plain cloud of as many steps as the cloud of the same time, trained in one run
    AtOnce,
    /// The same with the strategy 3DGS-MCMC
    Mcmc,
    /// The cloud of the same time as .spz: every Gaussian quantised by itself
    Spz,
    /// The cloud of the same time as .instgs, packed as small
    Small,
    /// Templates and poses without offsets
    Rigid,
}

impl Rival {
    /// All rivals, in the order of the tables.
    pub(crate) const ALL: [Self; 6] = [Self::AtOnce, Self::Mcmc, Self::SameBytes, Self::Spz, Self::Small, Self::Rigid];
}

/// The settings of a comparison.
pub(crate) struct Comparison {
    /// Folder of the data set.
    pub(crate) data: PathBuf,
    /// Folder for runs and results.
    pub(crate) out: PathBuf,
    /// Configuration of the instanced runs, except for the seed.
    pub(crate) config: RunConfig,
    /// Seeds of training, one comparison each.
    pub(crate) seeds: Vec<u64>,
    /// Number of timed frames; 0 = none.
    pub(crate) frames: u32,
    /// Steps that the plain cloud is trained on; `None` = by wall time.
    pub(crate) more_steps: Option<u64>,
    /// Further scenes to measure.
    pub(crate) rivals: Vec<Rival>,
    /// Network of LPIPS, if its weights are there.
    pub(crate) lpips: Option<Lpips>,
}

/// A finished comparison.
pub(crate) struct Compared {
    /// Rows of each seed.
    pub(crate) seeds: Vec<SeedResult>,
    /// The test views that every row was measured on.
    pub(crate) views: Vec<View>,
}

/// Trains and measures for every seed; writes compare.json and compare.md and prints the table. `on_picture` receives
/// the row's name and each test view of the first seed.
pub(crate) fn compare(
    session: &Session<'_>,
    comparison: &Comparison,
    on_picture: &mut dyn FnMut(&str, &Evaluated<'_>),
) -> Result<Compared, CliError> {
    let views = test_views(session, comparison)?;
    create_folder(&comparison.out)?;
    keep_config(comparison, &Origin::here(session.gpu.caps())?)?;
    let mut results = Vec::new();
    for (i, &seed) in comparison.seeds.iter().enumerate() {
        let mut first_only = |name: &str, view: &Evaluated<'_>| {
            if i == 0 {
                on_picture(name, view);
            }
        };
        results.push(compare_seed(session, comparison, &views, seed, &mut first_only)?);
        session.printer.json_file(&comparison.out.join("compare.json"), &results)?;
    }
    let table = summary(&results);
    let claims = claims(&results, DrawLimits::of(&comparison.config.train));
    let markdown = markdown(&table, &claims);
    instgs_io::atomic_write(&comparison.out.join("compare.md"), |out| out.write_all(markdown.as_bytes()))?;
    print_summary(&table, &claims, session.printer);
    Ok(Compared { seeds: results, views })
}

/// The test views to compare on. Called before anything is trained.
fn test_views(session: &Session<'_>, comparison: &Comparison) -> Result<Vec<View>, CliError> {
    let mut views: Vec<View> =
        Dataset::split(&read_dataset(&comparison.data, &comparison.config.train)?, Split::Test).cloned().collect();
    let width = (comparison.config.train.width > 0).then_some(comparison.config.train.width);
    let masked = leave_out_masked(&mut views, width, &mut || Ok(()))?;
    masked.iter().for_each(|text| session.printer.warning(text));
    if views.is_empty() {
        let error = IoError::new(&comparison.data, "has no test views to compare");
        return Err(error.advise("add a test split, or photos: every eighth of more than eight is one").into());
    }
    Ok(views)
}

/// Writes the settings of the comparison and what makes it; refuses a folder with runs of other settings, or of another
/// program or device: their times and pictures are not those of now.
pub(crate) fn keep_config(comparison: &Comparison, origin: &Origin) -> Result<(), CliError> {
    let path = comparison.out.join(CONFIG);
    let data = std::fs::canonicalize(&comparison.data).unwrap_or_else(|_| comparison.data.clone());
    let more = comparison.more_steps.map_or("by the clock".into(), |steps| steps.to_string());
    let settings = format!("# data: {}\n# more steps: {more}\n{}", data.display(), comparison.config.to_toml()?);
    let text = format!("# program: {}\n# device: {}\n{settings}", origin.program, origin.device);
    match std::fs::read(&path) {
        Ok(there) if there == text.as_bytes() => Ok(()),
        Ok(there) if there.ends_with(settings.as_bytes()) => {
            let error = IoError::new(&path, "is of another build of the program, or of another device");
            Err(error.advise("choose another --out, so that no table mixes two").into())
        }
        Ok(_) => {
            let error = IoError::new(&path, "is of another comparison");
            Err(error.advise("repeat it with the same configuration, or choose another --out").into())
        }
        Err(_) => Ok(instgs_io::atomic_write(&path, |out| out.write_all(text.as_bytes()))?),
    }
}
