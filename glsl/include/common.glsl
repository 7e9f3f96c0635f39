// Common to all kernels: extensions, the subgroup variant, work-group indexing.
#extension GL_EXT_scalar_block_layout : require
#extension GL_EXT_control_flow_attributes : require
#extension GL_KHR_shader_subgroup_basic : require
#extension GL_KHR_shader_subgroup_vote : require
#extension GL_KHR_shader_subgroup_ballot : require
#extension GL_KHR_shader_subgroup_shuffle : require

layout(constant_id = 0) const uint SUBGROUP_SIZE = 32;
layout(constant_id = 1) const uint WORKGROUP_SIZE = 256;
layout(local_size_x_id = 1) in;

// Dispatches fold their work-groups into rows of gl_NumWorkGroups.x (see Grid::groups).
uint group_index() {
    return gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
}

uint thread_index() {
    return group_index() * WORKGROUP_SIZE + gl_LocalInvocationID.x;
}
