//! `instgs-vk levels`: levels of detail of templates that look like their template.

use std::collections::BTreeSet;
use std::path::PathBuf;

use clap::Args;

use instgs_console::args::{create_folder_of, open_scene, orbit_of};
use instgs_console::device::{self, DeviceArgs};
use instgs_console::table::{Table, grouped};
use instgs_console::{CliError, Printer};
use instgs_io::{ExportFormat, IoError, export_scene, packing_lost};
use instgs_levels::{FitOptions, LevelReport, fit_template};
use instgs_vk::scene::lod::{FittedLevel, merged_levels, template_print};
use instgs_vk::scene::{Gaussians, InstancedScene};

/// Optimises the levels of detail of a scene's templates and stores them in the scene, for --lod of render, bench and the
/// player: far objects are drawn from fewer Gaussians, and look as before.
///
/// Without this command, levels are made by merging when a scene is opened, which is fast, and coarser to look at. Each level
/// is trained against pictures of its template, once for all instances. Templates whose levels the scene has are skipped.
#[derive(Args)]
#[command(after_help = "Examples:\n  \
    instgs-vk levels park.instgs --out park.instgs\n  \
    instgs-vk bench --scene park.instgs --lod 1,2\n  \
    instgs-vk view park.instgs --lod 1")]
pub(super) struct LevelsArgs {
    /// Scene with instances, .instgs or .glb
    #[arg(value_name = "SCENE")]
    scene: PathBuf,
    /// File to write, .instgs; may be the scene itself
    #[arg(long, value_name = "X.instgs")]
    out: PathBuf,
    /// Training steps of each level
    #[arg(long, value_name = "N", default_value_t = 600, value_parser = clap::value_parser!(u64).range(1..=1_000_000))]
    steps: u64,
    /// Views of the template that each level is trained on
    #[arg(long, value_name = "N", default_value_t = 128, value_parser = clap::value_parser!(u16).range(1..=4096))]
    views: u16,
    /// Fixes the directions and backgrounds of the views; the same seed gives the same bytes
    #[arg(long, value_name = "N", default_value_t = 0)]
    seed: u64,
    /// Train levels again that the scene has
    #[arg(long)]
    again: bool,
    /// Report as JSON on stdout
    #[arg(long)]
    pub(super) json: bool,
}

#[derive(serde::Serialize)]
struct Report {
    scene: String,
    out: String,
    templates: Vec<TemplateReport>,
    bytes: u64,
}

#[derive(serde::Serialize)]
struct TemplateReport {
    template: usize,
    gaussians: u32,
    /// True if the scene had its levels.
    skipped: bool,
    levels: Vec<LevelReport>,
}

pub(super) fn run(args: &LevelsArgs, device_args: &DeviceArgs, printer: &Printer) -> Result<(), CliError> {
    let format = ExportFormat::of(&args.out, None)?;
    if !matches!(format, ExportFormat::Instgs(_)) {
        return Err(IoError::new(&args.out, "is not named .instgs").advise("levels are kept in .instgs files").into());
    }
    let mut scene = open_scene(&args.scene, printer)?.scene;
    if scene.instances.is_empty() {
        return Err(IoError::new(&args.scene, "has no instances, and levels are those of templates")
            .advise("a plain cloud has levels by merging: --lod needs no preparation")
            .into());
    }
    create_folder_of(&args.out)?;
    if args.again {
        scene.fitted_levels.clear();
    }
    let to_train = to_train(&scene);
    let total: usize = to_train.iter().map(|template| template.merged.len()).sum();
    let gpu = device::open(device_args.choice())?;
    let mut progress = printer.progress("levels", total as u64);
    let options = FitOptions { steps: args.steps, views: args.views.into(), seed: args.seed };
    let mut templates = Vec::with_capacity(to_train.len());
    for Template { template, cloud, has_levels, merged } in to_train {
        let mut levels = Vec::with_capacity(merged.len());
        let fitted = fit_template(&gpu, &cloud, merged, scene.pixel_filter, &options, |level| {
            progress.step(format_args!(
                "template {template}, {} Gaussians: {:.1} dB, merged {:.1}",
                grouped(level.gaussians as u64),
                level.fitted_psnr_db,
                level.merged_psnr_db
            ));
            levels.push(level);
        })?;
        scene.fitted_levels.extend(fitted);
        templates.push(TemplateReport { template, gaussians: cloud.len() as u32, skipped: has_levels, levels });
    }
    drop(progress);
    device::check_validation(&gpu)?;
    // The file may be the scene's own.
    let lost = packing_lost(&args.scene).filter(|_| matches!(format, ExportFormat::Instgs(_)));
    let exported = export_scene(&args.out, &scene, format, orbit_of(&args.scene, &scene, None).up)?;
    exported.notes(&args.out, &scene, format).iter().chain(&lost).for_each(|note| printer.warning(note));
    let report = Report {
        scene: args.scene.display().to_string(),
        out: args.out.display().to_string(),
        templates,
        bytes: std::fs::metadata(&args.out).map_or(0, |m| m.len()),
    };
    if args.json {
        return printer.json(&report);
    }
    printer.line(table_of(&report.templates));
    printer.line(format_args!("{}: {} bytes", report.out, grouped(report.bytes)));
    Ok(())
}

