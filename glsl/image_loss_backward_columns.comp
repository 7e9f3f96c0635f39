#version 460
// Last pass of the image loss: the window along columns, then dL/dpicture.
//
// - Reads `row_gradients`, `colors`, `targets`; writes `cotangents` by pixel (rgb, and 0 for alpha) and `error_sums` by
//   thread (absolute and squared error, for the progress report).
// - Grid: one thread per strip of a column. Bytes per pixel: 101 read, 16 written.
// - dL/dx = ((1 - lambda) sign(x - y) - lambda (W g_x + 2 x W g_xx + y W g_xy)) / (3 pixels); sign(0) = 0.
//
// Twin: `instgs_reference::image_loss`. Test: `tests/kernels/image_loss.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "image_loss.glsl"

layout(scalar, binding = 0) readonly buffer RowGradients { vec3 row_gradients[]; };               // derivatives of SSIM, windowed along rows, by channel and pixel
layout(scalar, binding = 1) readonly buffer Colors { vec4 colors[]; };                       // the picture: rgb over the background, and alpha
layout(scalar, binding = 2) readonly buffer Targets { uint targets[]; };                     // the target, RGBA of 8 bits
layout(scalar, binding = 3) writeonly buffer Cotangents { vec4 cotangents[]; };              // gradient of the loss by rgb, and 0 for alpha
layout(scalar, binding = 4) writeonly buffer ErrorSums { vec2 error_sums[]; };               // absolute and squared error over the strip and channels, by thread
layout(scalar, push_constant) uniform ImageLossBackwardColumnsParams {
    vec3 background;      // colour behind the target
    uvec2 size_px;        // image width and height
    float lambda_dssim;   // weight of 1 - SSIM; L1 has weight 1 - lambda_dssim
};

void main() {
    uint x = thread_index() % size_px.x;
    uint first = (thread_index() / size_px.x) * STRIP;
    if (first >= size_px.y) return;
    uint pixels = size_px.x * size_px.y;
    float per_value = 1.0 / (3.0 * float(size_px.x) * float(size_px.y));
    vec2 errors = vec2(0.0);
    [[dont_unroll]] for (uint channel = 0; channel < CHANNELS; ++channel) {
        vec3 sums[STRIP];
        [[unroll]] for (uint k = 0; k < STRIP; ++k) sums[k] = vec3(0.0);
        [[unroll]] for (int tap = -int(WINDOW_RADIUS); tap < int(STRIP + WINDOW_RADIUS); ++tap) {
            int y = int(first) + tap;
            bool inside = y >= 0 && y < int(size_px.y);
            uint i = channel * pixels + uint(clamp(y, 0, int(size_px.y) - 1)) * size_px.x + x;
            vec3 gradient = mix(vec3(0.0), row_gradients[i], bvec3(inside));
            [[unroll]] for (int k = 0; k < int(STRIP); ++k) {
                if (abs(tap - k) <= int(WINDOW_RADIUS)) sums[k] += window_weight(tap - k) * gradient;
            }
        }
        [[unroll]] for (uint k = 0; k < STRIP; ++k) {
            uint i = min(first + k, size_px.y - 1) * size_px.x + x;
            uint rgba = targets[i];
            ColorPair pair = color_pair(colors[i][channel], rgba, channel, background[channel]);
            float a = pair.picture, b = pair.target;
            float ssim = dot(sums[k], vec3(1.0, 2.0 * (a - SHIFT), b - SHIFT));
            float g = per_value * ((1.0 - lambda_dssim) * sign(a - b) - lambda_dssim * ssim);
            bool counts = first + k < size_px.y;
            float error = counts ? abs(a - b) : 0.0;
            errors += vec2(error, error * error);
            if (counts) cotangents[i][channel] = rgba >> 24 == 0 ? 0.0 : g;
            if (counts && channel == 0) cotangents[i].a = 0.0;
        }
    }
    error_sums[thread_index()] = errors;
}
