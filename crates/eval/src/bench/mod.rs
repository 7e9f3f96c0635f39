//! L6: measurements of rendering, and their reports. The command line is in `cli/bench.rs`.

mod lod;
mod measure;
mod report;

pub use lod::{LodCamera, LodError, LodReport, LodRow, LodView, run_lod};
pub use measure::{BenchError, Stage, Subject, run};
pub use report::{Bytes, CameraReport, Counts, Ratio, Report, SceneReport};
