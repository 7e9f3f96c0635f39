#version 460
// Keeps the counts of a depth layer that has been drawn, and goes on to the next, in frames that the host does not wait for.
//
// - Reads and writes `counters`: what the layer needed goes to `COUNTER_LAYER_LOG`; `COUNTER_INCOMPLETE` is set if a buffer was
//   too small for it, or one depth slab was not enough; `COUNTER_LAYER` grows by one.
// - Grid: one work-group, of which one thread works.
//
// Twin: `instgs_reference::layers`. Test: `tests/kernels/layers.rs`, also of whole frames in flight.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"

layout(scalar, binding = 0) buffer Counters { uint counters[]; };  // COUNTER_*
layout(scalar, push_constant) uniform NextLayerParams {
    uvec2 capacities;  // candidates and work items that fit
};
#include "complete.glsl"

void main() {
    if (gl_LocalInvocationID.x != 0) return;
    uint layer = counters[COUNTER_LAYER];
    uint entry = COUNTER_LAYER_LOG + layer * LAYER_LOG_LENGTH;
    counters[entry + LAYER_LOG_WORK_ITEMS] = counters[COUNTER_WORK_ITEMS_NEEDED];
    counters[entry + LAYER_LOG_VISIBLE] = counters[COUNTER_VISIBLE];
    counters[entry + LAYER_LOG_INTERSECTIONS] = counters[COUNTER_INTERSECTIONS];
    if (!is_complete(capacities)) counters[COUNTER_INCOMPLETE] = 1;
    counters[COUNTER_LAYER] = layer + 1;
}
