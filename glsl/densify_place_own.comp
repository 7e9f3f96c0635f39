#version 460
// Lists the Gaussians that one instance gets for its own: behind those that it has, in the order of its template.
//
// - Reads `needs` and its exclusive scan by old offset record, and `growths` by old source Gaussian; writes `origins` (the
//   template's Gaussian, by old index) and `made`, by new source Gaussian (see `densify_place`). What comes of a large
//   Gaussian is made as a child with the number of the instance, so that each instance draws another place.
// - Grid: one thread per old Gaussian of the template. Bytes: 4 read each, 16 more per new one.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify_own.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "strategy.glsl"

layout(scalar, binding = 0) readonly buffer Needs { uint needs[]; };              // 1 if the instance gets a Gaussian, by old record
layout(scalar, binding = 1) readonly buffer NeedsBefore { uint needs_before[]; };  // exclusive scan of needs
layout(scalar, binding = 2) readonly buffer Growths { uint growths[]; };          // GROWTH_*, by old source Gaussian
layout(scalar, binding = 3) writeonly buffer Origins { uint origins[]; };         // old Gaussian of each new one
layout(scalar, binding = 4) writeonly buffer Made { uint made[]; };               // MADE_*
layout(scalar, push_constant) uniform DensifyPlaceOwnParams {
    uint count;                // old Gaussians of the template
    uint first_source_before;  // its first Gaussian before
    uint first_offset_before;  // first record of the instance before
    uint first_new;            // index of the first Gaussian that the instance gets
    uint instance;             // index of the instance
};

void main() {
    uint i = thread_index();
    if (i >= count || needs[first_offset_before + i] == 0) return;
    uint j = first_new + needs_before[first_offset_before + i] - needs_before[first_offset_before];
    uint source = first_source_before + i;
    origins[j] = source;
    made[j] = growths[source] == GROWTH_OWN_SPLIT ? MADE_CHILD + instance : MADE_CLONE;
}
