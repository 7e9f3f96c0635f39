#version 460
// Backward pass of `preprocess_instance_expand`: from moments on the screen to gradients in the template's frame.
//
// - Reads, per survivor: its `isect_moments` (36 bytes for each tile and block, a contiguous run), splat, footprint,
//   mean, rotation, scales, offsets, SH bands 1-3 (they turn with the view direction, which depends on the mean).
// - Writes `shape_gradients` (40 bytes) and `look_gradients` (36), at work item times work-group size plus index in the chunk,
//   where `gather_gradients` finds them without a search; the rest of both must hold zeros. Writes the gradients of the
//   offsets but those of SH bands above 0, each of which belongs to one thread; they must hold zeros, too.
// - With COLOR_TERMS, reads SH band 0 and its offset as well, and writes `color_terms` (24 bytes) at the same place as
//   `shape_gradients` for instances that have a colour matrix; the rest must hold zeros.
// - With POSES, writes the gradient by the instance's pose, summed over each subgroup: 28 bytes per subgroup of a work
//   item, except for the background.
// - With WINDOWED a dispatch sees a window of the source Gaussians, and leaves out the work items of other windows.
// - Grid: one work-group per work item, indirect; threads beyond the survivors only help to sum long lists.
// - Exact derivatives of the forward pass: conic by -P G P, antialias compensation with its floor, the slope clamp (no
//   gradient to x where clamped; z keeps its own), the colour clamp at 0, SH direction into the mean.
//
// Twin: `instgs_reference::preprocess_instance_expand_backward`. Test: `tests/kernels/backward.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "counters.glsl"
#include "scene.glsl"
#include "source_window.glsl"
#include "splat.glsl"
#include "gradients.glsl"
#include "rotation.glsl"

layout(constant_id = 3) const uint SH_DEGREE = 3;
layout(constant_id = 4) const uint POSES = 0;  // 1 = sums the gradients by the poses of instances
layout(constant_id = 14) const uint COLOR_TERMS = 0;  // 1 = writes what gradients by colour matrices are made of, if COLOR_MATRICES

