//! L7: what came out of a run: `RUN/report.json` and `RUN/report.html`, a page without scripts or anything from
//! elsewhere, `RUN/review.html` and the pictures of [`stage_pictures`]. Of a run in two phases both reports show the plain
//! cloud, too. [`ReportWriter`] listens to a run; neither the trainer nor the pipeline knows of it.

pub mod chart;
mod curves;
mod error;
mod format;
mod joint_match;
mod pace;
mod page;
mod phases;
mod pictures;
mod review_page;
mod run_report;
pub mod stage_pictures;
mod stages;
mod table;
mod training_clock;
mod writer;

use std::path::Path;

pub use error::ReportError;
pub use joint_match::JointMatch;
pub use pace::final_steps_per_second;
pub use pictures::{MAX_WIDTH_PX, Rgb8, choose};
pub use review_page::{KindOfMasks, ReviewSheet, ReviewView, write_review};
pub use run_report::RunReport;
pub use stage_pictures::data::{GroupOverlay, ObjectColor, OverlayTile, StagePictures, StageView, TemplatePictures};
pub use training_clock::training_seconds;
pub use writer::ReportWriter;

use instgs_io::{IoError, RunFolder, atomic_write};
use instgs_train::events::Event;
use instgs_train::facts::Quality;
use instgs_vk::scene::RepeatedBytes;

/// Everything that the page shows.
#[derive(Clone, Debug, Default)]
pub struct ReportData {
    /// `report.json`.
    pub report: RunReport,
    /// The whole log of the run; the curves are made of it.
    pub events: Vec<Event>,
    /// For instgs: the whole log of the plain cloud that it started from; empty if that was not trained here.
    pub vanilla_events: Vec<Event>,
    /// Views to look at, in the order of the page; see [`choose`].
    pub pictures: Vec<ViewPicture>,
    /// For instgs: what the stages before the joint phase did.
    pub stages: StagePictures,
}

/// A view as it should be and as it is.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewPicture {
    /// View name.
    pub name: String,
    /// How near the two are.
    pub metrics: Quality,
    /// The photograph.
    pub ground_truth: Rgb8,
    /// The rendering; as large as the photograph.
    pub render: Rgb8,
}

/// Writes `report.json` and `report.html` into the run's folder.
///
/// # Errors
/// Two pictures of a view that differ in size, a picture that is none, or a file that cannot be written.
pub fn write(run: &RunFolder, data: &ReportData) -> Result<(), IoError> {
    write_json(run, &data.report)?;
    let path = run.page();
    let text = html(data, &path)?;
    atomic_write(&path, |out| out.write_all(text.as_bytes()))
}

/// Writes `report.json` into the run's folder.
///
/// # Errors
/// The file cannot be written.
pub fn write_json(run: &RunFolder, report: &RunReport) -> Result<(), IoError> {
    instgs_io::json::write_json(&run.report(), report)
}

/// The page; `path` is for messages.
///
/// # Errors
/// Two pictures of a view that differ in size, or a picture that is none.
pub fn html(data: &ReportData, path: &Path) -> Result<String, IoError> {
    page::page(data, path)
}

#[cfg(test)]
mod stage_tests;
#[cfg(test)]
mod tests;
