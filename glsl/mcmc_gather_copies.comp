#version 460
// `made[j] = copies[origins[j]]`: the number of other Gaussians at the same place after a relocation.
//
// - Grid: one thread per Gaussian afterwards. 8 bytes read, 4 written.
//
// Twin: `instgs_reference::mcmc`. Test: `tests/kernels/mcmc.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(scalar, binding = 0) readonly buffer Origins { uint origins[]; };  // itself, or the Gaussian it joins
layout(scalar, binding = 1) readonly buffer Copies { uint copies[]; };    // number of Gaussians that join, by old Gaussian
layout(scalar, binding = 2) writeonly buffer Made { uint made[]; };       // number of others at the same place; 0 = unchanged
layout(scalar, push_constant) uniform McmcGatherCopiesParams {
    uint after;  // Gaussians afterwards
};

void main() {
    uint j = thread_index();
    if (j < after) made[j] = copies[origins[j]];
}
