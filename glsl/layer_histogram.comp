#version 460
// Counts the chunks of visible instances by their nearest depth: the first of two passes that choose a frame's depth layers.
//
// - Reads what `cull_chunks` reads: `candidate_offsets`, `instances`, `chunks` and `counters`.
// - Writes `layer_bins` (by bin, which must be 0 before): the chunks in view whose nearest splat has a depth in the bin. A bin is
//   an eighth of an octave of depth: the upper bits of an f32.
// - Grid: one thread per candidate, indirect (`FAMILY_CANDIDATES`, `ARGS_THREADS`).
// - Bytes per candidate: as `cull_chunks`, and one atomic addition.
// - Guarantees: sums of integers, which do not depend on the order of additions. Chunks without a finite depth count as near.
//
// Twin: `instgs_reference::layers`. Test: `tests/kernels/layers.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "numbers.glsl"
#include "scene.glsl"

layout(scalar, binding = 0) readonly buffer Instances { Instance instances[]; };             // instances, background last
layout(scalar, binding = 1) readonly buffer Chunks { Chunk chunks[]; };                      // bounds of template chunks
layout(scalar, binding = 2) readonly buffer CandidateOffsets { uint candidate_offsets[]; };  // exclusive scan of instance_chunks
layout(scalar, binding = 3) readonly buffer Counters { uint counters[]; };                   // COUNTER_*
layout(scalar, binding = 4) buffer LayerBins { uint layer_bins[]; };                         // chunks by depth
layout(scalar, push_constant) uniform LayerHistogramParams {
    View view;            // the camera
    uint instance_count;  // instances, background included
};
#include "candidate.glsl"

void main() {
    uint c = thread_index();
    if (c >= counters[COUNTER_CANDIDATES]) return;
    Reach reach = reach_of(candidate_at(c));
    if (outside_view(view, reach)) return;
    float nearest = reach.center.z - reach.radius;
    uint bits = is_finite(nearest) ? floatBitsToUint(max(nearest, 0.0)) : 0;
    atomicAdd(layer_bins[bits / LAYER_BIN_BITS], 1);
}