layout(scalar, binding = 0) readonly buffer Instances { Instance instances[]; };                    // instances, background last
layout(scalar, binding = 1) readonly buffer WorkItems { WorkItem work_items[]; };                   // visible chunks
layout(scalar, binding = 2) readonly buffer Counters { uint counters[]; };                          // COUNTER_*
layout(scalar, binding = 3) readonly buffer SurvivorCounts { uint survivor_counts[]; };             // survivors per work item
layout(scalar, binding = 4) readonly buffer Footprints { Footprint footprints[]; };                 // index in the template, by slot
layout(scalar, binding = 5) readonly buffer Splats { Splat splats[]; };                             // projected splats by slot
layout(scalar, binding = 6) readonly buffer EmissionRanges { EmissionRange emission_ranges[]; };     // by slot
layout(scalar, binding = 8) readonly buffer IsectMoments { SplatMoments isect_moments[]; };         // by emission index times blocks of a tile plus block
layout(scalar, binding = 9) readonly buffer Means { vec3 means[]; };                                // source means
layout(scalar, binding = 10) readonly buffer OffsetMeans { vec3 offset_means[]; };                  // mean offsets, template frame
layout(scalar, binding = 11) readonly buffer Quats { vec4 quats[]; };                               // source rotations, wxyz
layout(scalar, binding = 12) readonly buffer LogScales { vec3 log_scales[]; };                      // source log standard deviations
layout(scalar, binding = 13) readonly buffer Sh1 { vec3 sh1[]; };                                   // SH band 1, 3 per Gaussian of degree >= 1
layout(scalar, binding = 14) readonly buffer Sh2 { vec3 sh2[]; };                                   // SH band 2, 5 per Gaussian of degree >= 2
layout(scalar, binding = 15) readonly buffer Sh3 { vec3 sh3[]; };                                   // SH band 3, 7 per Gaussian of degree 3
layout(scalar, binding = 16) writeonly buffer ShapeGradients { ShapeGradient shape_gradients[]; };  // by work item times work-group size plus index in the chunk
layout(scalar, binding = 26) writeonly buffer LookGradients { LookGradient look_gradients[]; };      // as shape_gradients
layout(scalar, binding = 17) writeonly buffer OffsetMeanGradients { vec3 offset_mean_gradients[]; };  // by offset record
layout(scalar, binding = 18) writeonly buffer OffsetShDcGradients { vec3 offset_sh_dc_gradients[]; };  // by offset record
layout(scalar, binding = 19) writeonly buffer OffsetLogitGradients { float offset_logit_gradients[]; };  // by offset record
layout(scalar, binding = 20) writeonly buffer PoseSums { PoseGradient pose_sums[]; };  // by work item and subgroup
layout(scalar, binding = 21) readonly buffer OffsetShRest { vec3 offset_sh_rest[]; };                // offsets of SH coefficients above 0, if any
layout(scalar, binding = 22) readonly buffer OffsetLogScales { vec3 offset_log_scales[]; };          // offsets of log standard deviations, if any
layout(scalar, binding = 23) readonly buffer OffsetQuats { vec4 offset_quats[]; };                   // offsets of quaternions, if any
layout(scalar, binding = 27) writeonly buffer OffsetLogScaleGradients { vec3 offset_log_scale_gradients[]; };  // by offset record, if any
layout(scalar, binding = 28) writeonly buffer OffsetQuatGradients { vec4 offset_quat_gradients[]; };  // by offset record, if any
layout(scalar, binding = 24) readonly buffer ColorMatrices { vec4 color_from_template[]; };          // rows of (M | b) by instance, if any
layout(scalar, binding = 25) writeonly buffer ColorTermLists { ColorTerms color_terms[]; };          // as shape_gradients, if any
layout(scalar, binding = 29) readonly buffer Sh0 { vec3 sh0[]; };                                   // source SH band 0, 1 per Gaussian
layout(scalar, binding = 7) readonly buffer OffsetShDc { vec3 offset_sh_dc[]; };                   // offsets of SH coefficient 0
layout(scalar, push_constant) uniform ExpandBackwardParams {
    View view;             // the camera
    uint capacity;         // emissions that fit the buffers
    uint blocks_per_tile;  // 8x8 blocks of a tile
    uint posed_rows;       // rows of instances besides the background
    SourceWindow window;   // WINDOWED: the source Gaussians that it sees
};

#include "shape.glsl"
#include "look.glsl"
#include "sh_bands.glsl"
#include "color_matrix.glsl"

// Longer lists are summed by the whole subgroup. Most splats touch a few tiles and some touch hundreds, and while a lane sums
// those alone its subgroup waits.
const uint LONG_LIST = 32;

const SplatMoments NO_MOMENTS = SplatMoments(vec3[](vec3(0.0), vec3(0.0), vec3(0.0)));

// The sum of list entries `first` to `end` over the lanes of the subgroup, which all get it. All lanes agree on the list.
SplatMoments sum_by_subgroup(uint first, uint end) {
    SplatMoments total = NO_MOMENTS;
    for (uint base = first; base < end; base += SUBGROUP_SIZE) {
        uint i = base + gl_SubgroupInvocationID;
        SplatMoments m = isect_moments[min(i, end - 1)];
        [[unroll]] for (uint k = 0; k < 3; ++k) total.sums[k] += mix(vec3(0.0), m.sums[k], bvec3(i < end));
    }
    [[unroll]] for (uint mask = 1; mask < SUBGROUP_SIZE; mask *= 2) {
        [[unroll]] for (uint k = 0; k < 3; ++k) total.sums[k] += subgroupShuffle(total.sums[k], gl_SubgroupInvocationID ^ mask);
    }
    return total;
}

