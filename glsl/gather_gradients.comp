#version 460
// Sums the gradients of all instances of a template.
//
// - Reads, per chunk of source Gaussians, its template's instances in order; for each the work item of that chunk, if
//   it was not culled (`instance_chunks`, `candidate_offsets`, `candidate_visible`, `work_offsets`), and there 76 bytes
//   per Gaussian, of which 24 twice more for SH. With ONE_INSTANCE no more than one row shows a chunk, as with the background
//   and with own Gaussians: then all is read once, and nothing is summed.
// - Writes gradients by mean, quaternion (not normalised), log scales, logit and the active SH bands: 44 + 12 (degree +
//   1)^2 bytes; adds to `screen_statistics` (the input of densification) and, where instances may get own Gaussians, to
//   `record_statistics`. Instances that share a record share its sums.
// - If the scene has offsets of SH bands above 0, writes their gradients; records that are not drawn must hold zeros before.
// - With WINDOWED a dispatch sees a window of the source Gaussians, and leaves out the chunks of other windows.
// - Grid: one work-group per chunk, those from `first_chunk` on. The order of the sum is that of the instances: no atomics.
// - Does nothing after an overflow (see `train_status`).
//
// Twin: `instgs_reference::gather_gradients`. Test: `tests/kernels/backward.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "counters.glsl"
#include "scene.glsl"
#include "source_window.glsl"
#include "gradients.glsl"
#include "train_status.glsl"

layout(constant_id = 3) const uint SH_DEGREE = 3;

layout(scalar, binding = 0) readonly buffer SourceChunks { SourceChunk source_chunks[]; };             // all chunks of the source pool
layout(scalar, binding = 1) readonly buffer InstanceLists { uint instance_from_template[]; };          // instances, template by template
layout(scalar, binding = 2) readonly buffer InstanceChunks { uint instance_chunks[]; };                // chunks to test per instance, 0 if culled
layout(scalar, binding = 3) readonly buffer CandidateOffsets { uint candidate_offsets[]; };            // first candidate per instance
layout(scalar, binding = 4) readonly buffer CandidateVisible { uint candidate_visible[]; };            // 1 if the candidate became a work item
layout(scalar, binding = 5) readonly buffer WorkOffsets { uint work_offsets[]; };                      // work item of the candidate
layout(scalar, binding = 6) readonly buffer Counters { uint counters[]; };                             // COUNTER_*
layout(scalar, binding = 7) readonly buffer ShapeGradients { ShapeGradient shape_gradients[]; };       // by work item times work-group size plus index in the chunk; 0 if not drawn
layout(scalar, binding = 8) readonly buffer LookGradients { LookGradient look_gradients[]; };         // as shape_gradients
layout(scalar, binding = 9) writeonly buffer MeanGradients { vec3 mean_gradients[]; };                // by source
layout(scalar, binding = 10) writeonly buffer QuatGradients { vec4 quat_gradients[]; };                // by source
layout(scalar, binding = 11) writeonly buffer LogScaleGradients { vec3 log_scale_gradients[]; };       // by source
layout(scalar, binding = 12) writeonly buffer LogitGradients { float opacity_logit_gradients[]; };     // by source
layout(scalar, binding = 13) writeonly buffer Sh0Gradients { vec3 sh0_gradients[]; };                  // SH band 0, by source
layout(scalar, binding = 14) writeonly buffer Sh1Gradients { vec3 sh1_gradients[]; };                  // SH band 1, as the band
layout(scalar, binding = 15) writeonly buffer Sh2Gradients { vec3 sh2_gradients[]; };                  // SH band 2, as the band
layout(scalar, binding = 16) writeonly buffer Sh3Gradients { vec3 sh3_gradients[]; };                  // SH band 3, as the band
layout(scalar, binding = 17) buffer ScreenStatistics { vec3 screen_statistics[]; };                    // sum of mean_ndc, number of views that show it, largest radius_px; by source
layout(scalar, binding = 18) readonly buffer Status { uint status[]; };                                // STATUS_*
layout(scalar, binding = 19) readonly buffer Instances { Instance instances[]; };                      // instances, background last
layout(scalar, binding = 20) writeonly buffer OffsetShRestGradients { vec3 offset_sh_rest_gradients[]; };  // by offset record and coefficient from 1, if any
layout(scalar, binding = 21) buffer RecordStatistics { vec2 record_statistics[]; };                    // as the first two of screen_statistics, by offset record, if instances may get own Gaussians
layout(scalar, push_constant) uniform GatherGradientsParams {
    uint first_chunk;     // the first chunk of the dispatch
    uint chunk_count;     // its number of chunks
    SourceWindow window;  // WINDOWED: the source Gaussians that it sees
};

#include "work_item_of.glsl"

layout(constant_id = 4) const uint ONE_INSTANCE = 0;    // 1 = no more than one row shows a chunk, and it has no records
layout(constant_id = 7) const uint OFFSET_SH_REST = 0;  // SH coefficients above 0 that have offsets: 0, 3, 8 or 15
layout(constant_id = 10) const uint OWN_MAY_GROW = 0;  // 1 = instances may get Gaussians of their own

