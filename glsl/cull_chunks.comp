#version 460
// Tests every chunk of the instances that `cull_instances` kept against the view.
//
// A candidate is one (instance, chunk) pair; a chunk is `WORKGROUP_SIZE` consecutive Gaussians of a template or of the
// background. The test is that of `cull_instances` with the ball and the largest standard deviation of the chunk
// alone.
//
// - Reads `candidate_offsets` (by instance: exclusive scan of `instance_chunks`) to find the owner by bisection, then
//   `instances` (by instance) and `chunks` (by `first_chunk` + chunk), and `counters`.
// - Writes `candidate_visible` (0 or 1) and `candidates` (the pair), both by candidate.
// - Grid: one thread per candidate, indirect (`FAMILY_CANDIDATES`, `ARGS_THREADS`).
// - Bytes per candidate: 144 read (124 instance of which 60 are used, 20 chunk) and 4 per step of the bisection, about
//   log2(instances) steps; 12 written.
// - Guarantees: conservative, as in `cull_instances`. Candidates follow instance order, then chunk order, which is
//   flat order; instances without candidates share an offset with their successor and are never found. Candidates
//   beyond the capacity are not tested, but `COUNTER_CANDIDATES_NEEDED` keeps their number and the host redoes the
//   frame.
//
// Twin: `instgs_reference::cull_chunks`, by brute force over pixels: the work list must contain all it finds and may contain
// more. Tests: `tests/kernels/cull_chunks.rs`, `scale.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "scene.glsl"

layout(scalar, binding = 0) readonly buffer Instances { Instance instances[]; };            // instances, background last
layout(scalar, binding = 1) readonly buffer Chunks { Chunk chunks[]; };                     // bounds of template chunks
layout(scalar, binding = 2) readonly buffer CandidateOffsets { uint candidate_offsets[]; };  // exclusive scan of instance_chunks
layout(scalar, binding = 3) readonly buffer Counters { uint counters[]; };                  // COUNTER_*
layout(scalar, binding = 4) writeonly buffer CandidateVisible { uint candidate_visible[]; };  // 1 if the candidate may be visible
layout(scalar, binding = 5) writeonly buffer Candidates { WorkItem candidates[]; };         // instance and chunk of the candidate
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
