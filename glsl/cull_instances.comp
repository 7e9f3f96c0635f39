#version 460
// Tests every instance's bounding sphere against the view and writes how many chunks are worth testing.
// Reads instances; writes instance_chunks. Grid: one thread per instance.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "scene.glsl"

layout(scalar, binding = 0) readonly buffer Instances { Instance instances[]; };          // instances, background last
layout(scalar, binding = 1) writeonly buffer InstanceChunks { uint instance_chunks[]; };  // chunks to test per instance
layout(scalar, push_constant) uniform CullInstancesParams {
    View view;            // the camera
    uint instance_count;  // instances, background included
};

void main() {
    uint i = thread_index();
    if (i >= instance_count) return;
    Instance instance = instances[i];
    float radius = instance.bound_radius + instance.max_offset;
    float sigma = instance.sigma_max * instance.sigma_growth;
    bool culled = outside_view(view, instance.world_from_template, instance.scale, instance.bound_center, radius, sigma);
    instance_chunks[i] = culled ? 0 : divide_up(instance.source_count, WORKGROUP_SIZE);
}