// Sums over instances.
struct Sums {
    vec3 mean;
    vec4 quat;
    vec3 log_scales;
    float opacity_logit;
    vec3 statistics;
};

const Sums NO_SUMS = Sums(vec3(0.0), vec4(0.0), vec3(0.0), 0.0, vec3(0.0));

// What a view adds to the sums for densification: the length of the gradient by the centre, and 1 if it shows the Gaussian.
vec2 seen(LookGradient look) {
    return vec2(look.mean_ndc, look.radius_px > 0.0 ? 1.0 : 0.0);
}

// SH coefficients are summed in two walks over the instances, bands 0 to 2 and band 3: the sums of all at once would leave
// room for few subgroups.
const uint LOW_COEFFICIENTS = 9;
const uint BAND_3_COEFFICIENTS = 7;

// Values of the SH basis of bands 0 to 2 at `dir`: INRIA order and signs.
float[LOW_COEFFICIENTS] low_basis(vec3 dir) {
    float x = dir.x, y = dir.y, z = dir.z;
    float xx = x * x, yy = y * y, zz = z * z;
    return float[](0.28209479177387814, -0.4886025119029199 * y, 0.4886025119029199 * z, -0.4886025119029199 * x,
                   1.0925484305920792 * x * y, -1.0925484305920792 * y * z, 0.31539156525252005 * (2.0 * zz - xx - yy),
                   -1.0925484305920792 * x * z, 0.5462742152960396 * (xx - yy));
}

float[BAND_3_COEFFICIENTS] band_3_basis(vec3 dir) {
    float x = dir.x, y = dir.y, z = dir.z;
    float xx = x * x, yy = y * y, zz = z * z;
    return float[](-0.5900435899266435 * y * (3.0 * xx - yy), 2.890611442640554 * x * y * z,
                   -0.4570457994644658 * y * (4.0 * zz - xx - yy), 0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
                   -0.4570457994644658 * x * (4.0 * zz - xx - yy), 1.445305721320277 * z * (xx - yy),
                   -0.5900435899266435 * x * (xx - 3.0 * yy));
}

// Writes the gradient by an instance's offset of SH coefficient `k`, from 1, if it has one and the coefficient is in use.
void write_rest(uint instance, uint local, uint degree, uint k, vec3 gradient) {
    if (k > OFFSET_SH_REST) return;
    uint first_offset = instances[instance].first_offset;
    if (first_offset == NO_OFFSET || k >= (degree + 1) * (degree + 1)) return;
    offset_sh_rest_gradients[(first_offset + local) * OFFSET_SH_REST + k - 1] = gradient;
}

void write_low_bands(SourceChunk chunk, uint local, uint degree, vec3 sums[LOW_COEFFICIENTS]) {
    sh0_gradients[chunk.first_source + local] = sums[0];
    if (degree > 0) {
        uint k = 3 * (chunk.first_in_band[0] + local);
        [[unroll]] for (uint m = 0; m < 3; ++m) sh1_gradients[k + m] = sums[1 + m];
    }
    if (degree > 1) {
        uint k = 5 * (chunk.first_in_band[1] + local);
        [[unroll]] for (uint m = 0; m < 5; ++m) sh2_gradients[k + m] = sums[4 + m];
    }
}

void write_band_3(SourceChunk chunk, uint local, vec3 sums[BAND_3_COEFFICIENTS]) {
    uint k = 7 * (chunk.first_in_band[2] + local);
    [[unroll]] for (uint m = 0; m < BAND_3_COEFFICIENTS; ++m) sh3_gradients[k + m] = sums[m];
}

// Gradients by bands 0 to 2, summed over instances.
void gather_low_bands(SourceChunk chunk, uint local, uint degree) {
    vec3 sums[LOW_COEFFICIENTS];
    [[unroll]] for (uint k = 0; k < LOW_COEFFICIENTS; ++k) sums[k] = vec3(0.0);
    for (uint i = 0; i < chunk.instance_count; ++i) {
        uint instance = instance_from_template[chunk.first_instance + i];
        uint w = work_item_of(instance, chunk.chunk);
        if (w != NO_WORK_ITEM) {
            vec3 color = look_gradients[w * WORKGROUP_SIZE + gl_LocalInvocationID.x].color;
            float basis[LOW_COEFFICIENTS] = low_basis(look_gradients[w * WORKGROUP_SIZE + gl_LocalInvocationID.x].direction);
            [[unroll]] for (uint k = 0; k < LOW_COEFFICIENTS; ++k) sums[k] += basis[k] * color;
            [[unroll]] for (uint k = 1; k < LOW_COEFFICIENTS; ++k) write_rest(instance, local, degree, k, basis[k] * color);
        }
    }
    write_low_bands(chunk, local, degree, sums);
}

