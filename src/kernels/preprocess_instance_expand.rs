//! Eq. 6, projection, culling, colour: one work-group per work item (indirect). See `glsl/preprocess_instance_expand.comp`.

pub use crate::gpu::interface::preprocess_instance_expand::{Bindings, Params, PreprocessInstanceExpand};
