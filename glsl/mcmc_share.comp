#version 460
// Sets opacity and scales of Gaussians that share a place, such that together they look like the single one before.
//
// - For n of them, with old opacity o and new opacity p: `1 - (1 - p)^n = o`, and scales change by the factor `o / sum
//   over m of C(n, m) (-1)^(m-1) p^m / sqrt(m)` (Kheradmand et al. 2024, eq. 9). n is limited to 51, as in the authors'
//   code; p is not below the opacity limit of dead Gaussians.
// - Reads `made` (n - 1; 0 = nothing to do); updates `opacity_logits` and `log_scales`.
// - The sum alternates; the kernel evaluates an equivalent integral of positive values, the twin the paper's sum.
// - Grid: one thread per Gaussian. 4 bytes read, 32 more where n > 1.
//
// Twin: `instgs_reference::mcmc`. Test: `tests/kernels/mcmc.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"

layout(scalar, binding = 0) readonly buffer Made { uint made[]; };             // number of others at the same place; 0 = unchanged
layout(scalar, binding = 1) buffer OpacityLogits { float opacity_logits[]; };  // opacity logits
layout(scalar, binding = 2) buffer LogScales { vec3 log_scales[]; };           // log standard deviations
layout(scalar, push_constant) uniform McmcShareParams {
    uint count;       // Gaussians
    float logit_min;  // lower limit of the new opacity logit
};

const uint SHARERS_MAX = 51;

// -log(1 - sigmoid(x)).
float softplus(float x) {
    return max(x, 0.0) + log(1.0 + exp(-abs(x)));
}

// 1 - exp(-x), x >= 0.
float one_minus_exp(float x) {
    float series = x * (1.0 - x / 2.0 * (1.0 - x / 3.0 * (1.0 - x / 4.0 * (1.0 - x / 5.0))));
    return x < 0.1 ? series : 1.0 - exp(-x);
}

// 1 - (1 - x)^n without cancellation, n < 64: by the binary digits of n.
float any_of(float x, uint n) {
    float sum = 0.0;
    for (uint bit = 6; bit-- > 0;) {
        sum = sum * (2.0 - sum);
        sum = (n >> bit & 1) != 0 ? sum + x - sum * x : sum;
    }
    return sum;
}

// Sum over m = 1..n of C(n, m) (-1)^(m-1) p^m / sqrt(m), which adds up the paper's double sum by columns. With
// 1/sqrt(m) = 2/sqrt(pi) times the integral of exp(-m t^2) over t > 0 it is an integral of positive values, smooth enough
// for the trapezoidal rule.
float blended_width(float p, uint n) {
    const float step = 0.125;
    float sum = 0.5 * any_of(p, n);
    for (uint k = 1; k <= 40; ++k) {
        float t = step * float(k);
        sum += any_of(p * exp(-t * t), n);
    }
    return 1.1283791670955126 * step * sum;
}

void main() {
    uint j = thread_index();
    if (j >= count || made[j] == 0) return;
    uint n = min(made[j], SHARERS_MAX - 1) + 1;
    float logit = opacity_logits[j];
    float rest = softplus(logit) / float(n);
    float p = one_minus_exp(rest);
    opacity_logits[j] = max(log(p) + rest, logit_min);
    log_scales[j] -= softplus(-logit) + log(blended_width(p, n));
}
