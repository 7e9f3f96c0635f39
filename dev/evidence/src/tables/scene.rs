//! One scene of the evidence: its data set, its comparison, its ablations.

use std::path::{Path, PathBuf};

use serde::{Deserialize, Serialize};

use crate::comparison::{Comparison, Rival, Runs, compare, work_seconds};
use crate::data_set::make_data;
use crate::picture_grid::Grid;
use crate::protocol::{Measure, Row};
use crate::results::label_truth::label_accuracy;
use crate::results::scene_list::{Size, Source};
use crate::results::{Ablation, Part, SceneJob, SceneList, SceneResult, Segmentation};
use instgs_cli::training::Session;
use instgs_console::CliError;
use instgs_console::args::{absolute, create_folder};
use instgs_eval::Lpips;
use instgs_io::json::{read_json, write_json};
use instgs_io::{MaskFolder, RunFolder, Split, View, load_scene, read_views};
use instgs_objects::pipeline::CloudLabels;
use instgs_objects::pipeline::config::{ConfigBuilder, RunConfig};
use instgs_report::RunReport;
use instgs_synth::dataset;
use instgs_train::config::Method;
use instgs_train::eval_options;
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
    pub(super) lpips: Option<Lpips>,
}

/// A result, with the settings that it was computed from.
#[derive(Serialize, Deserialize)]
struct Kept {
    /// Everything that the result depends on, as text.
    made_by: String,
    result: SceneResult,
}

/// Measures a scene, or reads the results if that is done.
pub(super) fn run_scene(evidence: &Evidence<'_>, job: &SceneJob) -> Result<SceneResult, CliError> {
    let out = evidence.out.join("scenes").join(&job.name);
    create_folder(&out)?;
    let data = data_of(evidence, job)?;
    let config = config_of(evidence.list, job, &data)?;
    let ablations = if job.ablations { evidence.list.ablations.as_slice() } else { &[] };
    let (seeds, also, lpips) = (evidence.seeds, evidence.also, evidence.lpips.is_some());
    let made_by = format!("{job:?} {:?} {seeds:?} {also:?} {lpips} {ablations:?} {}", evidence.size, config.to_toml()?);
    let path = out.join("result.json");
    if let Ok(kept) = read_json::<Kept>(&path)
        && kept.made_by == made_by
    {
        evidence.session.printer.line(format_args!("{}: as measured before", job.name));
        return Ok(kept.result);
    }
    let result = measured(evidence, job, &data, config, &out)?;
    let kept = Kept { made_by, result };
    write_json(&path, &kept)?;
    Ok(kept.result)
}

/// The folder of the data set, which is rendered if it does not exist.
fn data_of(evidence: &Evidence<'_>, job: &SceneJob) -> Result<PathBuf, CliError> {
    match &job.source {
        Source::Folder(folder) => Ok(folder.clone()),
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
            make_data(recipe, &folder, &options, evidence.session.printer)?;
            Ok(folder)
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
        lpips: evidence.lpips.clone(),
    };
    let mut grid = Grid::default();
    let seeds = compare(session, &comparison, &mut |name, view| grid.add(name, view))?;
    grid.write(&out.join("pictures.png"))?;
    let first = evidence.seeds.first().copied().unwrap_or_default();
    let at = out.join(format!("seed_{first}"));
    let report: RunReport = read_json(&RunFolder::new(at.join("instgs")).report())?;
    let mut config = comparison.config.clone();
    config.train.seed = first;
    let runs = Runs { session, data, out: at, config };
    let views = read_views(data)?.views;
    Ok(SceneResult {
        name: job.name.clone(),
        synthetic: matches!(job.source, Source::Synth { .. }),
        part: job.part,
        seeds,
        segmentation: segmentation(&runs, &report, &views)?,
        instances: report.groups.iter().map(|group| group.instances.len() as u64).sum(),
        differences: match job.source {
            Source::Synth { differences, .. } => differences,
            Source::Folder(_) => 1.0,
        },
        ablations: if job.ablations { ablations(evidence, &comparison, &runs, &views)? } else { Vec::new() },
        device: session.gpu.caps().name.clone(),
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

/// Trains other settings from the same plain cloud, and measures them.
fn ablations(
    evidence: &Evidence<'_>,
    comparison: &Comparison,
    runs: &Runs<'_>,
    views: &[View],
) -> Result<Vec<Ablation>, CliError> {
    let test: Vec<View> = views.iter().filter(|view| view.split == Split::Test).cloned().collect();
    let masks = runs.config.pipeline.masks.clone().or_else(|| MaskFolder::default_for(runs.data));
    let masks = masks.map(|folder| MaskFolder::open(&folder, views)).transpose()?;
    let measure = Measure {
        gpu: evidence.session.gpu,
        views: &test,
        width: (runs.config.train.width > 0).then_some(runs.config.train.width),
        options: eval_options(&comparison.config.train),
        masks: masks.as_ref(),
        lpips: evidence.lpips.as_ref(),
    };
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
