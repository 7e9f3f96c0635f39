#version 460
// Makes the survivors of all work items one dense list of (depth key, slot), in flat-index order.
// Grid: one work-group per work item (indirect).
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "splat.glsl"

layout(scalar, binding = 0) readonly buffer Splats { Splat splats[]; };                     // projected survivors
layout(scalar, binding = 1) readonly buffer SurvivorCounts { uint survivor_counts[]; };     // survivors per work item
layout(scalar, binding = 2) readonly buffer SurvivorOffsets { uint survivor_offsets[]; };   // exclusive scan of the counts
layout(scalar, binding = 3) readonly buffer Counters { uint counters[]; };                  // COUNTER_*
layout(scalar, binding = 4) writeonly buffer DepthKeys { uint depth_keys[]; };              // bits of the view depth: ordered, since depth > near >= 0
layout(scalar, binding = 5) writeonly buffer Slots { uint slots[]; };                       // slot of the survivor

void main() {
    uint w = group_index();
    uint lane = gl_LocalInvocationID.x;
    if (w >= counters[COUNTER_WORK_ITEMS] || lane >= survivor_counts[w]) return;
    uint slot = w * WORKGROUP_SIZE + lane;
    uint i = survivor_offsets[w] + lane;
    depth_keys[i] = floatBitsToUint(splats[slot].c.y);
    slots[i] = slot;
}
