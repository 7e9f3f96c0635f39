// Expands one chunk of one instance into screen-space splats: the body of `preprocess_instance_expand` and of its twin for
// packed scenes, `preprocess_instance_expand_packed`. The including file declares the buffers and how the parameters of a
// Gaussian are read: `mean_of`, `quat_of`, `log_scales_of`, `logit_of`, `sh0_of`, and the SH bands of `sh_color.glsl`.

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
        count += LAYERED != 0 ? open_tiles(columns, row, tiles.x) : max(columns.y, columns.x) - columns.x;
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
    if (LAYERED != 0) p.visible = p.visible && in_layer(z, counters[COUNTER_LAYER]);
    p.tiles = p.visible ? count_tiles(p.footprint) : 0;
    p.visible = p.visible && p.tiles > 0;
    return p;
}

Projection expand(Instance instance, uint local) {
    vec3 mean_world = transform_point(instance.world_from_template, mean_of(instance, local));
    vec3 mean_view = transform_point(view.view_from_world, mean_world);
    mat3 axes = linear_part(view.view_from_world) * linear_part(instance.world_from_template) * rotation_from_quat(quat_of(instance, local));
    vec3 sigmas = exp(log_scales_of(instance, local));
    axes = mat3(axes[0] * sigmas.x, axes[1] * sigmas.y, axes[2] * sigmas.z);
    float opacity = 1.0 / (1.0 + exp(-logit_of(instance, local)));
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
    return instance_color(instance, evaluate_sh(instance, local, sh0_of(instance, local), len > 0.0 ? dir / len : vec3(0.0, 0.0, 1.0)));
}

void main() {
    uint w = group_index();
    uint lane = gl_LocalInvocationID.x;
    bool in_range = w < counters[COUNTER_WORK_ITEMS];
    w = in_range ? w : 0;
    Instance instance = instances[work_items[w].instance];
    uint chunk_first = work_items[w].chunk * WORKGROUP_SIZE;
    // The work items of other windows are left to their dispatches.
    in_range = in_range && in_window(window, instance.first_source + chunk_first);
    enter_window(window, instance.first_source, instance.first_in_band);
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
