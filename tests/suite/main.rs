//! The command line and the libraries; the kernels, the player and the data sets have tests of their own. One program, since each
//! would link all libraries: 23 of them took 2.4 GB and a minute of linking.

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "tests say what they measured, and that they were skipped"
)]

#[path = "../common/mod.rs"]
mod common;

mod architecture;
mod boxes;
mod cases;
mod cli;
mod cli_blocks;
mod cli_disturbed;
mod cli_edit;
mod cli_eval;
mod cli_export;
mod cli_instanced;
mod cli_lod;
mod cli_masks;
mod cli_new_run;
mod cli_pages;
mod cli_shell;
mod cli_stages;
mod cli_train;
mod consensus;
#[cfg(unix)]
mod crash_disk;
#[cfg(unix)]
mod crash_kills;
#[cfg(feature = "onnx")]
mod detect;
#[cfg(feature = "onnx")]
mod detect_runs;
mod disturbed;
mod docs;
mod examples;
mod faults;
mod find;
mod find_wall;
mod golden_gradients;
mod golden_reference;
mod gradients;
mod interface;
mod io_bad_input;
mod io_datasets;
mod io_glb;
mod io_own_datasets;
mod io_real_files;
mod made_once;
#[cfg(feature = "onnx")]
mod onnx;
mod paddock;
mod register;
mod register_render;
mod segment;
mod stage_pictures;
mod template;
mod template_offsets;
