#version 460
// The way back through `apply_exposure`: gradients by the scene's colours, and by the exposure of the view.
//
// - Reads `colors` and the view's rows of `exposures`; turns `cotangents` by the exposed colours into those by the scene's,
//   M^T g, and that by alpha.
// - Writes `exposure_sums`: the gradient g (rgb, alpha)^T by the rows, summed over the pixels of a subgroup in a fixed order.
// - Grid: one thread per EXPOSURE_PIXELS pixels, a work-group apart, so that neighbours read neighbours. Bytes per pixel:
//   32 read, 16 written.
//
// Twin: `instgs_reference::exposure`. Test: `tests/kernels/exposure.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "image_loss.glsl"
#include "exposure.glsl"
#include "exposable.glsl"

layout(scalar, binding = 0) readonly buffer Colors { vec4 colors[]; };             // the picture: rgb over the background, and alpha
layout(scalar, binding = 1) readonly buffer Exposures { vec4 exposures[]; };       // rows of the exposures, three per view
layout(scalar, binding = 2) buffer Cotangents { vec4 cotangents[]; };              // in: gradient by the exposed colours; out: by the scene's, and by alpha
layout(scalar, binding = 3) writeonly buffer ExposureSums { vec4 exposure_sums[]; };  // gradient by the three rows, by work-group and subgroup
layout(scalar, push_constant) uniform ExposureBackwardParams {
    uint pixels;      // of the picture
    uint view;        // index of the training view
    vec3 background;  // colour behind the scene
};

void main() {
    uint first = group_index() * WORKGROUP_SIZE * EXPOSURE_PIXELS + gl_LocalInvocationID.x;
    // The grid may have groups past the picture, which have no sums.
    if (first - gl_LocalInvocationID.x >= pixels) return;
    uint row = EXPOSURE_ROWS * view;
    vec3 linear[3] = vec3[3](exposures[row].xyz, exposures[row + 1].xyz, exposures[row + 2].xyz);
    // What alpha adds: the exposure of the background colour, which the scene then hides.
    vec4 hidden = vec4(background, 1.0);
    vec3 by_alpha = vec3(dot(exposures[row], hidden), dot(exposures[row + 1], hidden), dot(exposures[row + 2], hidden)) - background;
    vec4 sums[3] = vec4[3](vec4(0.0), vec4(0.0), vec4(0.0));
    for (uint k = 0; k < EXPOSURE_PIXELS; ++k) {
        uint i = first + k * WORKGROUP_SIZE;
        if (i >= pixels) break;
        vec3 g = cotangents[i].rgb;
        vec4 extended = exposable(colors[i], background);
        [[unroll]] for (uint r = 0; r < 3; ++r) sums[r] += g[r] * extended;
        cotangents[i] = vec4(g.r * linear[0] + g.g * linear[1] + g.b * linear[2], dot(g, by_alpha));
    }
    for (uint mask = 1; mask < SUBGROUP_SIZE; mask *= 2) {
        uint other = gl_SubgroupInvocationID ^ mask;
        [[unroll]] for (uint r = 0; r < 3; ++r) {
            vec4 s = sums[r];
            sums[r] += vec4(subgroupShuffle(s.x, other), subgroupShuffle(s.y, other), subgroupShuffle(s.z, other), subgroupShuffle(s.w, other));
        }
    }
    uint out_row = EXPOSURE_ROWS * (group_index() * (WORKGROUP_SIZE / SUBGROUP_SIZE) + gl_SubgroupID);
    if (gl_SubgroupInvocationID == 0) {
        [[unroll]] for (uint r = 0; r < 3; ++r) exposure_sums[out_row + r] = sums[r];
    }
}
