#version 460
// One step of Adam on a flat array. Does nothing once an earlier pass of this or a former step has overflowed a buffer.
// Grid: one thread per value.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "train_status.glsl"

layout(scalar, binding = 0) readonly buffer Gradients { float gradients[]; };  // gradient of the loss
layout(scalar, binding = 1) readonly buffer Status { uint status[]; };         // STATUS_*
layout(scalar, binding = 2) buffer Parameters { float parameters[]; };         // what is optimised
layout(scalar, binding = 3) buffer Moments { vec2 moments[]; };                // running means of gradient and gradient squared
layout(scalar, push_constant) uniform AdamParams {
    uint count;            // values
    float rate;            // learning rate divided by the bias correction of the first moment
    float beta1;           // decay of the first moment
    float beta2;           // decay of the second moment
    float second_scale;    // one over the bias correction of the second moment
    float epsilon;         // added to the root of the second moment
};

const float GRADIENT_LIMIT = 1e15;

void main() {
    uint i = thread_index();
    if (i >= count || status[STATUS_OVERFLOW] != 0) return;
    float g = gradients[i];
    // What is no number, or whose square is none, is no gradient: it would stay in the moments for good.
    g = abs(g) < GRADIENT_LIMIT ? g : 0.0;
    vec2 m = moments[i];
    m = vec2(beta1 * m.x + (1.0 - beta1) * g, beta2 * m.y + (1.0 - beta2) * g * g);
    moments[i] = m;
    parameters[i] -= rate * m.x / (sqrt(m.y * second_scale) + epsilon);
}
