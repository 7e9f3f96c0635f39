//! instgs-vk: shared-template Gaussian instancing on raw Vulkan.
#![deny(clippy::print_stdout, clippy::print_stderr)]

pub mod bench;
pub mod cli;
pub mod gpu;
pub mod io;
pub mod kernels;
pub mod math;
pub mod reference;
pub mod render;
pub mod scene;
pub mod synth;
