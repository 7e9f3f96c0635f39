//! Stable scatter by digit: one work-group per block (indirect). See `glsl/radix_sort_scatter.comp`.

pub use crate::gpu::interface::radix_sort_scatter::{Bindings, Params, RadixSortScatter};
