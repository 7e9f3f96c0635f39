// Checks that the parameters of a Gaussian are finite. They are bound at 0 to 7; `i` is the index in what is bound of them.
layout(constant_id = 3) const uint SH_DEGREE = 3;

layout(scalar, binding = 0) readonly buffer Means { vec3 means[]; };                    // centres
layout(scalar, binding = 1) readonly buffer Quats { vec4 quats[]; };                    // rotations, wxyz
layout(scalar, binding = 2) readonly buffer LogScales { vec3 log_scales[]; };           // log standard deviations
layout(scalar, binding = 3) readonly buffer OpacityLogits { float opacity_logits[]; };  // opacity logits
layout(scalar, binding = 4) readonly buffer Sh0 { vec3 sh0[]; };                        // SH band 0
layout(scalar, binding = 5) readonly buffer Sh1 { vec3 sh1[]; };                        // SH band 1
layout(scalar, binding = 6) readonly buffer Sh2 { vec3 sh2[]; };                        // SH band 2
layout(scalar, binding = 7) readonly buffer Sh3 { vec3 sh3[]; };                        // SH band 3

bool all_finite(uint i) {
    vec4 q = quats[i];
    bool finite = is_finite(means[i]) && is_finite(q.xyz) && is_finite(q.w) && is_finite(log_scales[i])
        && is_finite(opacity_logits[i]) && is_finite(sh0[i]);
    uint degree = SH_DEGREE;
    if (degree > 0) [[unroll]] for (uint m = 0; m < 3; ++m) finite = finite && is_finite(sh1[3 * i + m]);
    if (degree > 1) [[unroll]] for (uint m = 0; m < 5; ++m) finite = finite && is_finite(sh2[5 * i + m]);
    if (degree > 2) [[unroll]] for (uint m = 0; m < 7; ++m) finite = finite && is_finite(sh3[7 * i + m]);
    return finite;
}
