//! Second of the three passes of an exclusive scan: scans the block sums, and publishes the total.
//!
//! - Reads and writes `block_sums` (by block): sums in, exclusive prefixes out.
//! - Writes to `counters`: the total, limited to `scan.capacity`, in `scan.total_slot`, and the unlimited one in
//!   `scan.needed_slot`. Writes to `args` the four argument sets of `scan.family`, made from the limited total: one
//!   work-group per element, one thread per element, one work-group per block, and the blocks of its radix histogram.
//!   Each of the three is left out on request.
//! - Grid: one work-group, which walks the blocks in rounds of `WORKGROUP_SIZE` with a running sum.
//! - Bytes per block: 4 read, 4 written; 8 for the counters and 48 for the arguments.
//! - Guarantees: sums saturate at 2^32 - 1, so a total that overflowed reads as too large and never as small. The next
//!   passes get their size on the device, within the capacity of their buffers; the host compares the unlimited total
//!   with it after the frame. Arguments fold more than 65535 work-groups into rows and are zero for no elements.
//! - Argument sets assume consumers with this kernel's `WORKGROUP_SIZE`, as all element-wise kernels of a variant have.
//!
//! Twin: `reference::scan`. Tests: `tests/kernels/scan.rs` (totals, limits and arguments), `overflow.rs`.

pub use crate::gpu::interface::scan_spine::{Bindings, Params, ScanSpine};
