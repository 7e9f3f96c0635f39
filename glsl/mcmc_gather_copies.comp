#version 460
// `made[j] = copies[origins[j]]`: how many others share the place of a Gaussian after a relocation.
//
// - Grid: one thread per Gaussian afterwards. 8 bytes read, 4 written.
//
// Twin: `instgs_reference::mcmc`. Test: `tests/kernels/mcmc.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(scalar, binding = 0) readonly buffer Origins { uint origins[]; };  // itself, or the Gaussian it joins
layout(scalar, binding = 1) readonly buffer Copies { uint copies[]; };    // how many join, by old Gaussian
layout(scalar, binding = 2) writeonly buffer Made { uint made[]; };       // how many others share its place; 0 = as it was
layout(scalar, push_constant) uniform McmcGatherCopiesParams {
    uint after;  // Gaussians afterwards
};

void main() {
    uint j = thread_index();
    if (j < after) made[j] = copies[origins[j]];
}
