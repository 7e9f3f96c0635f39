#version 460
// Chooses the next depth slab: the longest run of splats, from where the last slab ended, whose intersections fit the
// buffer.
//
// The offset of splat e is the number of intersections of splats `begin..e`. They ascend, so the end is found by
// bisection: the largest e whose offset is at most `capacity`, then at most `begin + max_splats`.
//
// - Reads `isect_offsets` (by index in depth order, counted from the slab's begin) and `counters`.
// - Writes `COUNTER_SLAB_END`, `COUNTER_SLAB_INTERSECTIONS`, and the indirect arguments of `FAMILY_SLAB_SPLATS` and
//   `FAMILY_INTERSECTIONS`.
// - Grid: one work-group, of which one thread works.
// - Bytes: 4 read per step, about log2(visible) steps if not all fits; 8 written to counters, 72 to arguments.
// - Guarantees: `FramePlan` makes `capacity` at least the number of tiles, so every slab takes at least one splat and
//   the loop over slabs ends. Every splat is in exactly one slab. Offsets saturate at 2^32 - 1, which is more than any
//   capacity: an overflowed count reads as "does not fit", never as a small number.
// - `max_splats` keeps each tile's list within a driver's loop limit: 15/16 of the limit times the subgroup size where
//   there is one (lavapipe: 65535 iterations), since `tile_blend` takes one iteration per subgroup of splats; else
//   2^32 - 1, and so in training, where a step is one slab and `train_status` looks at the lists.
//
// Twin: `instgs_reference::plan_slab`. Tests: `tests/kernels/plan_slab.rs`, `overflow.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"

layout(scalar, binding = 0) readonly buffer IsectOffsets { uint isect_offsets[]; };  // scan of tile counts from the slab's begin
layout(scalar, binding = 1) buffer Counters { uint counters[]; };                    // COUNTER_*
layout(scalar, binding = 2) writeonly buffer Args { DispatchArgs args[]; };          // indirect arguments, by family
layout(scalar, push_constant) uniform PlanSlabParams {
    uint capacity;    // intersections that fit
    uint max_splats;  // largest number of splats in a slab
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
