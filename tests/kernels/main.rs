//! GPU tests: every kernel against its f64 twin, the whole forward pass against twin and golden files. Run at several
//! subgroup sizes by tools/test (on lavapipe: LP_NATIVE_VECTOR_WIDTH=128/256/512 for 4/8/16).

#![allow(clippy::print_stdout, reason = "tests report what they measured with --nocapture")]

#[path = "../common/mod.rs"]
mod common;

mod adam;
mod ahead;
mod backward;
mod cull_chunks;
mod densify;
mod densify_own;
mod embedding;
mod exposure;
mod finish;
mod forward;
mod image_loss;
mod intersections;
mod layers;
mod lod;
mod mask_contribution;
mod mcmc;
mod overflow;
mod packed;
mod paged;
mod pipelines;
mod plan_slab;
mod poison;
mod poison_backward;
mod poses;
mod preprocess_instance_expand;
mod present;
mod pruning;
mod radix_sort;
mod recycle;
mod scale;
mod scan;
mod sensitivity;
mod source_windows;
mod tile_marks;
mod tile_surface;
mod train_steps;
