#version 460
// One step of Adam (Kingma and Ba 2015, algorithm 1) on a flat array of f32, in two groups (what instances show, and
// the background) with a learning rate each.
//
// - Reads `gradients`; reads and writes `parameters` and `moments` (first and second, side by side). 28 bytes a value.
// - Grid: one thread per four values: on a CPU driver every buffer access is a loop over lanes, whatever its width.
// - Bias corrections come from the host, so that a step that is redone gets the same numbers. Does nothing after an
//   overflow (see `train_status`).
//
// Twin: `instgs_reference::adam`. Test: `tests/kernels/adam.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "gradient_limit.glsl"
#include "train_status.glsl"

layout(scalar, binding = 0) readonly buffer Gradients { vec4 gradients[]; };  // gradient of the loss
layout(scalar, binding = 1) readonly buffer Status { uint status[]; };         // STATUS_*
layout(scalar, binding = 2) buffer Parameters { vec4 parameters[]; };         // values to optimise
layout(scalar, binding = 3) buffer Moments { vec4 moments[]; };         // first and second moment (running means of gradient and gradient squared), value by value
layout(scalar, push_constant) uniform AdamParams {
    uint count;            // values
    uint split;            // values of the first group
    vec2 rates;            // learning rates of the groups, divided by the bias correction of the first moment
    float beta1;           // decay of the first moment
    float beta2;           // decay of the second moment
    float second_scale;    // one over the bias correction of the second moment
    float epsilon;         // added to the square root of the second moment
};

void main() {
    uint i = thread_index();
    if (4 * i >= count || status[STATUS_OVERFLOW] != 0) return;
    vec4 g = gradients[i];
    // A gradient that is not finite, or whose square is not, counts as 0: it would stay in the moments for ever.
    g = mix(vec4(0.0), g, is_below(g, GRADIENT_LIMIT));
    // Nor is there a gradient, or a moment, beyond the last value.
    uvec4 value = 4 * i + uvec4(0, 1, 2, 3);
    g = mix(vec4(0.0), g, lessThan(value, uvec4(count)));
    vec4 low = moments[2 * i], high = moments[2 * i + 1];
    vec4 first = beta1 * vec4(low.xz, high.xz) + (1.0 - beta1) * g;
    vec4 second = beta2 * vec4(low.yw, high.yw) + (1.0 - beta2) * g * g;
    moments[2 * i] = vec4(first.x, second.x, first.y, second.y);
    moments[2 * i + 1] = vec4(first.z, second.z, first.w, second.w);
    vec4 rate = mix(vec4(rates.y), vec4(rates.x), lessThan(value, uvec4(split)));
    parameters[i] -= rate * first / (sqrt(second * second_scale) + epsilon);
}
