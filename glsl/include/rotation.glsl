// Rotation matrices of Gaussians.

// Columns of the rotation of a quaternion of any length but zero.
mat3 rotation_from_quat(vec4 wxyz) {
    // Normalised in two steps, so that squares of huge or tiny components stay in range.
    vec4 q = wxyz / max(max(abs(wxyz.x), abs(wxyz.y)), max(abs(wxyz.z), abs(wxyz.w)));
    q /= sqrt(dot(q, q));
    float w = q.x, x = q.y, y = q.z, z = q.w;
    return mat3(1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y + w * z), 2.0 * (x * z - w * y),
                2.0 * (x * y - w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z + w * x),
                2.0 * (x * z + w * y), 2.0 * (y * z - w * x), 1.0 - 2.0 * (x * x + y * y));
}
