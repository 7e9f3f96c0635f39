//! Writes (tile, slot) pairs in depth order: one thread per splat (indirect). See `glsl/emit_intersections.comp`.

pub use crate::gpu::interface::emit_intersections::{Bindings, EmitIntersections, Params};
