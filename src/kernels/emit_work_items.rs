//! Writes the visible candidates as a dense list of work items, in their order (DESIGN section 3, pass 1).
//!
//! - Reads `candidate_visible`, its exclusive scan `work_offsets`, and `candidates` (all by candidate), and `counters`.
//! - Writes `work_items` (by work item, `0..COUNTER_WORK_ITEMS`).
//! - Grid: one thread per candidate, indirect (`FAMILY_CANDIDATES`, `ARGS_THREADS`).
//! - Bytes per candidate: 8 read; 8 more read and 8 written if it is visible.
//! - Guarantees: an ordered compaction without atomics: work items follow flat order, whatever the device does in
//!   parallel. Nothing is written beyond `capacity`; the scan has stored the full number in
//!   `COUNTER_WORK_ITEMS_NEEDED`, and the host enlarges the buffers and redoes the frame if it is larger.
//!
//! Twin: `reference::compact`. Test: `tests/kernels/cull_chunks.rs` (order and completeness of the work list).

pub use crate::gpu::interface::emit_work_items::{Bindings, EmitWorkItems, Params};
