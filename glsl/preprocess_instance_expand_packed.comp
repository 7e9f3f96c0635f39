#version 460
// The same as `preprocess_instance_expand` for scenes that are packed on the device (`scene::packed`): f16 instead of f32 for
// everything but means and colour matrices, rotations in 48 bits, offsets in f16 or in 8 bits. Training needs f32.
//
// - Reads what `preprocess_instance_expand` reads, with `shapes` (log scales and logit, by source Gaussian) instead of two
//   arrays, `offset_means` with the logit's offset as fourth number, and `offset_ranges` (by 256 offset records).
// - Writes the same, with the same grid and guarantees.
// - Bytes per Gaussian: 26 read, 8 more with offsets of f16, 4 of 8 bits. Per survivor: 12 + 6 (degree + 1)^2 read, 14 or 8 more
//   with offsets; 76 written.
//
// Twin: `instgs_reference::preprocess_instance_expand` of the scene that `PackedScene::unpacked` gives. Tests:
// `tests/kernels/packed.rs`.
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
layout(scalar, binding = 4) readonly buffer Shapes { uint shapes[]; };                         // log standard deviations and opacity logit, 2 words per source Gaussian
layout(scalar, binding = 5) readonly buffer Quats { uint quats[]; };                           // rotations, 1.5 words per source Gaussian
layout(scalar, binding = 6) readonly buffer Sh0 { uint sh0[]; };                               // SH band 0, 1.5 words per source Gaussian
layout(scalar, binding = 7) readonly buffer Sh1 { uint sh1[]; };                               // SH band 1, 4.5 words per Gaussian of degree >= 1
layout(scalar, binding = 8) readonly buffer Sh2 { uint sh2[]; };                               // SH band 2, 7.5 words per Gaussian of degree >= 2
layout(scalar, binding = 9) readonly buffer Sh3 { uint sh3[]; };                               // SH band 3, 10.5 words per Gaussian of degree 3
layout(scalar, binding = 10) readonly buffer OffsetMeans { uint packed_offset_means[]; };      // offsets of means and opacity logits, 2 words per record, or 1 of 8-bit codes
layout(scalar, binding = 11) readonly buffer OffsetShDc { uint offset_sh_dc[]; };              // offsets of SH coefficient 0, 1.5 words per record, or 1
layout(scalar, binding = 12) readonly buffer OffsetLogScales { uint offset_log_scales[]; };    // offsets of log standard deviations, if any, 1.5 words per record, or 1
layout(scalar, binding = 13) readonly buffer OffsetQuats { uint offset_quats[]; };             // offsets of quaternions, if any, 2 words per record, or 1
layout(scalar, binding = 14) readonly buffer OffsetShRest { uint offset_sh_rest[]; };          // offsets of the other SH coefficients, if any, 1.5 words each
layout(scalar, binding = 15) readonly buffer OffsetRanges { float offset_ranges[]; };          // lower limits and steps of 8-bit codes, by range of records
layout(scalar, binding = 16) readonly buffer ColorMatrices { vec4 color_from_template[]; };    // rows of (M | b) by instance, if any
layout(scalar, binding = 17) writeonly buffer Splats { Splat splats[]; };                      // projected survivors
layout(scalar, binding = 18) writeonly buffer Footprints { Footprint footprints[]; };          // extents of survivors
layout(scalar, binding = 19) writeonly buffer TileCounts { uint tile_counts[]; };              // tiles per survivor
layout(scalar, binding = 20) writeonly buffer SurvivorCounts { uint survivor_counts[]; };      // survivors per work item
layout(scalar, binding = 21) readonly buffer ClosedRuns { uint closed_runs[]; };                // LAYERED: closed tiles to the right
layout(scalar, push_constant) uniform ExpandParams {
    View view;             // the camera
    float lod_error_px;    // largest cell of a level of detail that is shown, pixels; 0 = everything at full detail
    SourceWindow window;   // WINDOWED: the source Gaussians that it sees
};

#include "layers.glsl"
#include "packed_scene.glsl"
#include "color_matrix.glsl"
#include "expand.glsl"
