#version 460
// Last of three scan passes: writes the exclusive prefix of every element. Grid: one work-group per block.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "workgroup_scan.glsl"
#include "scan_values.glsl"

layout(scalar, binding = 3) readonly buffer BlockSums { uint block_sums[]; };  // exclusive prefix per block
layout(scalar, binding = 4) writeonly buffer Offsets { uint offsets[]; };      // exclusive prefix per element

void main() {
    const uint per_thread = BLOCK_SIZE / WORKGROUP_SIZE;
    uint n = scan_length();
    uint block = group_index();
    uint first = block * BLOCK_SIZE + subgroup_thread() * per_thread;
    uint sum = 0;
    for (uint k = 0; k < per_thread; ++k) sum = add_saturating(sum, scan_value(first + k, n));
    uint total;
    uint running = workgroup_exclusive_sum(sum, total);
    if (block * BLOCK_SIZE < n) running = add_saturating(running, block_sums[block]);
    for (uint k = 0; k < per_thread; ++k) {
        if (first + k < n) offsets[first + k] = running;
        running = add_saturating(running, scan_value(first + k, n));
    }
}
