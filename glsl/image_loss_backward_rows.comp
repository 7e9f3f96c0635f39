#version 460
// Third pass of the image loss: the window along rows, over the derivatives of SSIM (a symmetric window with zero
// padding is its own adjoint).
//
// - Reads `ssim_gradients` (81 bytes a pixel), writes `row_gradients` (36 bytes), by pixel.
// - Grid: one thread per strip of a row.
//
// Twin: `instgs_reference::image_loss`. Test: `tests/kernels/image_loss.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "counters.glsl"
#include "image_loss.glsl"

layout(scalar, binding = 0) readonly buffer SsimGradients { SsimGradient ssim_gradients[]; };          // derivatives of SSIM, by pixel
layout(scalar, binding = 1) writeonly buffer RowGradients { SsimGradient row_gradients[]; };  // derivatives of SSIM, windowed along the row
layout(scalar, push_constant) uniform ImageLossBackwardRowsParams {
    uvec2 size_px;  // image width and height
};

void main() {
    uint strips = divide_up(size_px.x, STRIP);
    uint y = thread_index() / strips;
    uint first = (thread_index() % strips) * STRIP;
    if (y >= size_px.y) return;
    SsimGradient sums[STRIP];
    [[unroll]] for (uint k = 0; k < STRIP; ++k) sums[k] = SsimGradient(vec3(0.0), vec3(0.0), vec3(0.0));
    [[unroll]] for (int tap = -int(WINDOW_RADIUS); tap < int(STRIP + WINDOW_RADIUS); ++tap) {
        int x = int(first) + tap;
        float inside = x >= 0 && x < int(size_px.x) ? 1.0 : 0.0;
        SsimGradient g = ssim_gradients[y * size_px.x + uint(clamp(x, 0, int(size_px.x) - 1))];
        [[unroll]] for (int k = 0; k < int(STRIP); ++k) {
            if (abs(tap - k) <= int(WINDOW_RADIUS)) {
                float w = inside * window_weight(tap - k);
                sums[k].x += w * g.x;
                sums[k].xx += w * g.xx;
                sums[k].xy += w * g.xy;
            }
        }
    }
    [[unroll]] for (uint k = 0; k < STRIP; ++k) {
        if (first + k < size_px.x) row_gradients[y * size_px.x + first + k] = sums[k];
    }
}
