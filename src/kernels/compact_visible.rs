//! Makes survivors a dense list: one work-group per work item (indirect). See `glsl/compact_visible.comp`.

pub use crate::gpu::interface::compact_visible::{Bindings, CompactVisible};
