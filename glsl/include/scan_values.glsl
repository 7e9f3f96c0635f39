// The values of a scan: `values[i]`, or `values[indices[i]]` with GATHER.

layout(constant_id = 3) const uint GATHER = 0;

layout(scalar, binding = 0) readonly buffer Values { uint values[]; };      // values to sum
layout(scalar, binding = 1) readonly buffer Indices { uint indices[]; };    // order of the values, with GATHER
layout(scalar, binding = 2) readonly buffer Counters { uint counters[]; };  // COUNTER_*
#include "scan_params.glsl"

uint scan_value(uint i, uint n) {
    uint begin = scan.begin_slot < COUNTER_COUNT ? counters[min(scan.begin_slot, COUNTER_COUNT - 1)] : 0;
    uint gather = GATHER;
    uint value = 0;
    if (i < n && i >= begin) value = values[gather != 0 ? indices[i] : i];
    return value;
}
