#version 460
// Lists the new Gaussians: `origins` (the old Gaussian that each comes from) and `made` (its kind, `MADE_*`).
//
// - Reads `counts`, their exclusive scan `firsts`, and `growths`, all by old Gaussian.
// - The old order is kept. A copy comes right after its original; children take the place of their parent. A run of old
//   Gaussians is placed `shift` further back, behind what instances get for their own.
// - Grid: one thread per old Gaussian of the run. Bytes: 12 read per old Gaussian, 8 written per new one.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "strategy.glsl"

layout(scalar, binding = 0) readonly buffer Counts { uint counts[]; };    // number of Gaussians that the old one becomes
layout(scalar, binding = 1) readonly buffer Growths { uint growths[]; };  // GROWTH_*
layout(scalar, binding = 2) readonly buffer Firsts { uint firsts[]; };    // exclusive scan of the counts
layout(scalar, binding = 3) writeonly buffer Origins { uint origins[]; };  // old Gaussian of each new one
layout(scalar, binding = 4) writeonly buffer Made { uint made[]; };       // MADE_*
layout(scalar, push_constant) uniform DensifyPlaceParams {
    uint count;         // old Gaussians of the run
    uint first_source;  // the first of them
    uint shift;         // how much further back their new ones are
};

void main() {
    if (thread_index() >= count) return;
    uint i = first_source + thread_index();
    uint becomes = counts[i];
    uint growth = growths[i];
    for (uint k = 0; k < becomes; ++k) {
        // The copy of a clone comes after it, or alone if the original is removed.
        uint clone = k + 1 == becomes ? MADE_CLONE : MADE_KEPT;
        uint how = growth == GROWTH_SPLIT ? MADE_CHILD + k : growth == GROWTH_CLONE ? clone : MADE_KEPT;
        origins[firsts[i] + shift + k] = i;
        made[firsts[i] + shift + k] = how;
    }
}