// Sums over all tiles of each lane's splat, in an order that depends on the subgroup size and the length of its list. All
// lanes of the subgroup call it; those without a splat get zeros.
SplatMoments total_moments(uint slot, bool has_splat) {
    uint first = 0, end = 0;
    if (has_splat) {
        EmissionRange range = emission_ranges[slot];
        first = min(range.first, capacity) * blocks_per_tile;
        end = min(range.end, capacity) * blocks_per_tile;
    }
    SplatMoments total = NO_MOMENTS;
    bool is_long = end - first > LONG_LIST;
    uvec4 waiting = subgroupBallot(is_long);
    while (subgroupBallotBitCount(waiting) > 0) {
        uint owner = subgroupBallotFindLSB(waiting);
        SplatMoments sum = sum_by_subgroup(subgroupShuffle(first, owner), subgroupShuffle(end, owner));
        bool mine = gl_SubgroupInvocationID == owner;
        [[unroll]] for (uint k = 0; k < 3; ++k) total.sums[k] = mix(total.sums[k], sum.sums[k], bvec3(mine));
        waiting[owner / 32] &= ~(1u << (owner % 32));
    }
    if (!is_long) {
        for (uint i = first; i < end; ++i) {
            SplatMoments m = isect_moments[i];
            [[unroll]] for (uint k = 0; k < 3; ++k) total.sums[k] += m.sums[k];
        }
    }
    return total;
}

// A Gaussian as its instance has it, in the template's frame.
struct Gaussian {
    vec3 mean;        // centre
    vec4 quat;        // rotation, not normalised
    vec3 log_scales;  // log standard deviations
};

struct Geometry {
    vec3 mean_view;  // centre, view frame
    mat3 linear;     // linear part of view_from_template
    vec3 jx, jy;     // rows of Jacobian times linear
    vec2 clamped;    // x/z and y/z in the Jacobian
    vec3 cov_sharp;  // projected covariance xx, xy, yy before dilation
    float det_sharp; // its determinant, without the cancellation
};

Geometry geometry_of(Instance instance, Gaussian gaussian, vec3 mean_world) {
    Geometry g;
    g.mean_view = transform_point(view.view_from_world, mean_world);
    g.linear = linear_part(view.view_from_world) * linear_part(instance.world_from_template);
    vec2 scale = view.focal_px / g.mean_view.z;
    g.clamped = clamp(g.mean_view.xy / g.mean_view.z, limit_min(view), limit_max(view));
    mat3 rows = transpose(g.linear);
    g.jx = scale.x * (rows[0] - g.clamped.x * rows[2]);
    g.jy = scale.y * (rows[1] - g.clamped.y * rows[2]);
    mat3 rotation = rotation_from_quat(gaussian.quat);
    vec3 sigmas = exp(gaussian.log_scales);
    vec3 bx = (g.jx * rotation) * sigmas;
    vec3 by = (g.jy * rotation) * sigmas;
    g.cov_sharp = vec3(dot(bx, bx), dot(bx, by), dot(by, by));
    vec3 area = cross(bx, by);
    g.det_sharp = dot(area, area);
    return g;
}

// The gradient by the dilated covariance (xx, xy each, yy), from that by the conic and, with antialias, by opacity.
vec3 covariance_gradient(Geometry g, vec3 conic, vec3 by_conic, float by_opacity, float opacity, out float compensation) {
    // cov = conic^-1: dL/dcov = -conic G conic.
    float a = conic.x, b = conic.y, c = conic.z;
    float ga = by_conic.x, gb = 0.5 * by_conic.y, gc = by_conic.z;
    float p = a * ga + b * gb, q = a * gb + b * gc, r = b * ga + c * gb, s = b * gb + c * gc;
    vec3 by_cov = -vec3(p * a + q * b, p * b + q * c, r * b + s * c);
    compensation = 1.0;
    if (view.antialias != 0) {
        float d = view.dilation_px2;
        vec3 sharp = g.cov_sharp;
        float det = g.det_sharp + d * (sharp.x + sharp.z) + d * d;
        float ratio = g.det_sharp / det;
        compensation = sqrt(max(2.5e-5, ratio));
        float by_ratio = ratio > 2.5e-5 ? by_opacity * (opacity / compensation) * 0.5 / compensation : 0.0;
        by_cov += by_ratio / det * vec3(sharp.z - ratio * (sharp.z + d), -sharp.y * (1.0 - ratio), sharp.x - ratio * (sharp.x + d));
    }
    return by_cov;
}

