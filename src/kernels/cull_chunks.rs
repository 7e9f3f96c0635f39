//! Tests chunks of visible instances against the view: one thread per candidate (indirect). See `glsl/cull_chunks.comp`.

pub use crate::gpu::interface::cull_chunks::{Bindings, CullChunks, Params};
