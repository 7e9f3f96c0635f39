#version 460
// Moves centres at random after a step: `mean += strength gate(opacity) covariance n`, n standard normals.
//
// - `gate` is a steep sigmoid of 1 - opacity around 0.995: opaque Gaussians hardly move.
// - Reads quaternions, log scales, logits and the status; updates `means`. 36 bytes read, 24 for the means.
// - Random numbers are a hash of (seed, step, index), so that a redone step moves centres as before. Does nothing after
//   an overflow (see `train_status`).
// - Grid: one thread per Gaussian.
//
// Twin: `instgs_reference::mcmc`. Test: `tests/kernels/mcmc.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "random.glsl"
#include "rotation.glsl"
#include "train_status.glsl"

layout(scalar, binding = 0) readonly buffer Status { uint status[]; };                  // STATUS_*
layout(scalar, binding = 1) readonly buffer Quats { vec4 quats[]; };                    // rotations, wxyz
layout(scalar, binding = 2) readonly buffer LogScales { vec3 log_scales[]; };           // log standard deviations
layout(scalar, binding = 3) readonly buffer OpacityLogits { float opacity_logits[]; };  // opacity logits
layout(scalar, binding = 4) buffer Means { vec3 means[]; };                             // centres
layout(scalar, push_constant) uniform McmcNoiseParams {
    uint count;      // Gaussians
    float strength;  // learning rate of the centres times the strength of the noise
    uvec2 seed;      // seed of the run, low word first
    uint time;       // index of the step
};

void main() {
    uint i = thread_index();
    if (i >= count || status[STATUS_OVERFLOW] != 0) return;
    float transparency = 1.0 / (1.0 + exp(opacity_logits[i]));
    float gate = 1.0 / (1.0 + exp(-100.0 * (transparency - 0.995)));
    vec3 normals = random_normals(seed, time, RANDOM_NOISE, i, 0);
    mat3 r = rotation_from_quat(quats[i]);
    vec3 variances = exp(2.0 * log_scales[i]);
    means[i] += strength * gate * (r * (variances * (normals * r)));
}
