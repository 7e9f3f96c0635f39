#version 460
// Chooses the next depth slab: the longest run of splats, from where the last slab ended, whose intersections fit the
// buffer and whose number keeps every tile's list within the device's loop limit. Grid: one work-group; thread 0 works.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"

layout(scalar, binding = 0) readonly buffer IsectOffsets { uint isect_offsets[]; };  // scan of tile counts from the slab's begin
layout(scalar, binding = 1) buffer Counters { uint counters[]; };                    // COUNTER_*
layout(scalar, binding = 2) writeonly buffer Args { DispatchArgs args[]; };          // indirect arguments, by family
layout(scalar, push_constant) uniform PlanSlabParams {
    uint capacity;    // intersections that fit
    uint max_splats;  // most splats in a slab
};
#include "write_args.glsl"

void main() {
    if (gl_LocalInvocationID.x != 0) return;
    uint visible = counters[COUNTER_VISIBLE];
    uint begin = counters[COUNTER_SLAB_BEGIN];
    uint total = counters[COUNTER_INTERSECTIONS];
    // offset(e) = intersections of [begin, e) for e > begin; the largest e with offset(e) <= capacity, by bisection.
    uint low = begin;
    uint high = visible;
    if (total <= capacity) low = high;
    while (low < high) {
        uint middle = low + (high - low + 1) / 2;
        uint offset = middle < visible ? isect_offsets[middle] : total;
        bool fits = offset <= capacity;
        low = fits ? middle : low;
        high = fits ? high : middle - 1;
    }
    uint end = min(low, add_saturating(begin, max_splats));
    uint intersections = end < visible ? isect_offsets[end] : total;
    counters[COUNTER_SLAB_END] = end;
    counters[COUNTER_SLAB_INTERSECTIONS] = intersections;
    write_args(FAMILY_SLAB_SPLATS, end - begin);
    write_args(FAMILY_INTERSECTIONS, intersections);
}
