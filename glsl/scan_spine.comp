#version 460
// Second of three scan passes: one work-group scans the block sums in place, writes the total to the counters and the
// indirect arguments of what comes next. Grid: one work-group.
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
