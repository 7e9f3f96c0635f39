//! Scans the block sums and writes totals and indirect arguments: one work-group. See `glsl/scan_spine.comp`.

pub use crate::gpu::interface::scan_spine::{Bindings, Params, ScanSpine};
