#version 460
// Second pass of the image loss: the window along columns, SSIM, and its derivatives by the moments.
//
// - Reads `row_moments` by pixel (108 bytes a pixel: 2.25 times 48). Writes `ssim_gradients` by pixel (36 bytes) and
//   `ssim_sums` by thread.
// - Grid: one thread per strip of 8 pixels of a column, neighbouring threads in neighbouring columns.
//
// Twin: `instgs_reference::image_loss`. Test: `tests/kernels/image_loss.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "image_loss.glsl"

layout(scalar, binding = 0) readonly buffer RowMoments { vec4 row_moments[]; };             // moments along rows, by channel and pixel
layout(scalar, binding = 1) writeonly buffer SsimGradients { vec3 ssim_gradients[]; };  // derivatives of SSIM, by channel and pixel
layout(scalar, binding = 2) writeonly buffer SsimSums { float ssim_sums[]; };                  // SSIM over the strip and channels, by thread
layout(scalar, push_constant) uniform ImageLossColumnsParams {
    uvec2 size_px;  // image width and height
};

// Moments along a row outside the image.
const vec4 OUTSIDE = vec4(-SHIFT, -SHIFT, 2.0 * SHIFT * SHIFT, SHIFT * SHIFT);

// SSIM = l s with l = (2 x y + C1) / (x^2 + y^2 + C1) and s = (2 cov + C2) / (var x + var y + C2), and its derivatives, which
// treat the moments as independent variables.
vec3 ssim_gradient(vec4 moments, out float ssim) {
    float x = moments.x + SHIFT, y = moments.y + SHIFT;
    float by_means = 1.0 / (x * x + y * y + SSIM_C1);
    float variances = max(moments.z - moments.x * moments.x - moments.y * moments.y, 0.0);
    float by_variances = 1.0 / (variances + SSIM_C2);
    float l = (2.0 * x * y + SSIM_C1) * by_means;
    float s = (2.0 * (moments.w - moments.x * moments.y) + SSIM_C2) * by_variances;
    ssim = l * s;
    float by_x = s * by_means * (y - l * x) - l * by_variances * (moments.y - s * moments.x);
    return vec3(2.0 * by_x, -ssim * by_variances, 2.0 * l * by_variances);
}

void main() {
    uint x = thread_index() % size_px.x;
    uint first = (thread_index() / size_px.x) * STRIP;
    if (first >= size_px.y) return;
    uint pixels = size_px.x * size_px.y;
    float total = 0.0;
    [[dont_unroll]] for (uint channel = 0; channel < CHANNELS; ++channel) {
        vec4 sums[STRIP];
        [[unroll]] for (uint k = 0; k < STRIP; ++k) sums[k] = vec4(0.0);
        [[unroll]] for (int tap = -int(WINDOW_RADIUS); tap < int(STRIP + WINDOW_RADIUS); ++tap) {
            int y = int(first) + tap;
            bool inside = y >= 0 && y < int(size_px.y);
            uint i = channel * pixels + uint(clamp(y, 0, int(size_px.y) - 1)) * size_px.x + x;
            // Rows outside the image have colour 0.
            vec4 moments = mix(OUTSIDE, row_moments[i], bvec4(inside));
            [[unroll]] for (int k = 0; k < int(STRIP); ++k) {
                if (abs(tap - k) <= int(WINDOW_RADIUS)) sums[k] += window_weight(tap - k) * moments;
            }
        }
        [[unroll]] for (uint k = 0; k < STRIP; ++k) {
            float ssim;
            vec3 gradient = ssim_gradient(sums[k], ssim);
            if (first + k < size_px.y) {
                total += ssim;
                ssim_gradients[channel * pixels + (first + k) * size_px.x + x] = gradient;
            }
        }
    }
    ssim_sums[thread_index()] = total;
}
