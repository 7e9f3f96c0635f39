#version 460
// Sums the gradients by the poses of instances.
//
// - Reads, per instance, the work items of its chunks that were not culled (as `gather_gradients`), and there one
//   record of 28 bytes per subgroup of `preprocess_instance_expand_backward`. An instance with own Gaussians has two rows.
// - Writes `pose_gradients`, 28 bytes per instance; 0 if it is culled.
// - Grid: one work-group per row of an instance besides the background; that of an instance's first row works. Each thread
//   sums a fixed set of records, then one thread sums over threads: the order is fixed.
//
// Twin: `instgs_reference::poses`. Test: `tests/kernels/poses.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "scene.glsl"
#include "gradients.glsl"

layout(scalar, binding = 0) readonly buffer InstanceChunks { uint instance_chunks[]; };      // chunks per row, 0 if culled
layout(scalar, binding = 1) readonly buffer CandidateOffsets { uint candidate_offsets[]; };  // first candidate per row
layout(scalar, binding = 2) readonly buffer CandidateVisible { uint candidate_visible[]; };  // 1 if the candidate became a work item
layout(scalar, binding = 3) readonly buffer WorkOffsets { uint work_offsets[]; };            // work item of the candidate
layout(scalar, binding = 4) readonly buffer Counters { uint counters[]; };                   // COUNTER_*
layout(scalar, binding = 5) readonly buffer PoseSums { PoseGradient pose_sums[]; };          // by work item and subgroup
layout(scalar, binding = 6) writeonly buffer PoseGradients { PoseGradient pose_gradients[]; };  // by instance
layout(scalar, binding = 7) readonly buffer Instances { Instance instances[]; };             // rows of instances, background last
layout(scalar, push_constant) uniform GatherPoseGradientsParams {
    uint posed_rows;  // rows of instances besides the background
};

#include "work_item_of.glsl"

shared PoseGradient partial_sums[WORKGROUP_SIZE];

PoseGradient plus(PoseGradient a, PoseGradient b) {
    return PoseGradient(a.translation + b.translation, a.rotation + b.rotation, a.log_scale + b.log_scale);
}

void main() {
    uint k = group_index();
    uint lane = gl_LocalInvocationID.x;
    if (k >= posed_rows) return;
    uint owner = instances[k].owner;
    if (k > 0 && instances[k - 1].owner == owner) return;
    // Each thread sums a fixed set of records, thread 0 sums over threads.
    const uint per_item = WORKGROUP_SIZE / SUBGROUP_SIZE;
    PoseGradient sum = PoseGradient(vec3(0.0), vec3(0.0), 0.0);
    uint summed = 0;  // threads that have summed anything
    for (uint row = k; row < posed_rows && instances[row].owner == owner; ++row) {
        uint records = instance_chunks[row] * per_item;
        for (uint i = lane; i < records; i += WORKGROUP_SIZE) {
            uint w = work_item_of(row, i / per_item);
            if (w != NO_WORK_ITEM) sum = plus(sum, pose_sums[w * per_item + i % per_item]);
        }
        summed = max(summed, min(records, WORKGROUP_SIZE));
    }
    partial_sums[lane] = sum;
    barrier();
    if (lane != 0) return;
    for (uint t = 1; t < summed; ++t) sum = plus(sum, partial_sums[t]);
    pose_gradients[owner] = sum;
}
