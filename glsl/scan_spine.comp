#version 460
// Second of the three passes of an exclusive scan: scans the block sums, and publishes the total.
//
// - Reads and writes `block_sums` (by block): sums in, exclusive prefixes out.
// - Writes to `counters`: the total, limited to `scan.capacity`, in `scan.total_slot`, and the unlimited one in
//   `scan.needed_slot`. Writes to `args` the three argument sets of `scan.family`, made from the limited total: one
//   work-group per element, one thread per element, and one work-group per block. Each of the three outputs is left out
//   on request.
// - Grid: one work-group, which walks the blocks in rounds of `WORKGROUP_SIZE` with a running sum.
// - Bytes per block: 4 read, 4 written; 8 for the counters and 36 for the arguments.
// - Guarantees: sums saturate at 2^32 - 1, so a total that overflowed reads as too large and never as small. The next
//   passes get their size on the device, within the capacity of their buffers; the host compares the unlimited total
//   with it after the frame. Arguments fold more than 65535 work-groups into rows and are zero for no elements.
// - Argument sets assume consumers with this kernel's `WORKGROUP_SIZE`, as all element-wise kernels of a variant have.
//
// Twin: `instgs_reference::scan`. Tests: `tests/kernels/scan.rs` (totals, limits and arguments), `overflow.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "workgroup_scan.glsl"

layout(scalar, binding = 0) buffer BlockSums { uint block_sums[]; };         // sums in, exclusive prefixes out
layout(scalar, binding = 1) buffer Counters { uint counters[]; };            // COUNTER_*
layout(scalar, binding = 2) writeonly buffer Args { DispatchArgs args[]; };  // indirect arguments, by scan.family
#include "scan_params.glsl"
#include "write_args.glsl"

void main() {
    uint blocks = divide_up(scan_length(), BLOCK_SIZE);
    uint running = 0;
    for (uint base = 0; base < blocks; base += WORKGROUP_SIZE) {
        uint i = base + subgroup_thread();
        uint value = i < blocks ? block_sums[min(i, blocks - 1)] : 0;
        uint total;
        uint exclusive = workgroup_exclusive_sum(value, total);
        if (i < blocks) block_sums[i] = add_saturating(running, exclusive);
        running = add_saturating(running, total);
    }
    if (gl_LocalInvocationID.x != 0) return;
    uint limited = min(running, scan.capacity);
    if (scan.total_slot < COUNTER_COUNT) counters[scan.total_slot] = limited;
    if (scan.needed_slot < COUNTER_COUNT) counters[scan.needed_slot] = running;
    if (scan.family < FAMILY_COUNT) write_args(scan.family, limited);
}
