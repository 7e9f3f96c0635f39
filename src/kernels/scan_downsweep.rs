//! Writes the exclusive prefixes of a scan: one work-group per block. See `glsl/scan_downsweep.comp`.

pub use crate::gpu::interface::scan_downsweep::{Bindings, Params, ScanDownsweep};
