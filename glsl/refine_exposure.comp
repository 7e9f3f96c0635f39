#version 460
// One step of Adam on the exposure of the view.
//
// - Reads `exposure_sums`; reads and writes the view's three rows of `exposures` and their moments.
// - Grid: one work-group. Sums have a fixed order: within each thread, then over threads. Does nothing after an overflow
//   (see `train_status`).
//
// Twin: `instgs_reference::exposure`. Test: `tests/kernels/exposure.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "counters.glsl"
#include "gradient_limit.glsl"
#include "exposure.glsl"
#include "train_status.glsl"

layout(scalar, binding = 0) readonly buffer ExposureSums { vec4 exposure_sums[]; };  // gradient by the three rows, by work-group and subgroup
layout(scalar, binding = 1) readonly buffer Status { uint status[]; };               // STATUS_*
layout(scalar, binding = 2) buffer Exposures { float exposures[]; };                 // rows of the exposures, value by value
layout(scalar, binding = 3) buffer ExposureMoments { vec2 exposure_moments[]; };     // first and second moment (running means of gradient and gradient squared), value by value
layout(scalar, push_constant) uniform RefineExposureParams {
    uint view;           // index of the training view
    uint sums;           // entries of the sums, three rows each
    float rate;          // learning rate divided by the bias correction of the first moment
    float beta1;         // decay of the first moment
    float beta2;         // decay of the second moment
    float second_scale;  // one over the bias correction of the second moment
    float epsilon;       // added to the square root of the second moment
};

shared vec4 partial_sums[3][WORKGROUP_SIZE];

void main() {
    uint lane = gl_LocalInvocationID.x;
    uint per_thread = divide_up(sums, WORKGROUP_SIZE);
    uint end = min((lane + 1) * per_thread, sums);
    vec4 sum[3] = vec4[3](vec4(0.0), vec4(0.0), vec4(0.0));
    for (uint i = lane * per_thread; i < end; ++i) {
        [[unroll]] for (uint r = 0; r < 3; ++r) sum[r] += exposure_sums[EXPOSURE_ROWS * i + r];
    }
    [[unroll]] for (uint r = 0; r < 3; ++r) partial_sums[r][lane] = sum[r];
    barrier();
    if (lane >= 3 || status[STATUS_OVERFLOW] != 0) return;
    vec4 gradient = vec4(0.0);
    for (uint t = 0; t < WORKGROUP_SIZE; ++t) gradient += partial_sums[lane][t];
    // A gradient that is not finite, or whose square is not, counts as 0: it would stay in the moments for ever.
    gradient = mix(vec4(0.0), gradient, is_below(gradient, GRADIENT_LIMIT));
    [[unroll]] for (uint c = 0; c < 4; ++c) {
        uint i = EXPOSURE_VALUES * view + 4 * lane + c;
        vec2 moments = exposure_moments[i];
        float g = gradient[c];
        moments = vec2(beta1 * moments.x + (1.0 - beta1) * g, beta2 * moments.y + (1.0 - beta2) * g * g);
        exposure_moments[i] = moments;
        exposures[i] -= rate * moments.x / (sqrt(moments.y * second_scale) + epsilon);
    }
}
