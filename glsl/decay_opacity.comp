#version 460
// Lowers every opacity by a little, in place of resets: what no picture needs fades until densification removes it, and what
// is needed comes back within a few steps (Rota Bulo et al. 2024, "Revising Densification in Gaussian Splatting").
//
// - Updates `opacity_logits` to those of `opacity - decay`, at least `opacity_floor`; what is lower already stays. Moments
//   stay as they are.
// - Grid: one thread per Gaussian. 4 bytes read, 4 written.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(scalar, binding = 0) buffer OpacityLogits { float opacity_logits[]; };  // opacity logits
layout(scalar, push_constant) uniform DecayOpacityParams {
    uint count;           // Gaussians
    float decay;          // subtracted from every opacity
    float opacity_floor;  // lower limit of the result, above 0
};

void main() {
    uint i = thread_index();
    if (i >= count) return;
    float logit = opacity_logits[i];
    float opacity = 1.0 / (1.0 + exp(-logit));
    float lowered = max(opacity - decay, opacity_floor);
    if (lowered < opacity) opacity_logits[i] = log(lowered / (1.0 - lowered));
}
