//! Sums the blocks of a scan: one work-group per block. See `glsl/scan_reduce.comp`.

pub use crate::gpu::interface::scan_reduce::{Bindings, Params, ScanReduce};
