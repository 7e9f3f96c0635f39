//! Progress and messages about masks, labels and groups, shared by several commands.

use instgs_console::{Printer, Progress};
use instgs_detect::report::Dropped;
use instgs_detect::{PromptReport, ViewMasks};
use instgs_io::IoError;
use instgs_objects::pipeline::{Message, Observer};
use instgs_objects::segment::LabelProgress;
use instgs_objects::template::GroupReport;

/// Progress of labelling, and of masks from boxes.
pub struct LabelLines<'a> {
    printer: &'a Printer,
    progress: Option<Progress>,
}

impl<'a> LabelLines<'a> {
    /// Progress that shows nothing before the first view.
    pub fn new(printer: &'a Printer) -> Self {
        Self { printer, progress: None }
    }

    /// Ends the progress of the stage.
    pub fn end(&mut self) {
        self.progress = None;
    }

    /// Shows the number of views done.
    pub fn at(&mut self, at: LabelProgress) {
        let progress = self.progress.get_or_insert_with(|| self.printer.progress("segment", at.total as u64));
        progress.advance_to(at.done as u64, "");
    }
}

/// Prints a line for each group that became a template.
pub fn group_lines(groups: &[GroupReport], printer: &Printer) {
    for group in groups.iter().filter(|g| g.template.is_some()) {
        let name = group.name.clone().unwrap_or_else(|| format!("group {}", group.template_id));
        let (fewest, mean, most) = group.gaussians_per_instance;
        printer.line(format_args!(
            "{name}: {} instances of {fewest} to {most} Gaussians (mean {mean:.0}), template of {}, match distance {:.3}",
            group.instances.len(),
            group.template_gaussians,
            group.match_distance
        ));
    }
}

/// Warns of phrases that were not found, and of detections that were dropped.
pub fn warn_of_names(found: &PromptReport, printer: &Printer) {
    if let Some(note) = found.views_without_note() {
        printer.warning(note);
    }
    let Dropped { unnamed, repeated, outside, same_mask, empty, covered } = found.dropped;
    let left_out: Vec<String> = [
        (unnamed, "of no phrase above --text-threshold"),
        (repeated, "covered by a better box of the same phrase"),
        (outside, "outside of the photo"),
        (same_mask, "with the mask of a better box"),
        (empty, "without a pixel in their mask"),
        (covered, "wholly behind smaller masks"),
    ]
    .into_iter()
    .filter(|(count, _)| *count > 0)
    .map(|(count, why)| format!("{count} {why}"))
    .collect();
    if !left_out.is_empty() {
        printer.line(format_args!("boxes that became no mask: {}", left_out.join(", ")));
    }
}

/// Progress of masks from words.
pub struct NamingLines<'a> {
    printer: &'a Printer,
    progress: Option<Progress>,
}

impl<'a> NamingLines<'a> {
    /// Progress that shows nothing before the first view.
    pub fn new(printer: &'a Printer) -> Self {
        Self { printer, progress: None }
    }

    /// Ends the progress after all views.
    pub fn end(&mut self) {
        self.progress = None;
    }

    /// Shows that a view of `total` is done.
    pub fn at(&mut self, name: &str, found: &ViewMasks, total: usize) {
        let progress = self.progress.get_or_insert_with(|| self.printer.progress("masks", total as u64));
        progress.step(format_args!("{name}: {} masks", found.boxes.len()));
    }
}

/// For a single stage, whose progress is all that is shown.
impl Observer for LabelLines<'_> {
    fn notify(&mut self, message: Message<'_>) -> Result<(), IoError> {
        match message {
            Message::Labelling(at) => self.at(at),
            Message::Warning(text) => self.printer.warning(text),
            _ => {}
        }
        Ok(())
    }
}
