#version 460
// First of three scan passes: sums blocks of BLOCK_SIZE values. Grid: one work-group per block.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "workgroup_scan.glsl"
#include "scan_values.glsl"

layout(scalar, binding = 3) writeonly buffer BlockSums { uint block_sums[]; };  // sum per block

void main() {
    uint n = scan_length();
    uint block = group_index();
    uint sum = 0;
    for (uint k = gl_LocalInvocationID.x; k < BLOCK_SIZE; k += WORKGROUP_SIZE) {
        sum = add_saturating(sum, scan_value(block * BLOCK_SIZE + k, n));
    }
    uint total;
    workgroup_exclusive_sum(sum, total);
    if (gl_LocalInvocationID.x == 0 && block * BLOCK_SIZE < n) block_sums[block] = total;
}
