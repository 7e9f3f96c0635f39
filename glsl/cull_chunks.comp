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
// - Bytes per candidate: 152 read (132 instance of which 60 are used, 20 chunk) and 4 per step of the bisection, about
//   log2(instances) steps; 12 written.
// - Guarantees: conservative, as in `cull_instances`. Candidates follow instance order, then chunk order, which is
//   flat order; instances without candidates share an offset with their successor and are never found. Candidates
//   beyond the capacity are not tested, but `COUNTER_CANDIDATES_NEEDED` keeps their number and the host redoes the
//   frame.
// - LAYERED: chunks without a depth in the layer are culled, and in all layers but the first those of which every tile is
//   closed. The tiles are those of a box around the ball; the bounds of depth are those of the ball.
//
// Twin: `instgs_reference::cull_chunks`, by brute force over pixels: the work list must contain all it finds and may contain
// more. Tests: `tests/kernels/cull_chunks.rs`, `scale.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "numbers.glsl"
#include "scene.glsl"

layout(scalar, binding = 0) readonly buffer Instances { Instance instances[]; };            // instances, background last
layout(scalar, binding = 1) readonly buffer Chunks { Chunk chunks[]; };                     // bounds of template chunks
layout(scalar, binding = 2) readonly buffer CandidateOffsets { uint candidate_offsets[]; };  // exclusive scan of instance_chunks
layout(scalar, binding = 3) readonly buffer Counters { uint counters[]; };                  // COUNTER_*
layout(scalar, binding = 4) writeonly buffer CandidateVisible { uint candidate_visible[]; };  // 1 if the candidate may be visible
layout(scalar, binding = 5) writeonly buffer Candidates { WorkItem candidates[]; };         // instance and chunk of the candidate
layout(scalar, binding = 6) readonly buffer ClosedRuns { uint closed_runs[]; };             // LAYERED: closed tiles to the right
layout(scalar, push_constant) uniform CullChunksParams {
    View view;            // the camera
    uint instance_count;  // instances, background included
};

#include "candidate.glsl"
#include "splat.glsl"
#include "layers.glsl"

// True if every tile that splats of the ball may touch is closed. NaN hides nothing.
bool hidden(Reach r) {
    float z_near = max(r.center.z - r.radius, view.near);
    float z_far = r.center.z + r.radius;
    vec2 low = view.focal_px * (r.center.xy - r.radius) - r.reach;
    vec2 high = view.focal_px * (r.center.xy + r.radius) + r.reach;
    low /= vec2(low.x < 0.0 ? z_near : z_far, low.y < 0.0 ? z_near : z_far);
    high /= vec2(high.x < 0.0 ? z_far : z_near, high.y < 0.0 ? z_far : z_near);
    low += view.principal_px - r.border;
    high += view.principal_px + r.border;
    if (!all(is_below(vec4(low, high), 1e30))) return false;
    vec2 size = vec2(view.size_px);
    uvec2 first = uvec2(clamp(low, vec2(0.0), size)) / TILE_SIZE;
    uvec2 tiles = (view.size_px + TILE_SIZE - 1) / TILE_SIZE;
    uvec2 end = min(uvec2(clamp(high, vec2(0.0), size)) / TILE_SIZE + 1, tiles);
    for (uint row = first.y; row < end.y; ++row) {
        if (first.x < end.x && closed_runs[row * tiles.x + first.x] < end.x - first.x) return false;
    }
    return true;
}

// True if the ball has a depth of the layer. NaN is in every layer.
bool reaches_layer(Reach r, uint layer) {
    float far = r.center.z + r.radius;
    float near = r.center.z - r.radius;
    return !(far < uintBitsToFloat(counters[COUNTER_LAYER_BEGIN + layer])) && !(near >= uintBitsToFloat(counters[COUNTER_LAYER_BEGIN + layer + 1]));
}

void main() {
    uint c = thread_index();
    if (c >= counters[COUNTER_CANDIDATES]) return;
    WorkItem candidate = candidate_at(c);
    Reach reach = reach_of(candidate);
    bool culled = outside_view(view, reach);
    if (LAYERED != 0 && !culled) {
        uint layer = counters[COUNTER_LAYER];
        culled = !reaches_layer(reach, layer) || (layer > 0 && hidden(reach));
    }
    candidate_visible[c] = culled ? 0 : 1;
    candidates[c] = candidate;
}
