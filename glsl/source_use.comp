#version 460
// How every source Gaussian is used: the number of instances that have it, its largest opacity logit in any of them, and
// the largest scale of an instance. What densification decides by, where scenes have templates.
//
// - Reads, per chunk of source Gaussians, its template's instances; for each Gaussian its logit and the offsets to it.
// - Writes `uses`, `highest_logits` and `log_world_scales`; a logit that is not finite in an instance does not count there.
//   Gaussians of no template keep what the buffers held before.
// - Grid: one work-group per chunk. Bytes per Gaussian: 4 read, 4 more per instance with offsets, 12 written.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "scene.glsl"
#include "gradients.glsl"

layout(scalar, binding = 0) readonly buffer SourceChunks { SourceChunk source_chunks[]; };       // all chunks of the source pool
layout(scalar, binding = 1) readonly buffer InstanceLists { uint instance_from_template[]; };    // instances, template by template
layout(scalar, binding = 2) readonly buffer Instances { Instance instances[]; };                 // instances, background last
layout(scalar, binding = 3) readonly buffer OpacityLogits { float opacity_logits[]; };           // by source
layout(scalar, binding = 4) readonly buffer OffsetLogits { float offset_opacity_logits[]; };     // by offset record
layout(scalar, binding = 5) writeonly buffer Uses { uint uses[]; };                              // number of instances, by source
layout(scalar, binding = 6) writeonly buffer HighestLogits { float highest_logits[]; };          // largest logit in any instance, by source
layout(scalar, binding = 7) writeonly buffer LogWorldScales { float log_world_scales[]; };       // log of the largest scale of an instance, by source
layout(scalar, push_constant) uniform SourceUseParams {
    uint chunk_count;  // chunks of source Gaussians
};

const float LARGEST = 3.402823466e38;  // the largest finite f32

void main() {
    uint c = group_index();
    if (c >= chunk_count) return;
    SourceChunk chunk = source_chunks[c];
    uint local = chunk.chunk * WORKGROUP_SIZE + gl_LocalInvocationID.x;
    if (local >= chunk.source_count) return;
    uint source = chunk.first_source + local;
    float logit = opacity_logits[source];
    float highest = chunk.instance_count == 0 ? logit : -LARGEST;
    float largest_scale = 0.0;
    for (uint i = 0; i < chunk.instance_count; ++i) {
        Instance instance = instances[instance_from_template[chunk.first_instance + i]];
        float own = logit;
        if (instance.first_offset != NO_OFFSET) own += offset_opacity_logits[instance.first_offset + local];
        if (own > highest && own <= LARGEST) highest = own;
        // Columns of a similarity have the same length.
        vec3 column = vec3(instance.world_from_template[0].x, instance.world_from_template[1].x, instance.world_from_template[2].x);
        largest_scale = max(largest_scale, length(column));
    }
    uses[source] = chunk.instance_count;
    highest_logits[source] = highest;
    log_world_scales[source] = largest_scale > 0.0 ? log(largest_scale) : 0.0;
}
