#version 460
// Second pass of the image loss: the window along columns, SSIM, and its derivatives by the moments.
//
// - Reads `row_moments` by pixel (135 bytes a pixel: 2.25 times 60). Writes `ssim_gradients` by pixel (36 bytes) and
//   `ssim_sums` by thread.
// - Grid: one thread per strip of 8 pixels of a column, neighbouring threads in neighbouring columns.
// - With a1 = 2 x y + C1, a2 = 2 (xy - x y) + C2, b1 = x^2 + y^2 + C1, b2 = var x + var y + C2: SSIM = a1 a2 / (b1 b2),
//   and the derivatives treat the means of x, x^2 and xy as independent.
//
// Twin: `instgs_reference::image_loss`. Test: `tests/kernels/image_loss.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "image_loss.glsl"

layout(scalar, binding = 0) readonly buffer RowMoments { Moments row_moments[]; };             // moments along rows, by pixel
layout(scalar, binding = 1) writeonly buffer SsimGradients { SsimGradient ssim_gradients[]; };  // derivatives of SSIM, by pixel
layout(scalar, binding = 2) writeonly buffer SsimSums { float ssim_sums[]; };                  // SSIM over the strip and channels, by thread
layout(scalar, push_constant) uniform ImageLossColumnsParams {
    uvec2 size_px;  // image width and height
};

void main() {
    uint x = thread_index() % size_px.x;
    uint first = (thread_index() / size_px.x) * STRIP;
    if (first >= size_px.y) return;
    Moments sums[STRIP];
    [[unroll]] for (uint k = 0; k < STRIP; ++k) sums[k] = Moments(vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0), vec3(0.0));
    [[unroll]] for (int tap = -int(WINDOW_RADIUS); tap < int(STRIP + WINDOW_RADIUS); ++tap) {
        int y = int(first) + tap;
        bool inside = y >= 0 && y < int(size_px.y);
        Moments m = row_moments[uint(clamp(y, 0, int(size_px.y) - 1)) * size_px.x + x];
        // Rows outside the image have colour 0.
        m.x = inside ? m.x : vec3(-SHIFT);
        m.y = inside ? m.y : vec3(-SHIFT);
        m.xx = inside ? m.xx : vec3(SHIFT * SHIFT);
        m.yy = inside ? m.yy : vec3(SHIFT * SHIFT);
        m.xy = inside ? m.xy : vec3(SHIFT * SHIFT);
        [[unroll]] for (int k = 0; k < int(STRIP); ++k) {
            if (abs(tap - k) <= int(WINDOW_RADIUS)) {
                float w = window_weight(tap - k);
                sums[k].x += w * m.x;
                sums[k].y += w * m.y;
                sums[k].xx += w * m.xx;
                sums[k].yy += w * m.yy;
                sums[k].xy += w * m.xy;
            }
        }
    }
    vec3 total = vec3(0.0);
    [[unroll]] for (uint k = 0; k < STRIP; ++k) {
        Moments m = sums[k];
        // SSIM = a1 a2 / (b1 b2); the derivatives treat xx and xy as independent variables.
        vec3 mean_x = m.x + SHIFT, mean_y = m.y + SHIFT;
        vec3 a1 = 2.0 * mean_x * mean_y + SSIM_C1;
        vec3 a2 = 2.0 * (m.xy - m.x * m.y) + SSIM_C2;
        vec3 b1 = mean_x * mean_x + mean_y * mean_y + SSIM_C1;
        vec3 b2 = max(m.xx - m.x * m.x, 0.0) + max(m.yy - m.y * m.y, 0.0) + SSIM_C2;
        vec3 scale = 1.0 / (b1 * b2);
        vec3 ssim = a1 * a2 * scale;
        bool inside = first + k < size_px.y;
        total += inside ? ssim : vec3(0.0);
        SsimGradient g;
        g.x = 2.0 * ((mean_y * a2 - m.y * a1) * scale - ssim * (mean_x / b1 - m.x / b2));
        g.xx = -ssim / b2;
        g.xy = 2.0 * a1 * scale;
        if (inside) ssim_gradients[(first + k) * size_px.x + x] = g;
    }
    ssim_sums[thread_index()] = total.r + total.g + total.b;
}
