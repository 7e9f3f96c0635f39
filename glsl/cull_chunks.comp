#version 460
// Tests the chunks of visible instances against the view. Reads instances, chunks, the scanned chunk counts; writes one
// flag per candidate. Grid: one thread per candidate (indirect).
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "scene.glsl"

layout(scalar, binding = 0) readonly buffer Instances { Instance instances[]; };            // instances, background last
layout(scalar, binding = 1) readonly buffer Chunks { Chunk chunks[]; };                     // bounds of template chunks
layout(scalar, binding = 2) readonly buffer CandidateOffsets { uint candidate_offsets[]; };  // exclusive scan of instance_chunks
layout(scalar, binding = 3) readonly buffer Counters { uint counters[]; };                  // COUNTER_*
layout(scalar, binding = 4) writeonly buffer CandidateVisible { uint candidate_visible[]; };  // 1 if the candidate may be seen
layout(scalar, binding = 5) writeonly buffer Candidates { WorkItem candidates[]; };         // what each candidate is
layout(scalar, push_constant) uniform CullChunksParams {
    View view;            // the camera
    uint instance_count;  // instances, background included
};

// The instance that owns candidate `c`: the last whose offset is <= c (those with zero chunks share offsets and are skipped).
uint owner_of(uint c) {
    uint low = 0;
    uint high = instance_count;
    while (high - low > 1) {
        uint middle = (low + high) / 2;
        bool left = candidate_offsets[middle] > c;
        high = left ? middle : high;
        low = left ? low : middle;
    }
    return low;
}

void main() {
    uint c = thread_index();
    if (c >= counters[COUNTER_CANDIDATES]) return;
    uint i = owner_of(c);
    uint chunk_index = c - candidate_offsets[i];
    Instance instance = instances[i];
    Chunk chunk = chunks[instance.first_chunk + chunk_index];
    float radius = chunk.radius + instance.max_offset;
    float sigma = chunk.sigma_max * instance.sigma_growth;
    bool culled = outside_view(view, instance.world_from_template, instance.scale, chunk.center, radius, sigma);
    candidate_visible[c] = culled ? 0 : 1;
    candidates[c] = WorkItem(i, chunk_index);
}
