//! Makes the survivors of all work items one dense list of (depth key, slot), in flat order (DESIGN section 3, pass 2:
//! count, scan, write).
//!
//! - Reads `survivor_counts` and their exclusive scan `survivor_offsets` (by work item), the view depth in `splats` (by
//!   slot = `work item * WORKGROUP_SIZE + rank`), and `counters`.
//! - Writes `depth_keys` and `slots` (by place in the list, `0..COUNTER_VISIBLE`): what the depth sort starts from.
//! - Grid: one work-group per work item, indirect (`FAMILY_WORK_ITEMS`, `ARGS_ITEMS`); thread j moves the survivor of
//!   rank j.
//! - Bytes per survivor: 4 read (out of a 40-byte record), 8 written. Per work item: 8 read.
//! - Guarantees: places come from a scan, so the list is in flat order and the stable sort breaks ties in depth by it.
//!   The list cannot overflow: its buffers have one element per slot.
//! - The key is the bit pattern of the f32 depth. Its unsigned order is the order of depths because depth > near >= 0.
//!
//! Twin: `reference::compact`, with `reference::radix_sort::depth_key` for the key. Tested through the whole frame:
//! `tests/kernels/intersections.rs`, `forward.rs`.

pub use crate::gpu::interface::compact_visible::{Bindings, CompactVisible};
