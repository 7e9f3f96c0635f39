#version 460
// Writes the visible candidates as a dense list of work items, in their order.
//
// - Reads `candidate_visible`, its exclusive scan `work_offsets`, and `candidates` (all by candidate), and `counters`.
// - Writes `work_items` (by work item, `0..COUNTER_WORK_ITEMS`).
// - Grid: one thread per candidate, indirect (`FAMILY_CANDIDATES`, `ARGS_THREADS`).
// - Bytes per candidate: 8 read; 8 more read and 8 written if it is visible.
// - Guarantees: an ordered compaction without atomics: work items follow flat order, however the device runs. Nothing
//   is written beyond `capacity`; the scan has stored the full number in `COUNTER_WORK_ITEMS_NEEDED`, and the host
//   enlarges the buffers and redoes the frame if it is larger.
//
// Twin: `instgs_reference::compact`. Test: `tests/kernels/cull_chunks.rs` (order and completeness of the work list).
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "scene.glsl"

layout(scalar, binding = 0) readonly buffer Candidates { WorkItem candidates[]; };            // all candidates
layout(scalar, binding = 1) readonly buffer CandidateVisible { uint candidate_visible[]; };   // 1 if the candidate may be visible
layout(scalar, binding = 2) readonly buffer WorkOffsets { uint work_offsets[]; };             // exclusive scan of candidate_visible
layout(scalar, binding = 3) readonly buffer Counters { uint counters[]; };                    // COUNTER_*
layout(scalar, binding = 4) writeonly buffer WorkItems { WorkItem work_items[]; };            // visible candidates
layout(scalar, push_constant) uniform EmitWorkItemsParams {
    uint capacity;  // elements of work_items
};

void main() {
    uint c = thread_index();
    if (c >= counters[COUNTER_CANDIDATES]) return;
    uint slot = work_offsets[c];
    if (candidate_visible[c] != 0 && slot < capacity) work_items[slot] = candidates[c];
}