// Gradients by band 3, summed over instances.
void gather_band_3(SourceChunk chunk, uint local) {
    vec3 sums[BAND_3_COEFFICIENTS];
    [[unroll]] for (uint k = 0; k < BAND_3_COEFFICIENTS; ++k) sums[k] = vec3(0.0);
    for (uint i = 0; i < chunk.instance_count; ++i) {
        uint instance = instance_from_template[chunk.first_instance + i];
        uint w = work_item_of(instance, chunk.chunk);
        if (w != NO_WORK_ITEM) {
            vec3 color = look_gradients[w * WORKGROUP_SIZE + gl_LocalInvocationID.x].color;
            float basis[BAND_3_COEFFICIENTS] = band_3_basis(look_gradients[w * WORKGROUP_SIZE + gl_LocalInvocationID.x].direction);
            [[unroll]] for (uint k = 0; k < BAND_3_COEFFICIENTS; ++k) sums[k] += basis[k] * color;
            [[unroll]] for (uint k = 0; k < BAND_3_COEFFICIENTS; ++k) {
                write_rest(instance, local, 3, LOW_COEFFICIENTS + k, basis[k] * color);
            }
        }
    }
    write_band_3(chunk, local, sums);
}

// Adds what an instance's work item gives a Gaussian.
void add(inout Sums sums, ShapeGradient shape, LookGradient look) {
    sums.mean += shape.mean;
    sums.quat += shape.quat;
    sums.log_scales += shape.log_scales;
    sums.opacity_logit += look.opacity_logit;
    sums.statistics.xy += seen(look);
    sums.statistics.z = max(sums.statistics.z, look.radius_px);
}

// Gradients but those by SH, and the statistics.
void write_sums(uint source, Sums sums) {
    mean_gradients[source] = sums.mean;
    quat_gradients[source] = sums.quat;
    log_scale_gradients[source] = sums.log_scales;
    opacity_logit_gradients[source] = sums.opacity_logit;
    vec3 before = screen_statistics[source];
    screen_statistics[source] = vec3(before.xy + sums.statistics.xy, max(before.z, sums.statistics.z));
}

// All gradients of a Gaussian that no more than one row shows.
void gather_one(SourceChunk chunk, uint local, uint degree) {
    uint w = NO_WORK_ITEM;
    if (chunk.instance_count > 0) w = work_item_of(instance_from_template[chunk.first_instance], chunk.chunk);
    Sums sums = NO_SUMS;
    vec3 color = vec3(0.0), direction = vec3(0.0);
    if (w != NO_WORK_ITEM) {
        LookGradient look = look_gradients[w * WORKGROUP_SIZE + gl_LocalInvocationID.x];
        add(sums, shape_gradients[w * WORKGROUP_SIZE + gl_LocalInvocationID.x], look);
        color = look.color;
        direction = look.direction;
    }
    write_sums(chunk.first_source + local, sums);
    float low[LOW_COEFFICIENTS] = low_basis(direction);
    vec3 by_low[LOW_COEFFICIENTS];
    [[unroll]] for (uint k = 0; k < LOW_COEFFICIENTS; ++k) by_low[k] = low[k] * color;
    write_low_bands(chunk, local, degree, by_low);
    if (degree < 3) return;
    float high[BAND_3_COEFFICIENTS] = band_3_basis(direction);
    vec3 by_high[BAND_3_COEFFICIENTS];
    [[unroll]] for (uint k = 0; k < BAND_3_COEFFICIENTS; ++k) by_high[k] = high[k] * color;
    write_band_3(chunk, local, by_high);
}

// All gradients of a Gaussian of a template, summed over instances.
void gather_all(SourceChunk chunk, uint local, uint degree) {
    Sums sums = NO_SUMS;
    for (uint i = 0; i < chunk.instance_count; ++i) {
        uint instance = instance_from_template[chunk.first_instance + i];
        uint w = work_item_of(instance, chunk.chunk);
        if (w != NO_WORK_ITEM) {
            LookGradient look = look_gradients[w * WORKGROUP_SIZE + gl_LocalInvocationID.x];
            add(sums, shape_gradients[w * WORKGROUP_SIZE + gl_LocalInvocationID.x], look);
            if (OWN_MAY_GROW != 0 && instances[instance].first_offset != NO_OFFSET) {
                record_statistics[instances[instance].first_offset + local] += seen(look);
            }
        }
    }
    write_sums(chunk.first_source + local, sums);
    gather_low_bands(chunk, local, degree);
    if (degree > 2) gather_band_3(chunk, local);
}

void main() {
    if (group_index() >= chunk_count) return;
    SourceChunk chunk = source_chunks[first_chunk + group_index()];
    // The chunks of other windows are left to their dispatches.
    if (!in_window(window, chunk.first_source + chunk.chunk * WORKGROUP_SIZE)) return;
    enter_window(window, chunk.first_source, chunk.first_in_band);
    uint local = chunk.chunk * WORKGROUP_SIZE + gl_LocalInvocationID.x;
    // An overflowing step is redone: its statistics must not count twice.
    if (local >= chunk.source_count || status[STATUS_OVERFLOW] != 0) return;
    uint degree = min(SH_DEGREE, chunk.sh_degree);
    if (ONE_INSTANCE != 0) {
        gather_one(chunk, local, degree);
    } else {
        gather_all(chunk, local, degree);
    }
}
