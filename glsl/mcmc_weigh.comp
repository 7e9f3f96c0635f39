#version 460
// Fixed-point opacities of live Gaussians, for exact draws: first pass of a relocation.
//
// - Reads all parameters (by Gaussian, in parts where they are larger than a binding; SH to check that they are finite). Writes `weights` (0 for dead Gaussians:
//   opacity up to the limit, or not finite) and zeros to `copies`.
// - Grid: one thread per Gaussian. Bytes per Gaussian: 44 + 12 (degree + 1)^2 read, 8 written.
// - The host picks `one` so that the sum fits 32 bits: opacities are multiples of 2^-20 up to 4096 Gaussians, of
//   2^-12 for a million.
//
// Twin: `instgs_reference::mcmc`. Test: `tests/kernels/mcmc.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "strategy.glsl"
#include "finite.glsl"

layout(scalar, binding = 8) writeonly buffer Weights { uint weights[]; };  // opacity times `one`, at least 1; 0 = dead
layout(scalar, binding = 9) writeonly buffer Copies { uint copies[]; };    // zeros, to count in later
layout(scalar, push_constant) uniform McmcWeighParams {
    uint first;       // the first Gaussian, whose parameters are the first that are bound
    uint count;       // Gaussians from there on
    uint one;         // weight of opacity 1; times the count it fits 32 bits
    float logit_min;  // opacity logit up to which Gaussians are dead
};

void main() {
    uint bound = thread_index();
    if (bound >= count) return;
    uint i = first + bound;
    float logit = opacity_logits[bound];
    bool alive = all_finite(bound) && logit > logit_min;
    uint weight = uint(float(one) / (1.0 + exp(-logit)) + 0.5);
    weights[i] = alive ? clamp(weight, 1, one) : 0;
    copies[i] = 0;
}
