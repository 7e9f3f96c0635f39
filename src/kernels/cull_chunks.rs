//! Tests every chunk of the instances that `cull_instances` kept against the view (DESIGN section 3, pass 1).
//!
//! A candidate is one (instance, chunk) pair; a chunk is `WORKGROUP_SIZE` consecutive Gaussians of a template or of the
//! background. The test is that of `cull_instances` with the ball and the largest standard deviation of the chunk
//! alone.
//!
//! - Reads `candidate_offsets` (by instance: exclusive scan of `instance_chunks`) to find the owner by bisection, then
//!   `instances` (by instance) and `chunks` (by `first_chunk` + chunk), and `counters`.
//! - Writes `candidate_visible` (0 or 1) and `candidates` (the pair), both by candidate.
//! - Grid: one thread per candidate, indirect (`FAMILY_CANDIDATES`, `ARGS_THREADS`).
//! - Bytes per candidate: 144 read (124 instance of which 60 are used, 20 chunk) and 4 per step of the bisection, about
//!   log2(instances) steps; 12 written.
//! - Guarantees: conservative, as in `cull_instances`. Candidates follow instance order, then chunk order, which is
//!   flat order; instances without candidates share an offset with their successor and are never found. Candidates
//!   beyond the capacity are not tested, but `COUNTER_CANDIDATES_NEEDED` keeps their number and the host redoes the
//!   frame.
//!
//! Twin: `reference::cull_chunks`, by brute force over pixels: the work list must contain all it finds and may contain
//! more. Tests: `tests/kernels/cull_chunks.rs`, `scale.rs`.

pub use crate::gpu::interface::cull_chunks::{Bindings, CullChunks, Params};
