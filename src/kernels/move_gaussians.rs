//! Moves one array of f32, parameters or moments, to a new order of Gaussians.
//!
//! - `after[j] = before[origins[j]]`, `width` f32 each; zeros instead where `zero_made` is set and `made[j]` is not 0
//!   (moments of Gaussians that are not as they were).
//! - Grid: one thread per f32 of the new array. 8 bytes each, and 8 of the tables.
//!
//! Twin: `reference::densify`. Test: `tests/kernels/densify.rs`.

pub use crate::gpu::interface::move_gaussians::{Bindings, MoveGaussians, Params};
