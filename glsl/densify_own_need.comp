#version 460
// Finds the template Gaussians that call for growth in a few of their instances only. What they lack belongs to these
// instances, which then get Gaussians of their own instead of all instances getting one more.
//
// - Reads, per chunk of source Gaussians, its template's instances, and `record_statistics` of their offset records.
// - An instance needs growth where the mean screen gradient of its record reaches `gradient_threshold`. If at most
//   `own_share` of the instances do, `own_counts` is their number, `own_gradients` the mean over them, and `needs` is 1 in
//   their records; else `own_counts` is 0. `needs` must hold zeros before.
// - Gaussians with a single instance need no decision: they grow as they are.
// - Grid: one work-group per chunk. Bytes per Gaussian: 8 per instance read, 8 written, 4 more per instance that needs growth.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify_own.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "counters.glsl"
#include "scene.glsl"
#include "gradients.glsl"

layout(scalar, binding = 0) readonly buffer SourceChunks { SourceChunk source_chunks[]; };          // all chunks of the source pool
layout(scalar, binding = 1) readonly buffer InstanceLists { uint instance_from_template[]; };       // rows, template by template
layout(scalar, binding = 2) readonly buffer Instances { Instance instances[]; };                    // rows of instances, background last
layout(scalar, binding = 3) readonly buffer RecordStatistics { vec2 record_statistics[]; };         // sum of screen gradients, number of views that show it, by offset record
layout(scalar, binding = 4) writeonly buffer OwnCounts { uint own_counts[]; };                      // instances that need growth alone, by source
layout(scalar, binding = 5) writeonly buffer OwnGradients { float own_gradients[]; };               // their mean screen gradient, by source
layout(scalar, binding = 6) writeonly buffer Needs { uint needs[]; };                               // 1 if the instance needs growth alone, by offset record
layout(scalar, push_constant) uniform DensifyOwnNeedParams {
    uint chunk_count;          // chunks of source Gaussians
    float gradient_threshold;  // mean screen gradient from which Gaussians grow
    float own_share;           // largest part of the instances that grow alone
};

bool needs_growth(Instance instance, uint local) {
    if (instance.first_offset == NO_OFFSET) return false;
    vec2 statistics = record_statistics[instance.first_offset + local];
    // A product, not a quotient: GLSL rounds products as IEEE does, but not quotients.
    return is_finite(statistics.x) && statistics.y > 0.0 && statistics.x >= gradient_threshold * statistics.y;
}

void main() {
    uint c = group_index();
    if (c >= chunk_count) return;
    SourceChunk chunk = source_chunks[c];
    uint local = chunk.chunk * WORKGROUP_SIZE + gl_LocalInvocationID.x;
    if (local >= chunk.source_count) return;
    uint count = 0;
    vec2 sum = vec2(0.0);
    for (uint i = 0; i < chunk.instance_count; ++i) {
        Instance instance = instances[instance_from_template[chunk.first_instance + i]];
        if (!needs_growth(instance, local)) continue;
        ++count;
        sum += record_statistics[instance.first_offset + local];
    }
    bool alone = count > 0 && chunk.instance_count > 1 && float(count) <= own_share * float(chunk.instance_count);
    uint source = chunk.first_source + local;
    own_counts[source] = alone ? count : 0;
    own_gradients[source] = alone ? sum.x / sum.y : 0.0;
    for (uint i = 0; alone && i < chunk.instance_count; ++i) {
        Instance instance = instances[instance_from_template[chunk.first_instance + i]];
        if (needs_growth(instance, local)) needs[instance.first_offset + local] = 1;
    }
}
