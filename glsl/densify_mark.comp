#version 460
// Decides for every Gaussian whether it stays, and what it may grow into: a copy beside it (clone) or smaller Gaussians
// in its place (split). First pass of the strategy `densify`.
//
// - Reads the parameters (by Gaussian, in parts where they are larger than a binding; all SH bands, to check that they are finite) and `screen_statistics`.
// - Reads `uses`, `highest_logits` and `log_world_scales` (see `source_use`): a Gaussian of a template counts once per
//   instance, and its scales are those in the world.
// - Reads `own_counts` and `own_gradients` (see `densify_own_need`): where some instances grow alone, the template does not.
// - Writes `keys` (bits of the mean screen gradient, inverted: the radix sort ascends) and `values` (the index) for the
//   sort, `counts` (1 if it stays without growth), `gains` (Gaussians added by growth), both once more as numbers of
//   expanded Gaussians (`kept_expanded`, `gains_expanded`), and `growths` (`GROWTH_*`).
// - Removed are Gaussians that are not finite or whose opacity is below the limit in every instance and, while there are limits for large
//   Gaussians, those that are wider than `radius_max_px` on screen or have a scale above `log_scale_max`. The copy of a
//   clone and the children of a split have not been on screen, and children are tested by their own scale.
// - Grid: one thread per Gaussian. Bytes per Gaussian: 68 + 12 (degree + 1)^2 read, 28 written.
//
// Twin: `instgs_reference::densify`. Test: `tests/kernels/densify.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "strategy.glsl"
#include "finite.glsl"

layout(scalar, binding = 8) readonly buffer ScreenStatistics { vec3 screen_statistics[]; };  // sum of screen gradients, number of views that show it, largest radius_px
layout(scalar, binding = 9) writeonly buffer Keys { uint keys[]; };                          // ascending where the mean screen gradient descends; all ones where there is no growth
layout(scalar, binding = 10) writeonly buffer Values { uint values[]; };                     // index of the Gaussian
layout(scalar, binding = 11) writeonly buffer Counts { uint counts[]; };                     // 1 if it stays without growth, else 0
layout(scalar, binding = 12) writeonly buffer Gains { uint gains[]; };                       // additional Gaussians with growth
layout(scalar, binding = 13) writeonly buffer Growths { uint growths[]; };                   // GROWTH_*
layout(scalar, binding = 14) readonly buffer Uses { uint uses[]; };                          // number of instances that have it
layout(scalar, binding = 15) readonly buffer HighestLogits { float highest_logits[]; };      // largest opacity logit in any instance
layout(scalar, binding = 18) readonly buffer LogWorldScales { float log_world_scales[]; };   // log of the largest scale of an instance
layout(scalar, binding = 16) writeonly buffer KeptExpanded { uint kept_expanded[]; };        // `counts` times `uses`
layout(scalar, binding = 17) writeonly buffer GainsExpanded { uint gains_expanded[]; };      // `gains` times `uses`, or `own_counts`
layout(scalar, binding = 19) readonly buffer OwnCounts { uint own_counts[]; };               // instances that grow alone
layout(scalar, binding = 20) readonly buffer OwnGradients { float own_gradients[]; };        // their mean screen gradient
layout(scalar, push_constant) uniform DensifyMarkParams {
    uint first;                // the first Gaussian, whose parameters are the first that are bound
    uint count;                // Gaussians from there on
    uint split_count;          // children of a split Gaussian
    uint halves;               // 1 = splits divide the longest axis alone
    float gradient_threshold;  // mean screen gradient from which Gaussians grow
    float log_scale_split;     // log of the largest scale above which Gaussians are split instead of cloned
    float log_shrink;          // log of the divisor of the scales of children, or of the longest alone
    float logit_min;           // opacity logit below which Gaussians are removed
    float log_scale_max;       // log of the largest scale above which Gaussians are removed
    float radius_max_px;       // radius on screen above which Gaussians are removed, pixels; clones and children excepted
};

void main() {
    uint bound = thread_index();
    if (bound >= count) return;
    uint i = first + bound;
    vec3 statistics = screen_statistics[i];
    vec3 scales = log_scales[bound];
    float largest = max(max(scales.x, scales.y), scales.z) + log_world_scales[i];
    bool lives = all_finite(bound) && highest_logits[i] >= logit_min;
    bool fits = largest <= log_scale_max;
    uint kept = lives && fits && statistics.z <= radius_max_px ? 1 : 0;
    float views = max(statistics.y, 1.0);
    // A product, not a quotient: GLSL rounds products as IEEE does, but not quotients.
    bool grows = lives && is_finite(statistics.x) && statistics.x >= gradient_threshold * views;
    bool splits = largest > log_scale_split;
    vec3 children = child_log_scales(scales, log_shrink, halves != 0);
    bool children_fit = max(max(children.x, children.y), children.z) + log_world_scales[i] <= log_scale_max;
    uint grown = splits ? (children_fit ? split_count : 0) : kept + (fits ? 1 : 0);
    bool own = kept == 1 && own_counts[i] > 0;
    uint gain = grows && !own ? max(grown, kept) - kept : 0;
    float gradient = own ? own_gradients[i] : statistics.x / views;
    keys[i] = own || gain > 0 ? ~floatBitsToUint(gradient) : 0xFFFFFFFF;
    values[i] = i;
    counts[i] = kept;
    gains[i] = gain;
    kept_expanded[i] = kept * uses[i];
    gains_expanded[i] = own ? own_counts[i] : gain * uses[i];
    uint growth = splits ? GROWTH_SPLIT : GROWTH_CLONE;
    growths[i] = own ? (splits ? GROWTH_OWN_SPLIT : GROWTH_OWN_CLONE) : gain > 0 ? growth : GROWTH_NONE;
}
