//! `masks --prompt`: makes masks of the objects that a text names.

use std::path::{Path, PathBuf};
use std::time::Instant;

use clap::Args;

use super::unfinished::marked;
use crate::progress_lines::{NamingLines, warn_of_names};
use instgs_console::table::{Table, grouped};
use instgs_console::{CliError, Printer};
use instgs_detect::{DetectOptions, Prompt, PromptOptions, PromptReport, Provider, RuntimeOptions, ViewMasks};
use instgs_io::View;
use instgs_objects::pipeline::PipelineError;

/// Flags of `masks --prompt` for detection.
#[derive(Args)]
#[command(next_help_heading = "With --prompt")]
pub(super) struct PromptArgs {
    /// Folder of the models: models.json and the files it names; see tools/models/README.md
    #[arg(long, value_name = "DIR", conflicts_with_all = ["boxes", "masks"])]
    models: Option<PathBuf>,
    /// A box counts if the score of its best token is above this [default: 0.25]
    #[arg(long, value_name = "P", conflicts_with_all = ["boxes", "masks"])]
    box_threshold: Option<f64>,
    /// A box belongs to a phrase if the score of one of the phrase's tokens is above this [default: 0.25]
    #[arg(long, value_name = "P", conflicts_with_all = ["boxes", "masks"])]
    text_threshold: Option<f64>,
    /// Of two boxes of one phrase, or two masks, that overlap by more, the lower score is dropped [default: 0.8]
    #[arg(long, value_name = "IOU", conflicts_with_all = ["boxes", "masks"])]
    overlap: Option<f64>,
    /// ONNX Runtime's library [default: ORT_DYLIB_PATH, the one made by tools/setup_onnxruntime, or the system's]
    #[arg(long, value_name = "FILE", conflicts_with_all = ["boxes", "masks"])]
    runtime: Option<PathBuf>,
    /// Device of the models: cpu, or, if the library supports it, cuda, tensorrt, rocm, coreml, directml [default: cpu]
    #[arg(long, value_name = "NAME", conflicts_with_all = ["boxes", "masks"])]
    provider: Option<Provider>,
}

impl PromptArgs {
    fn options(&self) -> PromptOptions {
        let usual = DetectOptions::default();
        PromptOptions {
            detect: DetectOptions {
                box_threshold: self.box_threshold.unwrap_or(usual.box_threshold),
                text_threshold: self.text_threshold.unwrap_or(usual.text_threshold),
                overlap: self.overlap.unwrap_or(usual.overlap),
            },
            runtime: RuntimeOptions { library: self.runtime.clone(), provider: self.provider.unwrap_or_default() },
        }
    }
}

/// The report printed with `--json`.
#[derive(serde::Serialize)]
pub(super) struct Report {
    prompt: String,
    #[serde(flatten)]
    found: PromptReport,
    seconds: f64,
}

/// Writes the masks of all views into the folder `out`.
pub(super) fn make(
    views: &[View],
    prompt: &str,
    args: &PromptArgs,
    out: &Path,
    printer: &Printer,
) -> Result<Report, CliError> {
    let started = Instant::now();
    let prompt = Prompt::parse(prompt).map_err(PipelineError::from)?;
    let Some(models) = &args.models else {
        let what = "--prompt needs models: give their folder with --models; tools/models/README.md says how to make it";
        return Err(CliError::msg(what));
    };
    let views: Vec<&View> = views.iter().collect();
    let mut lines = NamingLines::new(printer);
    let mut done = |name: &str, found: &ViewMasks| lines.at(name, found, views.len());
    let found = marked(out, || {
        let found = instgs_detect::masks_from_prompt(&views, &prompt, models, &args.options(), out, &mut done);
        Ok(found.map_err(PipelineError::from)?)
    });
    drop(lines);
    let found = found?;
    Ok(Report { prompt: prompt.text(), found, seconds: started.elapsed().as_secs_f64() })
}

pub(super) fn print(report: &Report, printer: &Printer) {
    let mut table = Table::default();
    table.row(["phrase", "masks", "views"].map(String::from));
    for phrase in &report.found.phrases {
        table.row([phrase.phrase.clone(), grouped(phrase.masks as u64), grouped(phrase.views as u64)]);
    }
    printer.line(table);
    warn_of_names(&report.found, printer);
}
