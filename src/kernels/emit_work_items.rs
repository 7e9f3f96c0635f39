//! Makes visible candidates a dense list: one thread per candidate (indirect). See `glsl/emit_work_items.comp`.

pub use crate::gpu::interface::emit_work_items::{Bindings, EmitWorkItems, Params};
