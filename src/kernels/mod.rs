//! The kernels. Each is a shader `glsl/<stem>.comp`; its leading comment is the documentation of the module of that
//! name: inputs, outputs, grid and guarantees. The module has the push constants `Params`, the buffers `Bindings`, the
//! compiled `SHADER` and a marker type for its pipeline, all generated from the GLSL (see `gpu::interface`). The
//! pipelines of the renderer and the trainer are in [`pipelines`].

pub mod every_pipeline;
pub mod pipelines;
pub mod scene_traits;
pub mod variant;

pub use crate::gpu::interface::shaders::*;
pub use every_pipeline::compile_every_pipeline;
pub use pipelines::{
    BackwardPipelines, DensifyPipelines, ExposurePipelines, MarkPipelines, McmcStepPipelines, Pipelines,
    PresentPipelines, PresentVariant, Primitives, Purpose, SegmentPipelines, SurfacePipelines,
};
pub use scene_traits::SceneTraits;
pub use variant::{Variant, open_tuned};
