//! The program `instgs-evidence`, called through `instgs-vk` as a user does.

#[path = "../common/program.rs"]
#[allow(dead_code, reason = "other tests use more of it")]
mod program;

mod synth;
