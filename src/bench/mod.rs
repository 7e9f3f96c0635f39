//! L8: measurements of rendering, and the report they make. Parsing flags and printing is `cli/bench.rs`.

pub mod comparison;
pub mod evidence;
mod lod;
mod measure;
mod report;

pub use lod::{LodCamera, LodError, LodReport, LodRow, LodView, run_lod};
pub use measure::{BenchError, Stage, Subject, run};
#[cfg(feature = "player")]
pub(crate) use report::as_map;
pub use report::{Bytes, CameraReport, Counts, Ratio, Report, SceneReport};
