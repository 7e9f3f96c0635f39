//! L2: the kernels, one file per stem. The same word names `glsl/<stem>.comp`, the file here, the f64 twin in
//! `reference/`, the test and the profiler scope. Layouts are generated from the GLSL (see `gpu::interface`).

pub mod adam;
pub mod compact_visible;
pub mod cull_chunks;
pub mod cull_instances;
pub mod densify_mark;
pub mod densify_place;
pub mod densify_select;
pub mod densify_split;
pub mod emit_intersections;
pub mod emit_work_items;
pub mod gather_gradients;
pub mod gather_pose_gradients;
pub mod image_loss_backward_columns;
pub mod image_loss_backward_rows;
pub mod image_loss_columns;
pub mod image_loss_rows;
pub mod mask_contribution;
pub mod mcmc_gather_copies;
pub mod mcmc_noise;
pub mod mcmc_pick;
pub mod mcmc_regularise;
pub mod mcmc_share;
pub mod mcmc_weigh;
pub mod move_gaussians;
pub mod pipelines;
pub mod plan_slab;
pub mod preprocess_instance_expand;
pub mod preprocess_instance_expand_backward;
pub mod present;
pub mod radix_sort_count;
pub mod radix_sort_scatter;
pub mod refine_poses;
pub mod reset_opacity;
pub mod scan_downsweep;
pub mod scan_reduce;
pub mod scan_spine;
pub mod scene_traits;
pub mod tile_blend;
pub mod tile_blend_backward;
pub mod tile_marks;
pub mod tile_ranges;
pub mod tile_surface;
pub mod train_status;
pub mod variant;

pub use pipelines::{
    BackwardPipelines, DensifyPipelines, MarkPipelines, McmcStepPipelines, Pipelines, PresentPipelines, PresentVariant,
    Primitives, SegmentPipelines, SurfacePipelines,
};
pub use scene_traits::SceneTraits;
pub use variant::Variant;
