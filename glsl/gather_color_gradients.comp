#version 460
// Sums the gradients with respect to the colour matrices of instances, in scenes that have them.
//
// - Reads, per instance, the work items of its chunks that were not culled (as `gather_gradients` does), and there the gradient with
//   respect to each Gaussian's colour (12 bytes) and its view direction, in which SH is evaluated again.
// - Writes `color_from_template_gradients`, 48 bytes per instance; 0 for an instance out of sight. With WINDOWED it adds what the
//   instance's chunks in the window give, to zeros at first.
// - Grid: one work-group per row of an instance besides the background; those of own Gaussians have no matrix. Each thread sums Gaussians of its own; three threads then sum the
//   threads, one for each row, so that the order is always the same.
//
// Twin: `instgs_reference::gather_gradients`. Test: `tests/kernels/backward.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "counters.glsl"
#include "scene.glsl"
#include "source_window.glsl"
#include "gradients.glsl"

layout(constant_id = 3) const uint SH_DEGREE = 3;

layout(scalar, binding = 0) readonly buffer InstanceChunks { uint instance_chunks[]; };              // chunks per instance, 0 if out of sight
layout(scalar, binding = 1) readonly buffer CandidateOffsets { uint candidate_offsets[]; };          // first candidate per instance
layout(scalar, binding = 2) readonly buffer CandidateVisible { uint candidate_visible[]; };          // 1 if the candidate became a work item
layout(scalar, binding = 3) readonly buffer WorkOffsets { uint work_offsets[]; };                    // work item of the candidate
layout(scalar, binding = 4) readonly buffer Counters { uint counters[]; };                           // COUNTER_*
layout(scalar, binding = 5) readonly buffer Instances { Instance instances[]; };                     // instances, background last
layout(scalar, binding = 6) readonly buffer LookGradients { LookGradient look_gradients[]; };        // by work item times work-group size plus index in the chunk; 0 if not drawn
layout(scalar, binding = 7) readonly buffer ColorCotangents { vec3 color_cotangents[]; };            // as look_gradients, by the colour after the matrix
layout(scalar, binding = 8) readonly buffer Sh0 { vec3 sh0[]; };                                     // source SH band 0, 1 per Gaussian
layout(scalar, binding = 9) readonly buffer Sh1 { vec3 sh1[]; };                                     // SH band 1, 3 per Gaussian of degree >= 1
layout(scalar, binding = 10) readonly buffer Sh2 { vec3 sh2[]; };                                    // SH band 2, 5 per Gaussian of degree >= 2
layout(scalar, binding = 11) readonly buffer Sh3 { vec3 sh3[]; };                                    // SH band 3, 7 per Gaussian of degree 3
layout(scalar, binding = 12) readonly buffer OffsetShDc { vec3 offset_sh_dc[]; };                    // offsets of SH coefficient 0
layout(scalar, binding = 13) readonly buffer OffsetShRest { vec3 offset_sh_rest[]; };                // offsets of the other SH coefficients, if any
layout(scalar, binding = 14) buffer ColorMatrixGradients { vec4 color_from_template_gradients[]; };  // rows of (M | b) by instance
layout(scalar, push_constant) uniform GatherColorGradientsParams {
    uint posed_rows;      // rows of instances besides the background
    SourceWindow window;  // WINDOWED: the source Gaussians that it sees
};

#include "sh_bands.glsl"
#include "sh_color.glsl"
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
    uint first_source = instance.first_source;
    enter_window(window, instance.first_source, instance.first_in_band);
    for (uint chunk = 0; chunk < instance_chunks[k]; ++chunk) {
        if (!in_window(window, first_source + chunk * WORKGROUP_SIZE)) continue;
        uint w = work_item_of(k, chunk);
        uint local = chunk * WORKGROUP_SIZE + lane;
        if (w == NO_WORK_ITEM || local >= instance.source_count) continue;
        vec3 by_color = color_cotangents[w * WORKGROUP_SIZE + lane];
        if (by_color == vec3(0.0)) continue;
        vec3 base = sh0[instance.first_source + local];
        if (instance.first_offset != NO_OFFSET) base += offset_sh_dc[instance.first_offset + local];
        vec4 extended = vec4(evaluate_sh(instance, local, base, look_gradients[w * WORKGROUP_SIZE + lane].direction), 1.0);
        [[unroll]] for (uint r = 0; r < 3; ++r) {
            vec4 row = by_color[r] * extended;
            if (all(is_below(row, GRADIENT_MAX))) rows[r] += row;
        }
    }
    [[unroll]] for (uint r = 0; r < 3; ++r) partial_sums[3 * lane + r] = rows[r];
    barrier();
    // A thread for each row.
    if (lane >= 3) return;
    vec4 sum = vec4(0.0);
    for (uint t = 0; t < WORKGROUP_SIZE; ++t) sum += partial_sums[3 * t + lane];
    uint row = 3 * instance.color + lane;
    color_from_template_gradients[row] = WINDOWED != 0 ? color_from_template_gradients[row] + sum : sum;
}
