#version 460
// Lists the origins of one run of offset records after densification: they follow their template's Gaussians.
//
// - Reads `origins` and `made` by new source Gaussian (see `densify_place`); writes the same for offset records, for
//   `move_gaussians`. A copy and the children of a split Gaussian inherit the offsets that it has in every instance.
// - Grid: one thread per new Gaussian of the run's template. 8 bytes read, 8 written.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(scalar, binding = 0) readonly buffer Origins { uint origins[]; };              // old Gaussian of each new one
layout(scalar, binding = 1) readonly buffer Made { uint made[]; };                    // MADE_*
layout(scalar, binding = 2) writeonly buffer OffsetOrigins { uint offset_origins[]; };  // old record of each new one
layout(scalar, binding = 3) writeonly buffer OffsetMade { uint offset_made[]; };      // MADE_*, by new record
layout(scalar, push_constant) uniform DensifyPlaceOffsetsParams {
    uint count;                // Gaussians of the template afterwards
    uint first_source;         // its first Gaussian afterwards
    uint first_source_before;  // its first Gaussian before
    uint first_offset;         // first record of the run afterwards
    uint first_offset_before;  // first record of the run before
};

void main() {
    uint i = thread_index();
    if (i >= count) return;
    uint source = first_source + i;
    offset_origins[first_offset + i] = first_offset_before + origins[source] - first_source_before;
    offset_made[first_offset + i] = made[source];
}