// The gradient by the centre in the view frame.
vec3 mean_view_gradient(Geometry g, vec2 by_mean_px, vec3 by_cov, Gaussian gaussian) {
    mat3 rotation = rotation_from_quat(gaussian.quat);
    vec3 variances = exp(2.0 * gaussian.log_scales);
    // Covariance times the rows of J: cov_px = j^T cov j.
    vec3 vx = rotation * (variances * (g.jx * rotation));
    vec3 vy = rotation * (variances * (g.jy * rotation));
    vec3 by_jx = 2.0 * (by_cov.x * vx + by_cov.y * vy);
    vec3 by_jy = 2.0 * (by_cov.y * vx + by_cov.z * vy);
    float z = g.mean_view.z;
    vec2 slope = g.mean_view.xy / z;
    vec2 scale = view.focal_px / z;
    vec3 depth_row = transpose(g.linear)[2];
    vec2 by_slope = -scale * vec2(dot(by_jx, depth_row), dot(by_jy, depth_row));
    by_slope = vec2(slope.x == g.clamped.x ? by_slope.x : 0.0, slope.y == g.clamped.y ? by_slope.y : 0.0);
    by_slope += by_mean_px * view.focal_px;
    float by_z = -(dot(by_jx, g.jx) + dot(by_jy, g.jy) + dot(by_slope, slope)) / z;
    return vec3(by_slope / z, by_z);
}

// The gradient by the unnormalised view direction, through the SH bands above 0. Adds these bands to `color`: each coefficient is
// read once.
vec3 direction_gradient(Instance instance, uint local, vec3 dir, vec3 by_color, inout vec3 color) {
    float x = dir.x, y = dir.y, z = dir.z;
    float xx = x * x, yy = y * y, zz = z * z;
    vec3 g = vec3(0.0);
    uint degree = min(SH_DEGREE, instance.sh_degree);
    if (degree > 0) {
        vec3 s[3] = vec3[](sh1_of(instance, local, 0), sh1_of(instance, local, 1), sh1_of(instance, local, 2));
        color += 0.4886025119029199 * (-y * s[0] + z * s[1] - x * s[2]);
        g += 0.4886025119029199 * vec3(-dot(s[2], by_color), -dot(s[0], by_color), dot(s[1], by_color));
    }
    if (degree > 1) {
        const float n[5] = float[](1.0925484305920792, -1.0925484305920792, 0.31539156525252005, -1.0925484305920792, 0.5462742152960396);
        float basis[5] = float[](x * y, y * z, 2.0 * zz - xx - yy, x * z, xx - yy);
        float c[5];
        [[unroll]] for (uint k = 0; k < 5; ++k) {
            vec3 s = n[k] * sh2_of(instance, local, k);
            color += basis[k] * s;
            c[k] = dot(s, by_color);
        }
        g += vec3(c[0] * y - 2.0 * c[2] * x + c[3] * z + 2.0 * c[4] * x, c[0] * x + c[1] * z - 2.0 * c[2] * y - 2.0 * c[4] * y,
                  c[1] * y + 4.0 * c[2] * z + c[3] * x);
    }
    if (degree > 2) {
        const float n[7] = float[](-0.5900435899266435, 2.890611442640554, -0.4570457994644658, 0.3731763325901154, -0.4570457994644658,
                                   1.445305721320277, -0.5900435899266435);
        float basis[7] = float[](y * (3.0 * xx - yy), x * y * z, y * (4.0 * zz - xx - yy), z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
                                 x * (4.0 * zz - xx - yy), z * (xx - yy), x * (xx - 3.0 * yy));
        float c[7];
        [[unroll]] for (uint k = 0; k < 7; ++k) {
            vec3 s = n[k] * sh3_of(instance, local, k);
            color += basis[k] * s;
            c[k] = dot(s, by_color);
        }
        g.x += c[0] * 6.0 * x * y + c[1] * y * z - c[2] * 2.0 * x * y - c[3] * 6.0 * x * z + c[4] * (4.0 * zz - 3.0 * xx - yy) +
               c[5] * 2.0 * x * z + c[6] * 3.0 * (xx - yy);
        g.y += c[0] * 3.0 * (xx - yy) + c[1] * x * z + c[2] * (4.0 * zz - xx - 3.0 * yy) - c[3] * 6.0 * y * z - c[4] * 2.0 * x * y -
               c[5] * 2.0 * y * z - c[6] * 6.0 * x * y;
        g.z += c[1] * x * y + c[2] * 8.0 * y * z + c[3] * (6.0 * zz - 3.0 * xx - 3.0 * yy) + c[4] * 8.0 * x * z + c[5] * (xx - yy);
    }
    return g;
}