/// A template that instances use.
struct Template {
    template: usize,
    cloud: Gaussians,
    /// True if the scene has levels of it.
    has_levels: bool,
    /// Its levels by merging; none if it has levels.
    merged: Vec<FittedLevel>,
}

fn to_train(scene: &InstancedScene) -> Vec<Template> {
    let has: BTreeSet<u64> = scene.fitted_levels.iter().map(|level| level.template_print).collect();
    let used: BTreeSet<usize> = scene.instances.iter().map(|instance| instance.template as usize).collect();
    let of = |template: usize| {
        let cloud = scene.templates.range(scene.template_ranges[template]);
        let has_levels = has.contains(&template_print(&cloud));
        let merged = if has_levels { Vec::new() } else { merged_levels(&cloud) };
        Template { template, cloud, has_levels, merged }
    };
    used.into_iter().map(of).collect()
}

fn table_of(templates: &[TemplateReport]) -> Table {
    let mut table = Table::default();
    table.row(["template", "Gaussians", "cell", "merged, dB", "fitted, dB"].map(String::from));
    for TemplateReport { template, gaussians, skipped, levels } in templates {
        let has_levels = if *skipped { ", has its levels" } else { "" };
        table.row([format!("{template}{has_levels}"), grouped(u64::from(*gaussians))]);
        for level in levels {
            table.row([
                template.to_string(),
                grouped(level.gaussians as u64),
                format!("{:.3}", level.cell),
                format!("{:.1}", level.merged_psnr_db),
                format!("{:.1}{}", level.fitted_psnr_db, if level.is_kept { "" } else { ", left out" }),
            ]);
        }
    }
    table
}

#[cfg(test)]
mod tests {
    use clap::Parser;
    use instgs_io::save_scene;
    use instgs_vk::math::similarity::Similarity;
    use instgs_vk::scene::{Instance, SourceRange};

    use super::*;

    #[derive(Parser)]
    struct Line {
        #[command(flatten)]
        args: LevelsArgs,
        #[command(flatten)]
        device: DeviceArgs,
    }

    /// Before a device is opened, and so before anything is trained.
    #[test]
    fn a_folder_that_cannot_be_made_is_noticed_first() -> Result<(), Box<dyn std::error::Error>> {
        let folder = tempfile::tempdir()?;
        let path = folder.path().join("a.instgs");
        let templates = Gaussians {
            sh_degree: 0,
            means: vec![[0.0; 3]],
            quats: vec![[1.0, 0.0, 0.0, 0.0]],
            log_scales: vec![[-3.0; 3]],
            opacity_logits: vec![1.0],
            sh: vec![[0.2; 3]],
        };
        let instance = Instance { template: 0, world_from_template: Similarity::IDENTITY, first_offset: None };
        let scene = InstancedScene {
            templates,
            template_ranges: vec![SourceRange { first: 0, count: 1 }],
            instances: vec![instance],
            ..InstancedScene::default()
        };
        save_scene(&path, &scene)?;
        // A file is in the way of the folder.
        let out = path.join("new/b.instgs").display().to_string();
        let scene = path.display().to_string();
        // No such device: nothing goes on from there.
        let Line { args, device } = Line::try_parse_from(["levels", &scene, "--out", &out, "--device", "none such"])?;
        let error = run(&args, &device, &Printer::new(false)).err().ok_or("taken")?.to_string();
        assert!(error.contains("cannot create the folder"), "{error}");
        Ok(())
    }
}
