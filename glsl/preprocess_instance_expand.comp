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
// With LAYERED only splats of the layer survive, and of these only open tiles count (`layers.glsl`).
//
// With WINDOWED the source arrays are larger than a binding: a dispatch sees a window of them and leaves out the work items
// of other windows (`source_window.glsl`).
//
// Kernels for scenes without offsets of shape, or of SH bands above 0, omit the code.
//
// - Reads `work_items` (by work item), `instances` (by instance), source arrays `means` .. `sh0` (by `first_source` +
//   local index), SH bands `sh1` .. `sh3` (by `first_in_band` + local index; 3, 5, 7 coefficients), offsets (by
//   `first_offset` + local index), `counters`.
// - Writes `splats`, `footprints`, `tile_counts` (by slot = `work item * WORKGROUP_SIZE + rank`), `survivor_counts`
//   (by work item). Slots from the last survivor to the end of a work item are not written.
// - Grid: one work-group per work item, indirect (`FAMILY_WORK_ITEMS`, `ARGS_ITEMS`); one thread per Gaussian.
// - Bytes per Gaussian: 44 read, 16 more with offsets, 28 more with those of shape. Per survivor: 12 + 12 (degree + 1)^2
//   read, 24 more with offsets; 76 written (splat 40, footprint 32, tile count 4). Per work item: 140 read, 4 written.
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
#include "source_window.glsl"
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
layout(scalar, binding = 22) readonly buffer ClosedRuns { uint closed_runs[]; };                // LAYERED: closed tiles to the right
layout(scalar, push_constant) uniform ExpandParams {
    View view;             // the camera
    float lod_error_px;    // largest cell of a level of detail that is shown, pixels; 0 = everything at full detail
    SourceWindow window;   // WINDOWED: the source Gaussians that it sees
};

#include "layers.glsl"
#include "shape.glsl"
#include "look.glsl"
#include "sh_bands.glsl"
#include "color_matrix.glsl"

float logit_of(Instance instance, uint local) {
    float own = opacity_logits[instance.first_source + local];
    if (instance.first_offset != NO_OFFSET) own += offset_opacity_logits[instance.first_offset + local];
    return own;
}

vec3 sh0_of(Instance instance, uint local) {
    vec3 own = sh0[instance.first_source + local];
    if (instance.first_offset != NO_OFFSET) own += offset_sh_dc[instance.first_offset + local];
    return own;
}

#include "expand.glsl"