// SH band 0 of the colour, before the instance's colour matrix.
vec3 base_color(Instance instance, uint local) {
    vec3 base = sh0[instance.first_source + local];
    if (instance.first_offset != NO_OFFSET) base += offset_sh_dc[instance.first_offset + local];
    return 0.28209479177387814 * base + 0.5;
}

struct SourceGradient {
    vec3 mean;              // by mean plus offset
    vec3 covariance;        // by the covariance's xx, yy, zz
    vec3 covariance_cross;  // by xy, xz, yz, each of the two equal entries
    LookGradient look;
};

SourceGradient source_gradient(Instance instance, uint local, Gaussian gaussian, uint slot, SplatMoments m, out vec3 by_dir,
                               out ColorTerms color) {
    Splat splat = splats[slot];
    vec3 conic = vec3(splat.a.zw, splat.b.x);
    float opacity = splat.b.y;
    vec3 first = m.sums[1], second = m.sums[2];
    vec2 by_mean_px = vec2(dot(conic.xy, first.yz), dot(conic.yz, first.yz));
    vec3 by_conic = -vec3(0.5 * second.x, second.y, 0.5 * second.z);
    float by_opacity = opacity > 0.0 ? first.x / opacity : 0.0;
    color.cotangent = mix(vec3(0.0), m.sums[0], greaterThan(vec3(splat.b.zw, splat.c.x), vec3(0.0)));
    color.color = COLOR_TERMS != 0 && has_color_matrix(instance) ? base_color(instance, local) : vec3(0.0);

    vec3 mean_world = transform_point(instance.world_from_template, gaussian.mean);
    Geometry g = geometry_of(instance, gaussian, mean_world);
    SourceGradient out_gradient;
    float compensation;
    vec3 by_cov = covariance_gradient(g, conic, by_conic, by_opacity, opacity, compensation);
    // cov_px = J cov J^T: the gradient by the template's covariance is J^T by_cov J.
    vec3 hx = by_cov.x * g.jx + by_cov.y * g.jy;
    vec3 hy = by_cov.y * g.jx + by_cov.z * g.jy;
    out_gradient.covariance = g.jx * hx + g.jy * hy;
    out_gradient.covariance_cross = vec3(g.jx.x * hx.y + g.jy.x * hy.y, g.jx.x * hx.z + g.jy.x * hy.z, g.jx.y * hx.z + g.jy.y * hy.z);

    mat3 a = linear_part(instance.world_from_template);
    vec3 seen = (mean_world - view.position_world) * a;
    float len = sqrt(dot(seen, seen));
    vec3 dir = len > 0.0 ? seen / len : vec3(0.0, 0.0, 1.0);
    vec3 by_template_color = template_color_gradient(instance, color.cotangent);
    by_dir = direction_gradient(instance, local, dir, by_template_color, color.color);
    vec3 by_seen = len > 0.0 ? (by_dir - dir * dot(dir, by_dir)) / len : vec3(0.0);
    vec3 by_view = mean_view_gradient(g, by_mean_px, by_cov, gaussian);
    out_gradient.mean = by_view * g.linear + (a * by_seen) * a;
    out_gradient.look.color = by_template_color;
    out_gradient.look.direction = dir;
    float sigmoid = opacity / compensation;
    out_gradient.look.opacity_logit = first.x * (1.0 - sigmoid);
    out_gradient.look.mean_ndc = length(by_mean_px * 0.5 * vec2(view.size_px));
    vec2 variance = g.cov_sharp.xz + view.dilation_px2;
    float middle = 0.5 * (variance.x + variance.y);
    float spread = length(vec2(0.5 * (variance.x - variance.y), g.cov_sharp.y));
    out_gradient.look.radius_px = 3.0 * sqrt(middle + spread);
    return out_gradient;
}

