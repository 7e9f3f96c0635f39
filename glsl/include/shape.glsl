// Shape of a Gaussian of an instance: the template's plus the instance's offset. The including file declares the
// buffers. Kernels for scenes without such offsets omit the code.
layout(constant_id = 5) const uint OFFSET_LOG_SCALES = 0;  // 1 = the scene has offsets of log standard deviations
layout(constant_id = 6) const uint OFFSET_QUATS = 0;       // 1 = the scene has offsets of quaternions

vec3 log_scales_of(Instance instance, uint local) {
    vec3 own = log_scales[instance.first_source + local];
    if (OFFSET_LOG_SCALES != 0 && instance.first_offset != NO_OFFSET) own += offset_log_scales[instance.first_offset + local];
    return own;
}

// The quaternion, not normalised.
vec4 quat_of(Instance instance, uint local) {
    vec4 own = quats[instance.first_source + local];
    if (OFFSET_QUATS != 0 && instance.first_offset != NO_OFFSET) own += offset_quats[instance.first_offset + local];
    return own;
}
