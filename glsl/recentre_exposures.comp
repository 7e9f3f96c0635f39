#version 460
// Takes out of the exposures what all photos have in common: their mean becomes the identity. If all photos became brighter
// the scene would become darker, and no photo could tell.
//
// - Reads and writes `exposures`, three rows a view.
// - Grid: one work-group; a thread for each of the 12 numbers of an exposure. Sums are in the order of views. Runs once in a
//   round over all photos. Does nothing after an overflow (see `train_status`).
//
// Twin: `instgs_reference::exposure`. Test: `tests/kernels/exposure.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "exposure.glsl"
#include "train_status.glsl"

layout(scalar, binding = 0) readonly buffer Status { uint status[]; };  // STATUS_*
layout(scalar, binding = 1) buffer Exposures { float exposures[]; };    // rows of the exposures, value by value
layout(scalar, push_constant) uniform RecentreExposuresParams {
    uint views;  // training views
};

void main() {
    uint value = gl_LocalInvocationID.x;
    if (group_index() > 0 || value >= EXPOSURE_VALUES || status[STATUS_OVERFLOW] != 0) return;
    float sum = 0.0;
    for (uint view = 0; view < views; ++view) sum += exposures[EXPOSURE_VALUES * view + value];
    // The numbers of the identity that are 1: those of the diagonal.
    float excess = sum / float(views) - (value % 5 == 0 ? 1.0 : 0.0);
    for (uint view = 0; view < views; ++view) exposures[EXPOSURE_VALUES * view + value] -= excess;
}