// This also runs for splats that blend nothing: a zero gradient times an infinite parameter would be NaN.
bool is_finite(SourceGradient g) {
    bool shape = all(is_below(g.mean, GRADIENT_MAX)) && all(is_below(g.covariance, GRADIENT_MAX)) && all(is_below(g.covariance_cross, GRADIENT_MAX));
    bool look = all(is_below(g.look.color, GRADIENT_MAX)) && all(is_below(g.look.direction, GRADIENT_MAX));
    return shape && look && all(is_below(vec3(g.look.opacity_logit, g.look.mean_ndc, g.look.radius_px), GRADIENT_MAX));
}

mat3 symmetric(vec3 diagonal, vec3 cross_terms) {
    return mat3(diagonal.x, cross_terms.x, cross_terms.y, cross_terms.x, diagonal.y, cross_terms.z, cross_terms.y, cross_terms.z,
                diagonal.z);
}

// dL/dquat and dL/dlog_scales from the symmetric dL/dcovariance: cov = sum of sigma_i^2 r_i r_i^T over the columns r_i.
ShapeGradient shape_gradient(Gaussian gaussian, SourceGradient g) {
    mat3 r = rotation_from_quat(gaussian.quat);
    vec3 variances = exp(2.0 * gaussian.log_scales);
    mat3 d = symmetric(g.covariance, g.covariance_cross) * r;
    vec3 by_log_scales = 2.0 * variances * vec3(dot(r[0], d[0]), dot(r[1], d[1]), dot(r[2], d[2]));
    d = mat3(2.0 * variances.x * d[0], 2.0 * variances.y * d[1], 2.0 * variances.z * d[2]);
    float largest = largest_component(gaussian.quat);
    vec4 scaled = by_largest(gaussian.quat);
    float len = sqrt(dot(scaled, scaled));
    vec4 q = scaled / len;
    float w = q.x, x = q.y, y = q.z, z = q.w;
    vec4 by_unit = 2.0 * vec4(x * (d[1].z - d[2].y) + y * (d[2].x - d[0].z) + z * (d[0].y - d[1].x),
                              w * (d[1].z - d[2].y) + y * (d[0].y + d[1].x) + z * (d[0].z + d[2].x) - 2.0 * x * (d[1].y + d[2].z),
                              w * (d[2].x - d[0].z) + x * (d[0].y + d[1].x) + z * (d[1].z + d[2].y) - 2.0 * y * (d[0].x + d[2].z),
                              w * (d[0].y - d[1].x) + x * (d[0].z + d[2].x) + y * (d[1].z + d[2].y) - 2.0 * z * (d[0].x + d[1].y));
    vec4 by_quat = (by_unit - q * dot(q, by_unit)) / (len * largest);
    // 0 times an infinite scale, or by a zero quaternion, would be NaN.
    return ShapeGradient(g.mean, all(is_below(by_quat, GRADIENT_MAX)) ? by_quat : vec4(0.0),
                         all(is_below(by_log_scales, GRADIENT_MAX)) ? by_log_scales : vec3(0.0));
}

// Contribution of one Gaussian to the gradient by its instance's pose. A rotation by w moves the mean by w x mean, the
// covariance C by [w]x C - C [w]x, and the view direction in the template's frame by -w x direction.
PoseGradient pose_gradient(Gaussian gaussian, SourceGradient g, vec3 by_dir) {
    mat3 rotation = rotation_from_quat(gaussian.quat);
    vec3 variances = exp(2.0 * gaussian.log_scales);
    mat3 covariance = mat3(rotation[0] * variances.x, rotation[1] * variances.y, rotation[2] * variances.z) * transpose(rotation);
    vec3 mean = gaussian.mean;
    mat3 product = covariance * symmetric(g.covariance, g.covariance_cross);
    PoseGradient p;
    p.translation = g.mean;
    p.rotation = cross(mean, g.mean) - cross(g.look.direction, by_dir) +
                 2.0 * vec3(product[2].y - product[1].z, product[0].z - product[2].x, product[1].x - product[0].y);
    p.log_scale = dot(mean, g.mean) + 2.0 * (product[0].x + product[1].y + product[2].z);
    bool finite = all(is_below(p.translation, GRADIENT_MAX)) && all(is_below(vec4(p.rotation, p.log_scale), GRADIENT_MAX));
    return finite ? p : PoseGradient(vec3(0.0), vec3(0.0), 0.0);
}

