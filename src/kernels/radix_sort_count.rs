//! Digit counts per block: one work-group per block (indirect). See `glsl/radix_sort_count.comp`.

pub use crate::gpu::interface::radix_sort_count::{Bindings, Params, RadixSortCount};
