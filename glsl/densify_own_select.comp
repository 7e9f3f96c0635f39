#version 460
// Takes back the needs of instances whose Gaussians may not grow, after `densify_select` has decided.
//
// - Reads, per chunk of source Gaussians, its template's instances, and `growths` of its Gaussians; updates `needs`.
// - Grid: one work-group per chunk. Bytes per Gaussian: 4 read, 4 per instance written where there is no growth.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify_own.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "scene.glsl"
#include "gradients.glsl"
#include "strategy.glsl"

layout(scalar, binding = 0) readonly buffer SourceChunks { SourceChunk source_chunks[]; };     // all chunks of the source pool
layout(scalar, binding = 1) readonly buffer InstanceLists { uint instance_from_template[]; };  // rows, template by template
layout(scalar, binding = 2) readonly buffer Instances { Instance instances[]; };               // rows of instances, background last
layout(scalar, binding = 3) readonly buffer Growths { uint growths[]; };                       // GROWTH_*, by source
layout(scalar, binding = 4) writeonly buffer Needs { uint needs[]; };                          // 1 if the instance gets a Gaussian of its own, by offset record
layout(scalar, push_constant) uniform DensifyOwnSelectParams {
    uint chunk_count;  // chunks of source Gaussians
};

void main() {
    uint c = group_index();
    if (c >= chunk_count) return;
    SourceChunk chunk = source_chunks[c];
    uint local = chunk.chunk * WORKGROUP_SIZE + gl_LocalInvocationID.x;
    if (local >= chunk.source_count) return;
    uint growth = growths[chunk.first_source + local];
    if (growth == GROWTH_OWN_CLONE || growth == GROWTH_OWN_SPLIT) return;
    for (uint i = 0; i < chunk.instance_count; ++i) {
        Instance instance = instances[instance_from_template[chunk.first_instance + i]];
        if (instance.first_offset != NO_OFFSET) needs[instance.first_offset + local] = 0;
    }
}
