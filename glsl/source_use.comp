#version 460
// How much every source Gaussian is used: the number of instances that have it, and its largest opacity logit in any of
// them. What densification decides by, where scenes have templates.
//
// - Reads, per chunk of source Gaussians, its template's instances; for each Gaussian its logit and the offsets to it.
// - Writes `uses` and `highest_logits`; a logit that is not finite in an instance does not count there. Gaussians of no
//   template keep what the buffers held before.
// - Grid: one work-group per chunk. Bytes per Gaussian: 4 read, 4 more per instance with offsets, 8 written.
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
layout(scalar, push_constant) uniform SourceUseParams {
    uint chunk_count;  // chunks of source Gaussians
};

void main() {
    uint c = group_index();
    if (c >= chunk_count) return;
    SourceChunk chunk = source_chunks[c];
    uint local = chunk.chunk * WORKGROUP_SIZE + gl_LocalInvocationID.x;
    if (local >= chunk.source_count) return;
    uint source = chunk.first_source + local;
    float logit = opacity_logits[source];
    float highest = logit;
    for (uint i = 0; i < chunk.instance_count; ++i) {
        uint first_offset = instances[instance_from_template[chunk.first_instance + i]].first_offset;
        float own = logit;
        if (first_offset != NO_OFFSET) own += offset_opacity_logits[first_offset + local];
        if (i == 0 || own > highest) highest = own;
    }
    uses[source] = chunk.instance_count;
    highest_logits[source] = highest;
}
