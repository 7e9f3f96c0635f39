#version 460
// Lowers opacity logits to a limit and zeroes their moments: INRIA's opacity reset.
//
// - Grid: one thread per Gaussian. 4 bytes read, 12 written.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(scalar, binding = 0) buffer OpacityLogits { float opacity_logits[]; };  // opacity logits
layout(scalar, binding = 1) writeonly buffer Moments { vec2 moments[]; };      // Adam's moments of the logits
layout(scalar, push_constant) uniform ResetOpacityParams {
    uint count;       // Gaussians
    float logit_max;  // upper limit of the logits
};

void main() {
    uint i = thread_index();
    if (i >= count) return;
    opacity_logits[i] = min(opacity_logits[i], logit_max);
    moments[i] = vec2(0.0);
}
