#version 460
// Moves one array of f32, parameters or moments, to a new order of Gaussians.
//
// - `after[j] = before[origins[j]]`, `width` f32 each; zeros instead where `zero_made` is set and `made[j]` is not 0
//   (moments of Gaussians that have changed).
// - Arrays that are larger than a binding are bound in parts, and each dispatch moves what is in its part of both.
// - Grid: one thread per f32 of the new array. 8 bytes each, and 8 of the tables.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "strategy.glsl"

layout(scalar, binding = 0) readonly buffer Origins { uint origins[]; };      // old Gaussian of each new one
layout(scalar, binding = 1) readonly buffer Made { uint made[]; };            // 0 = unchanged Gaussian
layout(scalar, binding = 2) readonly buffer Before { float before[]; };       // the old array
layout(scalar, binding = 3) writeonly buffer After { float after[]; };        // the new array
layout(scalar, push_constant) uniform MoveGaussiansParams {
    uint count;         // f32 of the new array that are bound
    uint width;         // f32 of one Gaussian
    uint first_after;   // the first Gaussian that is bound of the new array
    uint first_before;  // the first that is bound of the old one
    uint count_before;  // Gaussians that are bound of the old one
    uint zero_made;     // 1 = zeros for Gaussians that have changed
};

void main() {
    uint v = thread_index();
    if (v >= count) return;
    uint j = first_after + v / width;
    uint origin = origins[j] - first_before;
    if (origin >= count_before) return;
    bool zero = zero_made != 0 && made[j] != MADE_KEPT;
    float value = before[origin * width + v % width];
    after[v] = zero ? 0.0 : value;
}
