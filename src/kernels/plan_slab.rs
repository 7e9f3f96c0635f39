//! Chooses the next depth slab: one work-group. See `glsl/plan_slab.comp`.

pub use crate::gpu::interface::plan_slab::{Bindings, Params, PlanSlab};
