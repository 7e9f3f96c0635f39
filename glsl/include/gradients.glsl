// Records that the backward passes pass to each other.

// Contribution of the pixels of one block to a splat: with s = -dL/dsigma per pixel and d = pixel - centre, sums of s
// times the monomials of d up to degree 2. Every derivative by centre, conic and opacity is linear in them.
struct SplatMoments {
    vec3 sums[3];  // dL/dcolour; sums of s, s dx, s dy; sums of s dx dx, s dx dy, s dy dy
};

// The gradient by one Gaussian of one instance, in the template's frame, in two arrays: one of both would be too large for a
// binding of 128 MiB from 1.9 million Gaussians on.
struct ShapeGradient {
    vec3 mean;        // by mean plus offset
    vec4 quat;        // by quaternion plus offset, not normalised
    vec3 log_scales;  // by log standard deviations plus offset
};

struct LookGradient {
    vec3 color;           // by the template's colour, 0 where that of the instance is clamped
    vec3 direction;       // unit view direction, where SH are evaluated
    float opacity_logit;  // by the logit plus offset
    float mean_ndc;       // length of the gradient by the centre, in units of half the image
    float radius_px;      // three standard deviations on the screen
};

// What one Gaussian adds to the gradient by its instance's colour matrix: the outer product of `cotangent` and (color, 1).
struct ColorTerms {
    vec3 cotangent;  // by the colour after the matrix, 0 where that is clamped
    vec3 color;      // the template's, before the matrix
};

// The gradient by the pose of an instance, for a step applied before its transform, in the template's frame: A' = A
// exp(log_scale) exp([rotation]x), t' = t + A translation.
struct PoseGradient {
    vec3 translation;  // by the translation, template units
    vec3 rotation;     // by the rotation vector, radians
    float log_scale;   // by the logarithm of the scale
};

// Gradients that reach this limit are dropped, so that sums over instances stay finite.
const float GRADIENT_MAX = 1e30;

// A chunk of source Gaussians, with the instances that show it.
struct SourceChunk {
    uint first_source;    // index of the template's first Gaussian in the source pool
    uint source_count;    // Gaussians of the template
    uint chunk;           // chunk within the template
    uint first_instance;  // the template's first entry in the list of instances by template
    uint instance_count;  // instances of the template
    uint sh_degree;       // SH degree of the template
    uvec3 first_in_band;  // index of the template's first Gaussian in SH bands 1, 2, 3
};
