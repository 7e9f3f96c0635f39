#version 460
// Tests every instance's bounding sphere against the view, and whether its level of detail is shown, and writes how many
// chunks are worth testing.
// Reads instances; writes instance_chunks. Grid: one thread per instance.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "counters.glsl"
#include "scene.glsl"
#include "lod.glsl"

layout(scalar, binding = 0) readonly buffer Instances { Instance instances[]; };          // instances, background last
layout(scalar, binding = 1) writeonly buffer InstanceChunks { uint instance_chunks[]; };  // chunks to test per instance
layout(scalar, push_constant) uniform CullInstancesParams {
    View view;            // the camera
    uint instance_count;  // instances, background included
    float lod_error_px;   // levels of detail whose cells are wider are not shown; 0 = everything in full
};

void main() {
    uint i = thread_index();
    if (i >= instance_count) return;
    Instance instance = instances[i];
    float radius = instance.bound_radius + instance.max_offset;
    float sigma = instance.sigma_max * instance.sigma_growth;
    bool culled = outside_view(view, instance.world_from_template, instance.scale, instance.bound_center, radius, sigma);
    if (LEVELS != 0) culled = culled || level_weight(view, instance, lod_error_px) <= 0.0;
    instance_chunks[i] = culled ? 0 : divide_up(instance.source_count, WORKGROUP_SIZE);
}
