#version 460
// Expands one chunk of one instance into screen-space splats.
//
// First half, every Gaussian: `mean_world = A (mean_t + d_mean) + t`, opacity = sigmoid of the logit plus its offset,
// EWA projection (Zwicker et al. 2001) `cov_px = J W A cov_t A^T W^T J^T + dilation` with the slopes of J clamped, the
// extent of alpha >= 1/255, and the number of tiles it touches. Second half, survivors only: SH in direction
// `R^T (mean_world - camera)`, normalised.
//
// With levels of detail (LEVELS), a level that is blended with another has opacity `1 - (1 - opacity)^weight`: the
// weights of the two levels add up to 1, so together they absorb as much light as one (`lod.glsl`).
//
// With COLOR_MATRICES the colour of an instance is `M rgb + b` of the template's, offsets included, before the clamp at 0.
//
// Offsets of SH bands above 0 and of shape exist for ablations; kernels for scenes without them omit the code.
//
// - Reads `work_items` (by work item), `instances` (by instance), source arrays `means` .. `sh0` (by `first_source` +
//   local index), SH bands `sh1` .. `sh3` (by `first_in_band` + local index; 3, 5, 7 coefficients), offsets (by
//   `first_offset` + local index), `counters`.
// - Writes `splats`, `footprints`, `tile_counts` (by slot = `work item * WORKGROUP_SIZE + rank`), `survivor_counts`
//   (by work item). Slots from the last survivor to the end of a work item are not written.
// - Grid: one work-group per work item, indirect (`FAMILY_WORK_ITEMS`, `ARGS_ITEMS`); one thread per Gaussian.
// - Bytes per Gaussian: 44 read, 16 more with offsets. Per survivor: 12 + 12 (degree + 1)^2 read, 24 more with
//   offsets; 72 written (splat 40, footprint 28, tile count 4). Per work item: 132 read, 4 written.
// - Guarantees: ranks come from ballots and a count per subgroup, so slots follow flat order and no atomic is used.
//   Guards (depth > near, opacity >= 1/255, finite sizes) are phrased so that NaN fails them. A splat whose colour is
//   not finite keeps its tiles with opacity 0: it blends nothing. Every survivor touches at least one tile and has
//   opacity >= 1/255, that poisoned case apart.
// - Constants: Jacobian slopes are clamped 15 % of the image beyond its borders; 2.5e-5 = 0.005^2 is the floor of the
//   antialias compensation; the extent is enlarged (`1.001 ln(255 opacity) + 0.01`) for drivers' `log`; determinants
//   below 1e30, variances, centres and depths below 1e15 keep later products finite.
//
// Twin: `instgs_reference::preprocess_instance_expand`, `instgs_reference::lod`. Tests: `tests/kernels/preprocess_instance_expand.rs`
// (splat by splat), `lod.rs`, `forward.rs`, `intersections.rs`, `poison.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "counters.glsl"
#include "scene.glsl"
#include "lod.glsl"
#include "splat.glsl"
#include "rotation.glsl"

layout(constant_id = 3) const uint SH_DEGREE = 3;

