#version 460
// First pass of the image loss: the 11x11 SSIM window along rows.
//
// The loss is `(1 - lambda) L1 + lambda (1 - SSIM)`, SSIM with a Gaussian window of sigma 1.5, zero padding, mean over
// pixels and channels (as INRIA's code). Its four passes are separable: rows and columns of four moments, then rows and
// columns of three derivatives. A thread computes `STRIP` = 8 neighbouring pixels, so that it reads 18 pixels for 8 instead of
// 11 for each: loads dominate on a CPU driver. It takes one channel after the other: the sums of all three do not fit the
// registers of GPUs.
//
// - Reads `colors` (rgb over the background) and `targets` (RGBA of 8 bits; alpha is 0 for an ignored pixel, else 1 +
//   254 times its coverage, and the target is blended over the background).
// - Writes `row_moments` by pixel: windowed means of picture, target, the sum of their squares, and their product.
// - Grid: one thread per strip of a row. Bytes per pixel: 54 read (3 channels, 2.25 times 8), 48 written.
// - An ignored pixel has the target's colour in both pictures: no error, no gradient, and what was rendered there does
//   not affect its neighbours.
//
// Twin: `instgs_reference::image_loss`. Test: `tests/kernels/image_loss.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "counters.glsl"
#include "image_loss.glsl"

layout(scalar, binding = 0) readonly buffer Colors { vec4 colors[]; };         // the picture: rgb over the background, and alpha
layout(scalar, binding = 1) readonly buffer Targets { uint targets[]; };       // the target, RGBA of 8 bits
layout(scalar, binding = 2) writeonly buffer RowMoments { vec4 row_moments[]; };  // moments along the row, by channel and pixel
layout(scalar, push_constant) uniform ImageLossRowsParams {
    vec3 background;  // colour behind the target
    uvec2 size_px;    // image width and height
};

void main() {
    uint strips = divide_up(size_px.x, STRIP);
    uint y = thread_index() / strips;
    uint first = (thread_index() % strips) * STRIP;
    if (y >= size_px.y) return;
    uint pixels = size_px.x * size_px.y;
    [[dont_unroll]] for (uint channel = 0; channel < CHANNELS; ++channel) {
        vec4 sums[STRIP];
        [[unroll]] for (uint k = 0; k < STRIP; ++k) sums[k] = vec4(0.0);
        [[unroll]] for (int tap = -int(WINDOW_RADIUS); tap < int(STRIP + WINDOW_RADIUS); ++tap) {
            int x = int(first) + tap;
            bool inside = x >= 0 && x < int(size_px.x);
            uint i = y * size_px.x + uint(clamp(x, 0, int(size_px.x) - 1));
            ColorPair pair = color_pair(colors[i][channel], targets[i], channel, background[channel]);
            float a = (inside ? pair.picture : 0.0) - SHIFT;
            float b = (inside ? pair.target : 0.0) - SHIFT;
            vec4 moments = vec4(a, b, a * a + b * b, a * b);
            [[unroll]] for (int k = 0; k < int(STRIP); ++k) {
                if (abs(tap - k) <= int(WINDOW_RADIUS)) sums[k] += window_weight(tap - k) * moments;
            }
        }
        uint at = channel * pixels + y * size_px.x + first;
        [[unroll]] for (uint k = 0; k < STRIP; ++k) {
            if (first + k < size_px.x) row_moments[at + k] = sums[k];
        }
    }
}
