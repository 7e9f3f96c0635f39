//! Tests instances against the view: one thread per instance. See `glsl/cull_instances.comp`.

pub use crate::gpu::interface::cull_instances::{Bindings, CullInstances, Params};