// Sums over the lanes of the subgroup in a fixed order, and writes the sum.
void write_pose_sum(uint w, PoseGradient p) {
    for (uint mask = 1; mask < SUBGROUP_SIZE; mask *= 2) {
        uint other = gl_SubgroupInvocationID ^ mask;
        p.translation += vec3(subgroupShuffle(p.translation.x, other), subgroupShuffle(p.translation.y, other), subgroupShuffle(p.translation.z, other));
        p.rotation += vec3(subgroupShuffle(p.rotation.x, other), subgroupShuffle(p.rotation.y, other), subgroupShuffle(p.rotation.z, other));
        p.log_scale += subgroupShuffle(p.log_scale, other);
    }
    if (gl_SubgroupInvocationID == 0) pose_sums[w * (WORKGROUP_SIZE / SUBGROUP_SIZE) + gl_SubgroupID] = p;
}

// Writes the gradients of survivor `lane`, whose moments are `m`; returns its contribution to the gradient by its
// instance's pose.
PoseGradient write_gradients(uint w, uint lane, SplatMoments m) {
    PoseGradient none = PoseGradient(vec3(0.0), vec3(0.0), 0.0);
    WorkItem item = work_items[w];
    Instance instance = instances[item.instance];
    enter_window(window, instance.first_source, instance.first_in_band);
    uint slot = w * WORKGROUP_SIZE + lane;
    uint local = footprints[slot].local;
    Gaussian gaussian = Gaussian(mean_of(instance, local), quat_of(instance, local), log_scales_of(instance, local));
    vec3 by_dir;
    ColorTerms color;
    SourceGradient g = source_gradient(instance, local, gaussian, slot, m, by_dir, color);
    // The buffer holds 0 wherever nothing is written.
    if (!is_finite(g)) return none;
    uint place = w * WORKGROUP_SIZE + local - item.chunk * WORKGROUP_SIZE;
    ShapeGradient by_shape = shape_gradient(gaussian, g);
    shape_gradients[place] = by_shape;
    look_gradients[place] = g.look;
    if (COLOR_TERMS != 0 && has_color_matrix(instance) && all(is_below(color.cotangent, GRADIENT_MAX))) color_terms[place] = color;
    if (instance.first_offset != NO_OFFSET) {
        uint k = instance.first_offset + local;
        offset_mean_gradients[k] = g.mean;
        offset_sh_dc_gradients[k] = 0.28209479177387814 * g.look.color;
        offset_logit_gradients[k] = g.look.opacity_logit;
        if (OFFSET_LOG_SCALES != 0) offset_log_scale_gradients[k] = by_shape.log_scales;
        if (OFFSET_QUATS != 0) offset_quat_gradients[k] = by_shape.quat;
    }
    return POSES != 0 && item.instance < posed_rows ? pose_gradient(gaussian, g, by_dir) : none;
}

void main() {
    uint w = group_index();
    uint lane = gl_LocalInvocationID.x;
    if (w >= counters[COUNTER_WORK_ITEMS]) return;
    if (WINDOWED != 0) {
        // The work items of other windows are left to their dispatches.
        WorkItem item = work_items[w];
        if (!in_window(window, instances[item.instance].first_source + item.chunk * WORKGROUP_SIZE)) return;
    }
    PoseGradient pose = PoseGradient(vec3(0.0), vec3(0.0), 0.0);
    bool survives = lane < survivor_counts[w];
    SplatMoments m = total_moments(w * WORKGROUP_SIZE + lane, survives);
    if (survives) pose = write_gradients(w, lane, m);
    if (POSES != 0 && work_items[w].instance < posed_rows) write_pose_sum(w, pose);
}
