#version 460
// Sums the gradients with respect to the colour matrices of instances, in scenes that have them.
//
// - Reads, per instance, the work items of its chunks that were not culled (as `gather_gradients` does), and there the `color_terms`
//   of each Gaussian (24 bytes).
// - Writes `color_from_template_gradients`, 48 bytes per instance; 0 for an instance out of sight.
// - Grid: one work-group per row of an instance besides the background; those of own Gaussians have no matrix. Each thread sums Gaussians of its own; three threads then sum the
//   threads, one for each row, so that the order is always the same.
//
// Twin: `instgs_reference::gather_gradients`. Test: `tests/kernels/backward.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "counters.glsl"
#include "scene.glsl"
#include "gradients.glsl"

layout(scalar, binding = 0) readonly buffer InstanceChunks { uint instance_chunks[]; };              // chunks per instance, 0 if out of sight
layout(scalar, binding = 1) readonly buffer CandidateOffsets { uint candidate_offsets[]; };          // first candidate per instance
layout(scalar, binding = 2) readonly buffer CandidateVisible { uint candidate_visible[]; };          // 1 if the candidate became a work item
layout(scalar, binding = 3) readonly buffer WorkOffsets { uint work_offsets[]; };                    // work item of the candidate
layout(scalar, binding = 4) readonly buffer Counters { uint counters[]; };                           // COUNTER_*
layout(scalar, binding = 5) readonly buffer Instances { Instance instances[]; };                     // instances, background last
layout(scalar, binding = 6) readonly buffer ColorTermLists { ColorTerms color_terms[]; };            // by work item times work-group size plus index in the chunk; 0 if not drawn
layout(scalar, binding = 7) writeonly buffer ColorMatrixGradients { vec4 color_from_template_gradients[]; };  // rows of (M | b) by instance
layout(scalar, push_constant) uniform GatherColorGradientsParams {
    uint posed_rows;  // rows of instances besides the background
};

#include "work_item_of.glsl"

shared vec4 partial_sums[3 * WORKGROUP_SIZE];

void main() {
    uint k = group_index();
    uint lane = gl_LocalInvocationID.x;
    if (k >= posed_rows) return;
    Instance instance = instances[k];
    if (instance.color == NO_COLOR) return;
    vec4 rows[3];
    [[unroll]] for (uint r = 0; r < 3; ++r) rows[r] = vec4(0.0);
    for (uint chunk = 0; chunk < instance_chunks[k]; ++chunk) {
        uint w = work_item_of(k, chunk);
        if (w == NO_WORK_ITEM) continue;
        ColorTerms terms = color_terms[w * WORKGROUP_SIZE + lane];
        vec4 extended = vec4(terms.color, 1.0);
        [[unroll]] for (uint r = 0; r < 3; ++r) {
            vec4 row = terms.cotangent[r] * extended;
            if (all(is_below(row, GRADIENT_MAX))) rows[r] += row;
        }
    }
    [[unroll]] for (uint r = 0; r < 3; ++r) partial_sums[3 * lane + r] = rows[r];
    barrier();
    // A thread for each row.
    if (lane >= 3) return;
    vec4 sum = vec4(0.0);
    for (uint t = 0; t < WORKGROUP_SIZE; ++t) sum += partial_sums[3 * t + lane];
    color_from_template_gradients[3 * instance.color + lane] = sum;
}