layout(scalar, binding = 0) readonly buffer Instances { Instance instances[]; };               // instances, background last
layout(scalar, binding = 1) readonly buffer WorkItems { WorkItem work_items[]; };              // visible chunks
layout(scalar, binding = 2) readonly buffer Counters { uint counters[]; };                     // COUNTER_*
layout(scalar, binding = 3) readonly buffer Means { vec3 means[]; };                           // source means
layout(scalar, binding = 4) readonly buffer Quats { vec4 quats[]; };                           // source rotations, wxyz
layout(scalar, binding = 5) readonly buffer LogScales { vec3 log_scales[]; };                  // source log standard deviations
layout(scalar, binding = 6) readonly buffer OpacityLogits { float opacity_logits[]; };         // source opacity logits
layout(scalar, binding = 7) readonly buffer Sh0 { vec3 sh0[]; };                               // source SH band 0, 1 per Gaussian
layout(scalar, binding = 15) readonly buffer Sh1 { vec3 sh1[]; };                              // SH band 1, 3 per Gaussian of degree >= 1
layout(scalar, binding = 16) readonly buffer Sh2 { vec3 sh2[]; };                              // SH band 2, 5 per Gaussian of degree >= 2
layout(scalar, binding = 17) readonly buffer Sh3 { vec3 sh3[]; };                              // SH band 3, 7 per Gaussian of degree 3
layout(scalar, binding = 8) readonly buffer OffsetMeans { vec3 offset_means[]; };              // mean offsets, template frame
layout(scalar, binding = 9) readonly buffer OffsetShDc { vec3 offset_sh_dc[]; };               // offsets of SH coefficient 0
layout(scalar, binding = 10) readonly buffer OffsetLogits { float offset_opacity_logits[]; };  // offsets of opacity logits
layout(scalar, binding = 11) writeonly buffer Splats { Splat splats[]; };                      // projected survivors
layout(scalar, binding = 12) writeonly buffer Footprints { Footprint footprints[]; };          // extents of survivors
layout(scalar, binding = 13) writeonly buffer TileCounts { uint tile_counts[]; };              // tiles per survivor
layout(scalar, binding = 14) writeonly buffer SurvivorCounts { uint survivor_counts[]; };      // survivors per work item
layout(scalar, binding = 18) readonly buffer OffsetShRest { vec3 offset_sh_rest[]; };           // offsets of the other SH coefficients, if any
layout(scalar, binding = 19) readonly buffer OffsetLogScales { vec3 offset_log_scales[]; };     // offsets of log standard deviations, if any
layout(scalar, binding = 20) readonly buffer OffsetQuats { vec4 offset_quats[]; };              // offsets of quaternions, if any
layout(scalar, binding = 21) readonly buffer ColorMatrices { vec4 color_from_template[]; };      // rows of (M | b) by instance, if any
layout(scalar, push_constant) uniform ExpandParams {
    View view;             // the camera
    float lod_error_px;    // largest cell of a level of detail that is shown, pixels; 0 = everything at full detail
};

#include "shape.glsl"
#include "look.glsl"
#include "sh_bands.glsl"
#include "color_matrix.glsl"

// Geometry of survivors between the two halves of the kernel, by rank.
shared vec4 shared_a[WORKGROUP_SIZE];
shared vec4 shared_b[WORKGROUP_SIZE];  // conic yy, opacity, depth, unused
shared uint shared_source[WORKGROUP_SIZE];
shared uint subgroup_survivors[64];

const float COLOR_LIMIT = 1e15;

struct Projection {
    bool visible;
    vec4 a;
    float conic_yy;
    float opacity;
    float depth;
    Footprint footprint;
    uint tiles;
};

uint count_tiles(Footprint f) {
    uvec2 tiles = (view.size_px + TILE_SIZE - 1) / TILE_SIZE;
    uvec2 rows = tile_rows(f, tiles.y);
    uint count = 0;
    for (uint row = rows.x; row < rows.y; ++row) {
        uvec2 columns = tile_columns(f, row, tiles.x);
        count += max(columns.y, columns.x) - columns.x;
    }
    return count;
}

// EWA projection of a Gaussian with standard-deviation frame `axes` (columns: local axes times sigma, view frame).
Projection project(vec3 mean_view, mat3 axes, float opacity) {
    Projection p;
    float z = mean_view.z;
    vec2 slope = mean_view.xy / z;
    vec2 clamped = clamp(slope, limit_min(view), limit_max(view));
    vec2 scale = view.focal_px / z;
    // Rows of J times the axes: cov2d = B B^T + dilation.
    vec3 bx = scale.x * (vec3(axes[0].x, axes[1].x, axes[2].x) - clamped.x * vec3(axes[0].z, axes[1].z, axes[2].z));
    vec3 by = scale.y * (vec3(axes[0].y, axes[1].y, axes[2].y) - clamped.y * vec3(axes[0].z, axes[1].z, axes[2].z));
    float d = view.dilation_px2;
    float xx = dot(bx, bx), yy = dot(by, by), xy = dot(bx, by);
    vec3 area = cross(bx, by);
    float det_sharp = dot(area, area);  // Lagrange: xx yy - xy^2 without the cancellation
    float det = det_sharp + d * (xx + yy) + d * d;
    xx += d;
    yy += d;
    if (view.antialias != 0) opacity *= sqrt(max(2.5e-5, det_sharp / det));
    p.a = vec4(view.focal_px * slope + view.principal_px, yy / det, -xy / det);
    p.conic_yy = xx / det;
    p.opacity = opacity;
    p.depth = z;
    // Distance in standard deviations at which alpha falls to 1/255, enlarged: the log of the drivers tested is good to
    // 1e-4 at worst, and a larger extent only costs time.
    float tau = log(255.0 * opacity) * 1.001 + 0.01;
    p.footprint.mean_px = p.a.xy;
    p.footprint.half_px = sqrt(2.0 * tau * vec2(xx, yy));
    p.footprint.slope = xy / yy;
    p.footprint.chord_px = sqrt(2.0 * tau * det / yy);
    p.footprint.extreme_dy = p.footprint.half_px.x * xy / xx;
    // Products of two of these stay finite in f32.
    bool in_range = is_below(z, 1e15) && all(is_below(vec4(p.a.xy, xx, yy), 1e15)) && is_below(det, 1e30) && is_below(opacity, 2.0);
    p.visible = z > view.near && opacity >= 1.0 / 255.0 && det > 0.0 && in_range;
    p.tiles = p.visible ? count_tiles(p.footprint) : 0;
    p.visible = p.visible && p.tiles > 0;
    return p;
}

