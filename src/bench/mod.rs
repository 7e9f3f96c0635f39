//! L6: measurements of rendering, and the report they make. Parsing flags and printing is `cli/bench.rs`.

pub mod comparison;
pub mod evidence;
mod measure;
mod report;
mod statistics;

pub use measure::{BenchError, Stage, Subject, run};
pub use report::{Bytes, CameraReport, Counts, Ratio, Report, SceneReport};
pub use statistics::{Percentiles, median};
