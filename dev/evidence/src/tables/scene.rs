//! One scene of the evidence: its data set, its comparison, its ablations.

use std::path::{Path, PathBuf};

use super::kept::{Kept, MadeBy};
use super::named_lpips::NamedLpips;
use crate::comparison::{Compared, Comparison, Rival, Runs, Seen, compare, work_seconds};
use crate::data_set::make_data;
use crate::origin::Origin;
use crate::picture_grid::Grid;
use crate::protocol::{DrawLimits, Row};
use crate::results::label_truth::label_accuracy;
use crate::results::scene_list::{Size, Source};
use crate::results::{Ablation, Part, SceneJob, SceneList, SceneResult, Segmentation};
use instgs_cli::training::Session;
use instgs_console::CliError;
use instgs_console::args::{absolute, create_folder};
use instgs_io::json::read_json;
use instgs_io::{MaskFolder, RunFolder, View, load_scene, read_views};
use instgs_objects::pipeline::CloudLabels;
use instgs_objects::pipeline::config::{ConfigBuilder, RunConfig};
use instgs_report::RunReport;
use instgs_synth::dataset;
use instgs_train::config::Method;
use instgs_train::facts::StageTime;

/// The inputs that all scenes share.
pub(super) struct Evidence<'a> {
    pub(super) session: Session<'a>,
    pub(super) list: &'a SceneList,
    pub(super) size: &'a Size,
    /// Seeds of training, one comparison each.
    pub(super) seeds: &'a [u64],
    /// Further scenes to compare with, as far as a scene's kind has them.
    pub(super) also: &'a [Rival],
    pub(super) out: &'a Path,
    pub(super) lpips: Option<NamedLpips>,
    /// This program on this device.
    pub(super) origin: Origin,
}

/// Measures a scene, or reads the results if that is done.
pub(super) fn run_scene(evidence: &Evidence<'_>, job: &SceneJob) -> Result<SceneResult, CliError> {
    let out = evidence.out.join("scenes").join(&job.name);
    create_folder(&out)?;
    let data = data_of(evidence, job);
    let config = config_of(evidence.list, job, &data.folder)?;
    let made_by = made_by(evidence, job, &config)?;
    if let Some(kept) = Kept::read(&out).filter(|kept| kept.made_by == made_by) {
        evidence.session.printer.line(format_args!("{}: as measured before", job.name));
        return Ok(kept.result);
    }
    data.make(evidence)?;
    let result = measured(evidence, job, &data.folder, config, &out)?;
    let kept = Kept { made_by, result };
    kept.write(&out)?;
    Ok(kept.result)
}

/// What an earlier call has left of a scene.
pub(super) enum Earlier {
    /// A result that may be in one table with those of now: of this program and these settings, on any device.
    Fits(Box<SceneResult>),
    /// A result of something else, which is named.
    Other(&'static str),
    /// No result.
    Nothing,
}

/// Reads what an earlier call has left of a scene.
pub(super) fn earlier(evidence: &Evidence<'_>, job: &SceneJob) -> Result<Earlier, CliError> {
    let Some(kept) = Kept::read(&evidence.out.join("scenes").join(&job.name)) else { return Ok(Earlier::Nothing) };
    let config = config_of(evidence.list, job, &data_of(evidence, job).folder)?;
    let difference = kept.made_by.difference_beside(&made_by(evidence, job, &config)?);
    Ok(difference.map_or_else(|| Earlier::Fits(Box::new(kept.result)), Earlier::Other))
}

fn made_by(evidence: &Evidence<'_>, job: &SceneJob, config: &RunConfig) -> Result<MadeBy, CliError> {
    let ablations = if job.ablations { evidence.list.ablations.as_slice() } else { &[] };
    // Which rows are measured is no setting of these rows.
    let plain = SceneJob { ablations: false, ..job.clone() };
    Ok(MadeBy {
        settings: format!("{plain:?} {:?} {:?} {}", evidence.size, evidence.seeds, config.to_toml()?),
        rows: format!("{:?} {ablations:?}", evidence.also),
        lpips: evidence.lpips.as_ref().map(|lpips| lpips.name.clone()),
        origin: evidence.origin.clone(),
    })
}

/// The folder of a data set, and how it is made if `synth` makes it.
struct Data<'a> {
    folder: PathBuf,
    made: Option<(&'a str, dataset::Options)>,
}

impl Data<'_> {
    /// Renders the data set unless it exists.
    fn make(&self, evidence: &Evidence<'_>) -> Result<(), CliError> {
        match &self.made {
            Some((recipe, options)) => make_data(recipe, &self.folder, options, evidence.session.printer),
            None => Ok(()),
        }
    }
}

fn data_of<'a>(evidence: &Evidence<'_>, job: &'a SceneJob) -> Data<'a> {
    match &job.source {
        Source::Folder(folder) => Data { folder: folder.clone(), made: None },
        Source::Synth { recipe, seed, instances, differences } => {
            let [width, height] = evidence.size.pixels;
            let folder =
                evidence.out.join("data").join(format!("{}_{width}x{height}_{}", job.name, evidence.size.views));
            let options = dataset::Options {
                views: evidence.size.views,
                size: (width, height),
                seed: *seed,
                instances: *instances,
                differences: *differences,
                flight: None,
                pose_noise: None,
            };
            Data { folder, made: Some((recipe, options)) }
        }
    }
}

