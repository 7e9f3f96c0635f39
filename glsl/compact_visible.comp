#version 460
// Compacts the survivors of all work items into a dense list of (depth key, slot), in flat order: the last of three
// passes, after counting the survivors and scanning the counts.
//
// - Reads `survivor_counts` and their exclusive scan `survivor_offsets` (by work item), the view depth in `splats` (by
//   slot = `work item * WORKGROUP_SIZE + rank`), and `counters`.
// - Writes `depth_keys` and `slots` (by index in the list, `0..COUNTER_VISIBLE`): the input of the depth sort.
// - Grid: one work-group per work item, indirect (`FAMILY_WORK_ITEMS`, `ARGS_ITEMS`); thread j moves the survivor of
//   rank j.
// - Bytes per survivor: 4 read (out of a 40-byte record), 8 written. Per work item: 8 read.
// - Guarantees: indices come from a scan, so the list is in flat order and the stable sort breaks ties in depth by it.
//   The list cannot overflow: its buffers have one element per slot.
// - The key is the bit pattern of the f32 depth. Its unsigned order is the order of depths because depth > near >= 0.
//
// Twin: `instgs_reference::compact`, with `instgs_reference::radix_sort::depth_key` for the key. Tested through the whole frame:
// `tests/kernels/intersections.rs`, `forward.rs`.
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
