#version 460
// Writes the visible candidates as a dense list, in order. Grid: one thread per candidate (indirect).
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "scene.glsl"

layout(scalar, binding = 0) readonly buffer Candidates { WorkItem candidates[]; };            // all candidates
layout(scalar, binding = 1) readonly buffer CandidateVisible { uint candidate_visible[]; };   // 1 if the candidate may be seen
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
