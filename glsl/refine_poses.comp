#version 460
// One step of Adam on the poses of instances.
//
// - The seven values of an instance are a step in the template's frame: A' = A e^s exp(w×), t' = t + A v for
//   translation v, rotation vector w, log scale s. They start from 0 at every step and cannot degenerate.
// - Reads `pose_gradients`, reads and writes 7 pairs of moments and the transform (and the scale derived from it) of
//   each instance. A is projected back to a rotation times a scale at every step.
//   An instance with own Gaussians has two rows, which keep the same transform.
// - Grid: one thread per row of an instance besides the background; that of an instance's first row works. Does nothing after
//   an overflow (see `train_status`).
//
// Twin: `instgs_reference::poses`. Test: `tests/kernels/poses.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "gradient_limit.glsl"
#include "scene.glsl"
#include "gradients.glsl"
#include "train_status.glsl"

layout(scalar, binding = 0) readonly buffer PoseGradients { PoseGradient pose_gradients[]; };  // by instance
layout(scalar, binding = 1) readonly buffer Status { uint status[]; };                         // STATUS_*
layout(scalar, binding = 2) buffer Instances { Instance instances[]; };                        // rows of instances, background last
layout(scalar, binding = 3) buffer PoseMoments { vec2 pose_moments[]; };                       // first and second moment (running means of gradient and gradient squared), 7 per instance
layout(scalar, push_constant) uniform RefinePosesParams {
    uint posed_rows;         // rows of instances besides the background
    float translation_rate;  // learning rates divided by the bias correction of the first moment: template units
    float rotation_rate;     // radians
    float log_scale_rate;    // of the logarithm of the scale
    float beta1;             // decay of the first moment
    float beta2;             // decay of the second moment
    float second_scale;      // one over the bias correction of the second moment
    float epsilon;           // added to the square root of the second moment
};

// The same update as in `adam`: changes moment `i` and returns the step of its value.
float adam_step(uint i, float gradient, float rate) {
    // A gradient that is not finite, or whose square is not, counts as 0: it would stay in the moments for ever.
    float g = is_below(gradient, GRADIENT_LIMIT) ? gradient : 0.0;
    vec2 moments = pose_moments[i];
    moments = vec2(beta1 * moments.x + (1.0 - beta1) * g, beta2 * moments.y + (1.0 - beta2) * g * g);
    pose_moments[i] = moments;
    return -rate * moments.x / (sqrt(moments.y * second_scale) + epsilon);
}

vec3 adam_step(uint i, vec3 gradient, float rate) {
    return vec3(adam_step(i, gradient.x, rate), adam_step(i + 1, gradient.y, rate), adam_step(i + 2, gradient.z, rate));
}

// Applies the rotation by |w| about w (Rodrigues) to `a` from the right: a exp([w]x).
mat3 turned(mat3 a, vec3 w) {
    float t = dot(w, w);
    float angle = sqrt(t);
    // sin(x) / x and (1 - cos x) / x^2. Series up to half a radian: a driver's sine may be accurate to 11 bits only.
    bool small = t < 0.25;
    float s = small ? 1.0 - t / 6.0 * (1.0 - t / 20.0 * (1.0 - t / 42.0)) : sin(angle) / angle;
    float c = small ? 0.5 - t / 24.0 * (1.0 - t / 30.0 * (1.0 - t / 56.0)) : (1.0 - cos(angle)) / t;
    mat3 k = mat3(0.0, w.z, -w.y, -w.z, 0.0, w.x, w.y, -w.x, 0.0);
    return a + a * (s * k + c * (k * k));
}

void main() {
    uint k = thread_index();
    if (k >= posed_rows || status[STATUS_OVERFLOW] != 0) return;
    uint owner = instances[k].owner;
    if (k > 0 && instances[k - 1].owner == owner) return;
    PoseGradient g = pose_gradients[owner];
    vec3 translation = adam_step(7 * owner, g.translation, translation_rate);
    vec3 rotation = adam_step(7 * owner + 3, g.rotation, rotation_rate);
    float log_scale = adam_step(7 * owner + 6, g.log_scale, log_scale_rate);
    vec4 rows[3] = instances[k].world_from_template;
    mat3 before = linear_part(rows);
    vec3 moved = vec3(rows[0].w, rows[1].w, rows[2].w) + before * translation;
    mat3 a = turned(before, rotation);
    // Projected back to a rotation times a scale, so that rounding does not accumulate over steps.
    float scale = sqrt((dot(a[0], a[0]) + dot(a[1], a[1]) + dot(a[2], a[2])) / 3.0) * exp(log_scale);
    vec3 x = a[0] / sqrt(dot(a[0], a[0]));
    vec3 y = a[1] - dot(a[1], x) * x;
    y /= sqrt(dot(y, y));
    mat3 linear = transpose(scale * mat3(x, y, cross(x, y)));
    for (uint row = k; row < posed_rows && instances[row].owner == owner; ++row) {
        instances[row].world_from_template = vec4[3](vec4(linear[0], moved.x), vec4(linear[1], moved.y), vec4(linear[2], moved.z));
        // Rounded up, since bounds are multiplied by it.
        instances[row].scale = scale * 1.000001;
    }
}