/// The list's configuration with the settings of the job.
fn config_of(list: &SceneList, job: &SceneJob, data: &Path) -> Result<RunConfig, CliError> {
    let mut builder = ConfigBuilder::new().file(&list.config)?;
    for assignment in &job.set {
        builder = builder.set(assignment)?;
    }
    if job.true_groups {
        builder = builder.flag("true_groups", "groups", absolute("true_groups", &data.join("groups.json"))?)?;
    }
    let mut config = builder.flag("tables", "method", Method::Instanced.name())?.finish()?;
    config.train.seed = 0;
    Ok(config)
}

fn measured(
    evidence: &Evidence<'_>,
    job: &SceneJob,
    data: &Path,
    config: RunConfig,
    out: &Path,
) -> Result<SceneResult, CliError> {
    let session = &evidence.session;
    let mut rivals = match job.part {
        Part::Scene => Rival::ALL.to_vec(),
        Part::Scaling | Part::Differences => vec![Rival::SameBytes],
        Part::Failure => Vec::new(),
    };
    rivals.retain(|rival| evidence.also.contains(rival));
    let comparison = Comparison {
        data: data.into(),
        out: out.into(),
        config,
        seeds: evidence.seeds.to_vec(),
        frames: evidence.size.frames,
        more_steps: job.more_steps,
        rivals,
        lpips: evidence.lpips.as_ref().map(|lpips| lpips.network.clone()),
    };
    let mut grid = Grid::default();
    let Compared { seeds, views } = compare(session, &comparison, &mut |name, view| grid.add(name, view))?;
    grid.write(&out.join("pictures.png"))?;
    let first = evidence.seeds.first().copied().unwrap_or_default();
    let at = out.join(format!("seed_{first}"));
    let report: RunReport = read_json(&RunFolder::new(at.join("instgs")).report())?;
    let mut config = comparison.config.clone();
    config.train.seed = first;
    let runs = Runs { session, data, out: at, config };
    Ok(SceneResult {
        name: job.name.clone(),
        synthetic: matches!(job.source, Source::Synth { .. }),
        part: job.part,
        seeds,
        segmentation: segmentation(&runs, &report, &read_views(data)?.views)?,
        instances: report.groups.iter().map(|group| group.instances.len() as u64).sum(),
        differences: match job.source {
            Source::Synth { differences, .. } => differences,
            Source::Folder(_) => 1.0,
        },
        ablations: if job.ablations { ablations(evidence, &runs, &views)? } else { Vec::new() },
        limits: DrawLimits::of(&runs.config.train),
        origin: evidence.origin.clone(),
    })
}

/// Statistics of how objects were found.
fn segmentation(runs: &Runs<'_>, report: &RunReport, views: &[View]) -> Result<Segmentation, CliError> {
    let folder = runs.folder("instgs");
    let cloud = load_scene(&folder.point_cloud())?.scene.background;
    let segmented = CloudLabels::read(&folder, cloud.len())?;
    let seconds = |name: &str| report.stages.iter().filter(|s: &&StageTime| s.name == name).map(|s| s.seconds).sum();
    let consensus = &segmented.consensus;
    let masks = MaskFolder::default_for(runs.data)
        .filter(|_| runs.config.pipeline.masks.is_none() && runs.config.train.width == 0);
    let mean_accuracy = match masks {
        Some(folder) => {
            let masks = MaskFolder::open(&folder, views)?;
            label_accuracy(runs.data, views, &masks, &cloud.means, &segmented)?
        }
        None => None,
    };
    Ok(Segmentation {
        gaussians: cloud.len() as u64,
        objects: consensus.objects.len() as u64,
        seconds: ["consensus", "segment", "register", "merge"].map(seconds),
        bytes: consensus.contribution_bytes + consensus.point_bytes,
        mean_accuracy,
    })
}

/// Trains other settings from the same plain cloud, and measures them on the test views of the comparison.
fn ablations(evidence: &Evidence<'_>, runs: &Runs<'_>, views: &[View]) -> Result<Vec<Ablation>, CliError> {
    let (masks, lpips) = (runs.masks(views)?, evidence.lpips.as_ref().map(|lpips| &lpips.network));
    let measure = runs.measure(Seen { views, masks: masks.as_ref(), lpips });
    let mut out = Vec::new();
    for setting in &evidence.list.ablations {
        let mut builder = ConfigBuilder::new().text(&runs.config.to_toml()?, "the scene's configuration")?;
        for assignment in &setting.set {
            builder = builder.set(assignment)?;
        }
        let config = builder.finish()?;
        let (table, name) = (setting.table.clone(), setting.name.clone());
        evidence.session.printer.line(format_args!("ablation, {table}: {name}"));
        // Without settings it is the scene itself.
        let is_itself = config == runs.config;
        let folder = if is_itself { "instgs".into() } else { folder_of(&table, &name) };
        let report = if is_itself { runs.train(&folder, config)? } else { runs.variant(&folder, config)? };
        let scene = runs.folder(&folder).scene();
        let row = measure.row(&name, &scene, &mut |_| ())?;
        let steps = runs.config.train.steps + report.steps;
        out.push(Ablation { table, name, row: Row { seconds: work_seconds(&report), steps, ..row } });
    }
    Ok(out)
}

/// A folder name made of letters, digits and underscores.
fn folder_of(table: &str, name: &str) -> String {
    let plain = |c: char| if c.is_ascii_alphanumeric() { c } else { '_' };
    format!("ablation_{table}_{name}").chars().map(plain).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folders_have_plain_names() {
        assert_eq!(folder_of("offsets", "position + dc"), "ablation_offsets_position___dc");
    }
}
