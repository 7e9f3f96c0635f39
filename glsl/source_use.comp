#version 460
// How every source Gaussian is used: the number of instances that have it, its largest opacity logit in any of them, the
// largest scale of an instance, and what the loss feels of its opacity. What densification decides by, where scenes have
// templates.
//
// - Reads, per chunk of source Gaussians, its template's instances; for each Gaussian its logit and the offsets to it, and
//   the second moments of both.
// - Writes `uses`, `highest_logits`, `log_world_scales` and `felt`; a logit that is not finite in an instance does not count
//   there. Gaussians of no template keep what the buffers held before.
// - `felt` is the sum over instances of the mean square of the gradient by the instance's logit, over the square of its
//   transparency there (the logit of an opaque Gaussian moves little). An instance with offsets has its own gradient in the
//   offset's moment. The template's is that of the sum over instances, of which each has a part if they differ at random; if they
//   agree that is too much, so it serves only where an instance has no offsets, or where they have no moment.
// - Grid: one work-group per chunk. Bytes per Gaussian: 12 read, 12 more per instance with offsets, 16 written.
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
layout(scalar, binding = 8) readonly buffer LogitMoments { vec2 logit_moments[]; };              // first and second moment of the logit, by source
layout(scalar, binding = 9) readonly buffer OffsetLogitMoments { vec2 offset_logit_moments[]; }; // first and second moment of the offset, by record
layout(scalar, binding = 10) writeonly buffer Felt { float felt[]; };                            // what the loss feels, by source
layout(scalar, push_constant) uniform SourceUseParams {
    uint chunk_count;  // chunks of source Gaussians
};

const float LARGEST = 3.402823466e38;   // the largest finite f32
const float LEAST_TRANSPARENCY = 1e-3;  // below it the gradient by the logit says nothing
const float LARGEST_LOGIT = 20.0;       // its exponential is finite

// What the loss feels of an opacity that can move freely, by the mean square of the gradient by its logit.
float felt_of(float square, float logit) {
    float transparency = max(1.0 / (1.0 + exp(min(logit, LARGEST_LOGIT))), LEAST_TRANSPARENCY);
    return square / (transparency * transparency);
}

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
    float shared_square = logit_moments[source].y / float(max(chunk.instance_count, 1));
    float sum = chunk.instance_count == 0 ? felt_of(shared_square, logit) : 0.0;
    for (uint i = 0; i < chunk.instance_count; ++i) {
        Instance instance = instances[instance_from_template[chunk.first_instance + i]];
        float own = logit;
        float square = shared_square;
        if (instance.first_offset != NO_OFFSET) {
            own += offset_opacity_logits[instance.first_offset + local];
            float moment = offset_logit_moments[instance.first_offset + local].y;
            if (moment > 0.0) square = moment;
        }
        sum += felt_of(square, own);
        if (own > highest && own <= LARGEST) highest = own;
        // Columns of a similarity have the same length.
        vec3 column = vec3(instance.world_from_template[0].x, instance.world_from_template[1].x, instance.world_from_template[2].x);
        largest_scale = max(largest_scale, length(column));
    }
    uses[source] = chunk.instance_count;
    highest_logits[source] = highest;
    log_world_scales[source] = largest_scale > 0.0 ? log(largest_scale) : 0.0;
    felt[source] = sum;
}
