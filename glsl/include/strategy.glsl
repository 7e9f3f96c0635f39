// Codes and counters of the strategies that change the number of Gaussians between steps.

const uint COUNTER_GAUSSIANS = 10;    // Gaussians before: written by the host
const uint COUNTER_KEPT = 11;         // expanded Gaussians that stay if nothing grows
const uint COUNTER_DENSIFIED = 12;    // Gaussians after
const uint COUNTER_CLONED = 13;       // Gaussians that got a copy
const uint COUNTER_SPLIT = 14;        // Gaussians that were replaced by children
const uint COUNTER_WEIGHTS = 11;      // sum of the fixed-point opacities that relocation draws from
const uint COUNTER_RELOCATED = 13;    // dead Gaussians that were moved onto others

const uint GROWTH_NONE = 0;           // no growth: stays or is removed
const uint GROWTH_CLONE = 1;          // leaves a copy, and stays or is removed
const uint GROWTH_SPLIT = 2;          // is replaced by children
const uint GROWTH_OWN_CLONE = 3;      // stays, and leaves a copy to some instances for their own
const uint GROWTH_OWN_SPLIT = 4;      // stays, and leaves a smaller Gaussian to some instances for their own

const uint MADE_KEPT = 0;             // unchanged Gaussian, with its moments
const uint MADE_CLONE = 1;            // copy of a clone
const uint MADE_CHILD = 2;            // and above: child number `made - MADE_CHILD` of a split Gaussian, or of an instance by its index

// The longest axis of a Gaussian; of equal ones the first.
uint longest_axis(vec3 log_scales) {
    if (log_scales.x >= log_scales.y && log_scales.x >= log_scales.z) return 0;
    return log_scales.y >= log_scales.z ? 1 : 2;
}

// Logs of the scales of a split Gaussian's children: of all axes, or of the longest alone, the divisor is taken off.
vec3 child_log_scales(vec3 log_scales, float log_shrink, bool halves) {
    if (!halves) return log_scales - log_shrink;
    log_scales[longest_axis(log_scales)] -= log_shrink;
    return log_scales;
}