Projection expand(Instance instance, uint local) {
    vec3 mean_world = transform_point(instance.world_from_template, mean_of(instance, local));
    vec3 mean_view = transform_point(view.view_from_world, mean_world);
    float logit = opacity_logits[instance.first_source + local];
    if (instance.first_offset != NO_OFFSET) logit += offset_opacity_logits[instance.first_offset + local];
    mat3 axes = linear_part(view.view_from_world) * linear_part(instance.world_from_template) * rotation_from_quat(quat_of(instance, local));
    vec3 sigmas = exp(log_scales_of(instance, local));
    axes = mat3(axes[0] * sigmas.x, axes[1] * sigmas.y, axes[2] * sigmas.z);
    float opacity = 1.0 / (1.0 + exp(-logit));
    if (LEVELS != 0) opacity = faded(opacity, level_weight(view, instance, lod_error_px));
    return project(mean_view, axes, opacity);
}

#include "sh_color.glsl"

vec3 splat_color(Instance instance, uint local) {
    vec3 mean_world = transform_point(instance.world_from_template, mean_of(instance, local));
    vec3 dir_world = mean_world - view.position_world;
    // R^T dir, with R = A / scale: the view direction in the template's frame, so that SH turn with the instance.
    vec3 dir = transpose(linear_part(instance.world_from_template)) * dir_world;
    float len = sqrt(dot(dir, dir));
    vec3 dc_offset = vec3(0.0);
    if (instance.first_offset != NO_OFFSET) dc_offset = offset_sh_dc[instance.first_offset + local];
    return instance_color(instance, evaluate_sh(instance, local, dc_offset, len > 0.0 ? dir / len : vec3(0.0, 0.0, 1.0)));
}

void main() {
    uint w = group_index();
    uint lane = gl_LocalInvocationID.x;
    bool in_range = w < counters[COUNTER_WORK_ITEMS];
    w = in_range ? w : 0;
    Instance instance = instances[work_items[w].instance];
    uint chunk_first = work_items[w].chunk * WORKGROUP_SIZE;
    uint local = chunk_first + lane;
    Projection p;
    p.visible = false;
    if (in_range && local < instance.source_count) p = expand(instance, local);

    uvec4 ballot = subgroupBallot(p.visible);
    uint rank = subgroupBallotExclusiveBitCount(ballot);
    if (subgroupElect()) subgroup_survivors[gl_SubgroupID] = subgroupBallotBitCount(ballot);
    barrier();
    uint survivors = 0;
    for (uint s = 0; s < WORKGROUP_SIZE / SUBGROUP_SIZE; ++s) {
        rank += s < gl_SubgroupID ? subgroup_survivors[s] : 0;
        survivors += subgroup_survivors[s];
    }
    if (p.visible) {
        shared_a[rank] = p.a;
        shared_b[rank] = vec4(p.conic_yy, p.opacity, p.depth, 0.0);
        shared_source[rank] = local;
        p.footprint.local = local;
        footprints[w * WORKGROUP_SIZE + rank] = p.footprint;
        tile_counts[w * WORKGROUP_SIZE + rank] = p.tiles;
    }
    barrier();
    if (lane == 0 && in_range) survivor_counts[w] = survivors;
    if (lane < survivors) {
        vec3 color = splat_color(instance, shared_source[lane]);
        vec4 b = shared_b[lane];
        // A colour that is not finite (poisoned SH) must not spread: such a splat gets opacity 0. So does one with an
        // absurd colour, which would turn the gradients of all splats blended with it infinite.
        bool finite = all(is_below(color, 3.4e38)) && all(lessThan(color, vec3(COLOR_LIMIT)));
        b.y = finite ? b.y : 0.0;
        color = finite ? max(color, 0.0) : vec3(0.0);
        splats[w * WORKGROUP_SIZE + lane] = Splat(shared_a[lane], vec4(b.xy, color.rg), vec2(color.b, b.z));
    }
}
