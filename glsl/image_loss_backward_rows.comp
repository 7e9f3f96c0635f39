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

layout(scalar, binding = 0) readonly buffer SsimGradients { vec3 ssim_gradients[]; };      // derivatives of SSIM, by channel and pixel
layout(scalar, binding = 1) writeonly buffer RowGradients { vec3 row_gradients[]; };  // the same, windowed along the row
layout(scalar, push_constant) uniform ImageLossBackwardRowsParams {
    uvec2 size_px;  // image width and height
};

void main() {
    uint strips = divide_up(size_px.x, STRIP);
    uint y = thread_index() / strips;
    uint first = (thread_index() % strips) * STRIP;
    if (y >= size_px.y) return;
    uint pixels = size_px.x * size_px.y;
    [[dont_unroll]] for (uint channel = 0; channel < CHANNELS; ++channel) {
        vec3 sums[STRIP];
        [[unroll]] for (uint k = 0; k < STRIP; ++k) sums[k] = vec3(0.0);
        [[unroll]] for (int tap = -int(WINDOW_RADIUS); tap < int(STRIP + WINDOW_RADIUS); ++tap) {
            int x = int(first) + tap;
            bool inside = x >= 0 && x < int(size_px.x);
            uint i = channel * pixels + y * size_px.x + uint(clamp(x, 0, int(size_px.x) - 1));
            vec3 gradient = mix(vec3(0.0), ssim_gradients[i], bvec3(inside));
            [[unroll]] for (int k = 0; k < int(STRIP); ++k) {
                if (abs(tap - k) <= int(WINDOW_RADIUS)) sums[k] += window_weight(tap - k) * gradient;
            }
        }
        uint at = channel * pixels + y * size_px.x + first;
        [[unroll]] for (uint k = 0; k < STRIP; ++k) {
            if (first + k < size_px.x) row_gradients[at + k] = sums[k];
        }
    }
}
