//! Lists the new Gaussians: `origins` (which old one each comes from) and `made` (how, `MADE_*`).
//!
//! - Reads `counts`, their exclusive scan `firsts`, and `growths`, all by old Gaussian.
//! - The old order is kept. A copy comes right after its original; children stand where their parent stood.
//! - Grid: one thread per old Gaussian. Bytes: 12 read per old Gaussian, 8 written per new one.
//!
//! Twin: `reference::densify`. Test: `tests/kernels/densify.rs`.

pub use crate::gpu::interface::densify_place::{Bindings, DensifyPlace, Params};
