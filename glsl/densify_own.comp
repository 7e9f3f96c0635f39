#version 460
// Makes the Gaussians that one instance gets for its own look like what it has of its template: adds its offsets, and
// applies its colour matrix, to copies of the template's Gaussians.
//
// - Reads `needs`, its exclusive scan and `firsts` (see `densify_place_own`, `densify_place`), offsets by new record, and
//   the colour matrix; updates all parameters of the new Gaussians, which hold those of the template before.
// - Grid: one thread per old Gaussian of the template. Bytes: 4 read each, and all parameters of each new Gaussian.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify_own.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"

layout(constant_id = 3) const uint SH_DEGREE = 3;

layout(scalar, binding = 0) readonly buffer Needs { uint needs[]; };                           // 1 if the instance gets a Gaussian, by old record
layout(scalar, binding = 1) readonly buffer NeedsBefore { uint needs_before[]; };               // exclusive scan of needs
layout(scalar, binding = 2) readonly buffer Firsts { uint firsts[]; };                         // new index of each old source Gaussian
layout(scalar, binding = 3) buffer Means { vec3 means[]; };                                    // centres, template frame
layout(scalar, binding = 4) buffer Quats { vec4 quats[]; };                                    // rotations, wxyz
layout(scalar, binding = 5) buffer LogScales { vec3 log_scales[]; };                           // log standard deviations
layout(scalar, binding = 6) buffer OpacityLogits { float opacity_logits[]; };                  // opacity logits
layout(scalar, binding = 7) buffer Sh0 { vec3 sh0[]; };                                        // SH band 0
layout(scalar, binding = 8) buffer Sh1 { vec3 sh1[]; };                                        // SH band 1, 3 per Gaussian
layout(scalar, binding = 9) buffer Sh2 { vec3 sh2[]; };                                        // SH band 2, 5 per Gaussian
layout(scalar, binding = 10) buffer Sh3 { vec3 sh3[]; };                                       // SH band 3, 7 per Gaussian
layout(scalar, binding = 11) readonly buffer OffsetMeans { vec3 offset_means[]; };             // by new record
layout(scalar, binding = 12) readonly buffer OffsetShDc { vec3 offset_sh_dc[]; };              // by new record
layout(scalar, binding = 13) readonly buffer OffsetLogits { float offset_opacity_logits[]; };  // by new record
layout(scalar, binding = 14) readonly buffer OffsetShRest { vec3 offset_sh_rest[]; };          // by new record and coefficient from 1, if any
layout(scalar, binding = 15) readonly buffer OffsetLogScales { vec3 offset_log_scales[]; };    // by new record, if any
layout(scalar, binding = 16) readonly buffer OffsetQuats { vec4 offset_quats[]; };             // by new record, if any
layout(scalar, binding = 17) readonly buffer ColorMatrices { vec4 color_from_template[]; };    // rows of (M | b) by instance, if any
layout(scalar, push_constant) uniform DensifyOwnParams {
    uint count;                // old Gaussians of the template
    uint first_source_before;  // its first Gaussian before
    uint first_source;         // its first Gaussian afterwards
    uint first_offset_before;  // first record of the instance before
    uint first_offset;         // first record of the instance afterwards
    uint first_new;            // index of the first Gaussian that the instance gets
    uint color;                // index of its colour matrix, NO_COLOR if it has none
    uint first_bound;          // the first new source Gaussian whose parameters are bound
    uint count_bound;          // new source Gaussians from there on that this dispatch has to do with
    uint kinds;                // bits: 1 = there are offsets of log scales, 2 = of quaternions
    uint rest;                 // SH coefficients above 0 that have offsets
};

// 1 / SH_C0: the coefficient of a constant colour.
const float COEFFICIENT_OF_COLOR = 3.5449077018110318;

vec3 linear_color(vec3 v) {
    if (color == NO_COLOR) return v;
    uint row = 3 * color;
    return vec3(dot(color_from_template[row].xyz, v), dot(color_from_template[row + 1].xyz, v),
                dot(color_from_template[row + 2].xyz, v));
}

// What M rgb + b adds to the base colour besides the linear part: coefficients sum to rgb - 0.5.
vec3 constant_color() {
    if (color == NO_COLOR) return vec3(0.0);
    uint row = 3 * color;
    vec3 shift = vec3(color_from_template[row].w, color_from_template[row + 1].w, color_from_template[row + 2].w);
    return COEFFICIENT_OF_COLOR * (linear_color(vec3(0.5)) + shift - 0.5);
}

vec3 rest_offset(uint record, uint coefficient) {
    return coefficient <= rest ? offset_sh_rest[record * rest + coefficient - 1] : vec3(0.0);
}

void main() {
    uint i = thread_index();
    if (i >= count || needs[first_offset_before + i] == 0) return;
    uint j = first_new + needs_before[first_offset_before + i] - needs_before[first_offset_before];
    // Where arrays are larger than a binding, the others are left to dispatches that see other parts.
    uint bound = j - first_bound;
    if (bound >= count_bound) return;
    uint record = first_offset + firsts[first_source_before + i] - first_source;
    means[bound] += offset_means[record];
    opacity_logits[bound] += offset_opacity_logits[record];
    if ((kinds & 1) != 0) log_scales[bound] += offset_log_scales[record];
    if ((kinds & 2) != 0) quats[bound] += offset_quats[record];
    sh0[bound] = linear_color(sh0[bound] + offset_sh_dc[record]) + constant_color();
    uint degree = SH_DEGREE;
    if (degree > 0) {
        for (uint m = 0; m < 3; ++m) sh1[3 * bound + m] = linear_color(sh1[3 * bound + m] + rest_offset(record, 1 + m));
    }
    if (degree > 1) {
        for (uint m = 0; m < 5; ++m) sh2[5 * bound + m] = linear_color(sh2[5 * bound + m] + rest_offset(record, 4 + m));
    }
    if (degree > 2) {
        for (uint m = 0; m < 7; ++m) sh3[7 * bound + m] = linear_color(sh3[7 * bound + m] + rest_offset(record, 9 + m));
    }
}
