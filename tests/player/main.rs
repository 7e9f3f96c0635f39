//! The player: what a person does, played by scripts in a window under a virtual display, and the scene viewer without a window.

#![allow(
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "tests that are skipped say so, and report what they measured with --nocapture"
)]

#[path = "../common/mod.rs"]
mod common;

mod crash;
mod frame_times;
mod pages;
mod scene_viewer;
mod scripts;
mod scripts_beside;
mod scripts_boxes;
mod scripts_panels;
