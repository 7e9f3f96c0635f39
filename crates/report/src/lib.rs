//! Reports of a run: `RUN/report.json` and `RUN/report.html`, one file without external resources that draws the trained scene
//! and compares its pictures with photos, `RUN/review.html` and the pictures of [`stage_pictures`]. For a run in two phases both
//! reports include the plain cloud. [`ReportWriter`] observes a run; neither the trainer nor the pipeline calls this crate.

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
mod scene_view;
pub mod stage_pictures;
mod stages;
mod table;
mod training_clock;
mod writer;

use std::path::Path;

pub use error::{PictureError, ReportError};
pub use joint_match::JointMatch;
pub use pace::final_steps_per_second;
pub use pictures::{MAX_WIDTH_PX, Rgb8, choose};
pub use review_page::{KindOfMasks, ReviewSheet, ReviewView, write_review};
pub use run_report::RunReport;
pub use scene_view::SceneView;
pub use stage_pictures::data::{GroupOverlay, ObjectColor, OverlayTile, StagePictures, StageView, TemplatePictures};
pub use training_clock::training_seconds;
pub use writer::ReportWriter;

use instgs_io::{IoError, RunFolder, atomic_write};
use instgs_train::events::Event;
use instgs_train::facts::Metrics;
use instgs_vk::scene::RepeatedBytes;

/// All data that the page shows.
#[derive(Clone, Debug, Default)]
pub struct ReportData {
    /// The contents of `report.json`.
    pub report: RunReport,
    /// The whole log of the run, for the curves.
    pub events: Vec<Event>,
    /// For instgs: the whole log of the plain cloud that it started from; empty if the cloud was given.
    pub vanilla_events: Vec<Event>,
    /// Test views with their pictures, in the order of the page; see [`choose`].
    pub pictures: Vec<ViewPicture>,
    /// The trained scene; without it the page has no place for it.
    pub scene: Option<SceneView>,
    /// For instgs: pictures of the stages before the joint phase.
    pub stages: StagePictures,
}

/// A test view as photo and as rendering, no wider than the page shows them ([`MAX_WIDTH_PX`]): a run has many views, and the
/// page shows few, which are chosen at the end.
#[derive(Clone, Debug, PartialEq)]
pub struct ViewPicture {
    /// Name of the test view.
    pub name: String,
    /// How near the rendering is to the photo.
    pub metrics: Metrics,
    /// Width and height that the view was trained at, pixels.
    pub size: [u32; 2],
    /// The photo.
    pub ground_truth: Rgb8,
    /// The rendering, of the same size as the photo.
    pub render: Rgb8,
    /// Their difference at full size, amplified and then scaled down as they are.
    pub difference: Rgb8,
}

impl ViewPicture {
    /// The pictures of a view from photo and rendering at full size.
    ///
    /// # Errors
    /// The two differ in size, or a number of bytes does not match its size.
    pub fn new(name: &str, metrics: Metrics, ground_truth: &Rgb8, render: &Rgb8) -> Result<Self, PictureError> {
        let size = [ground_truth.width, ground_truth.height];
        let [ground_truth, render, difference] = pictures::compared(ground_truth, render)?;
        Ok(Self { name: name.into(), metrics, size, ground_truth, render, difference })
    }
}

/// Writes `report.json` and `report.html` into the run folder.
///
/// # Errors
/// A picture whose bytes do not match its size, or a file that cannot be written.
pub fn write(run: &RunFolder, data: &ReportData) -> Result<(), IoError> {
    write_json(run, &data.report)?;
    let path = run.page();
    let text = html(data, &path)?;
    atomic_write(&path, |out| out.write_all(text.as_bytes()))
}

/// Writes `report.json` into the run folder.
///
/// # Errors
/// The file cannot be written.
pub fn write_json(run: &RunFolder, report: &RunReport) -> Result<(), IoError> {
    instgs_io::json::write_json(&run.report(), report)
}

/// The report as an HTML page; `path` is for messages.
///
/// # Errors
/// A picture whose bytes do not match its size.
pub fn html(data: &ReportData, path: &Path) -> Result<String, IoError> {
    page::page(data, path)
}

#[cfg(test)]
mod stage_tests;
#[cfg(test)]
mod tests;
