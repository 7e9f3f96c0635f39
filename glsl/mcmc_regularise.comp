#version 460
// Adds the gradients of two regularisation terms, mean opacity and mean scale, between backward pass and Adam.
//
// - Reads log scales, logits and the status; updates their gradients. Does nothing after an overflow.
// - Grid: one thread per Gaussian. 32 bytes read, 16 written.
//
// Twin: `instgs_reference::mcmc`. Test: `tests/kernels/mcmc.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "train_status.glsl"

layout(scalar, binding = 0) readonly buffer Status { uint status[]; };                            // STATUS_*
layout(scalar, binding = 1) readonly buffer LogScales { vec3 log_scales[]; };                     // log standard deviations
layout(scalar, binding = 2) readonly buffer OpacityLogits { float opacity_logits[]; };            // opacity logits
layout(scalar, binding = 3) buffer LogScaleGradients { vec3 log_scale_gradients[]; };             // gradients by log scales
layout(scalar, binding = 4) buffer LogitGradients { float opacity_logit_gradients[]; };           // gradients by opacity logits
layout(scalar, push_constant) uniform McmcRegulariseParams {
    uint count;            // Gaussians
    float opacity_weight;  // weight of the mean opacity in the loss, divided by the count
    float scale_weight;    // weight of the mean scale in the loss, divided by three times the count
};

void main() {
    uint i = thread_index();
    if (i >= count || status[STATUS_OVERFLOW] != 0) return;
    float e = exp(-abs(opacity_logits[i]));
    opacity_logit_gradients[i] += opacity_weight * e / ((1.0 + e) * (1.0 + e));
    log_scale_gradients[i] += scale_weight * exp(log_scales[i]);
}
