//! Frame times: scenes drawn in turn, by pass; what levels of detail cost and save; and the reports.

mod lod;
mod measure;
mod report;

pub use lod::{LodCamera, LodError, LodReport, LodRow, LodSubject, LodView, run_lod};
pub use measure::{BenchError, MeasurePhase, Subject, Upload, run};
pub use report::{CameraReport, DrawnCounts, Ratio, Report, SceneReport};
