// Rotation matrices of Gaussians.

float largest_component(vec4 quat) {
    return max(max(abs(quat.x), abs(quat.y)), max(abs(quat.z), abs(quat.w)));
}

// A quaternion over the largest of its components. Vulkan says nothing of divisors above 2^126, whose reciprocals are denormal
// and 0 on some GPUs, so huge ones are first made smaller, by a power of two, which changes no bit.
vec4 by_largest(vec4 quat) {
    float largest = largest_component(quat);
    float smaller = largest > 1e30 ? 1.0 / 4294967296.0 : 1.0;
    return quat * smaller / (largest * smaller);
}

// Columns of the rotation of a quaternion of any length but zero.
mat3 rotation_from_quat(vec4 wxyz) {
    // Normalised in two steps, so that squares of huge or tiny components stay in range.
    vec4 q = by_largest(wxyz);
    q /= sqrt(dot(q, q));
    float w = q.x, x = q.y, y = q.z, z = q.w;
    return mat3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
                2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
                2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}
