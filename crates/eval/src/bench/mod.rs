//! Frame times: scenes drawn in turn, by pass, and what levels of detail cost and save; and the report of it.

mod lod;
mod measure;
mod report;

pub use lod::{LodCamera, LodError, LodReport, LodRow, LodView, run_lod};
pub use measure::{BenchError, Stage, Subject, run};
pub use report::{Bytes, CameraReport, Counts, Ratio, Report, SceneReport};
