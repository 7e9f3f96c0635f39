// The colour that SH gives a Gaussian of an instance, before the instance's colour matrix and the clamp at 0. The including
// file declares SH_DEGREE and how the coefficients of bands 1 to 3 are read: `begin_sh1` for the whole band, then `sh1_of`.

// INRIA order and signs; constants are the usual normalisation factors. `base` is coefficient 0, offset included.
vec3 evaluate_sh(Instance instance, uint local, vec3 base, vec3 dir) {
    vec3 color = 0.28209479177387814 * base;
    float x = dir.x, y = dir.y, z = dir.z;
    float xx = x * x, yy = y * y, zz = z * z;
    // The spec constant removes the code of bands that no template of the scene has.
    uint degree = min(SH_DEGREE, instance.sh_degree);
    if (degree > 0) {
        begin_sh1(instance, local);
        color += 0.4886025119029199 * (-y * sh1_of(instance, local, 0) + z * sh1_of(instance, local, 1) - x * sh1_of(instance, local, 2));
    }
    if (degree > 1) {
        begin_sh2(instance, local);
        color += 1.0925484305920792 * (x * y * sh2_of(instance, local, 0) - y * z * sh2_of(instance, local, 1) - x * z * sh2_of(instance, local, 3));
        color += 0.31539156525252005 * (2.0 * zz - xx - yy) * sh2_of(instance, local, 2);
        color += 0.5462742152960396 * (xx - yy) * sh2_of(instance, local, 4);
    }
    if (degree > 2) {
        begin_sh3(instance, local);
        color += -0.5900435899266435 * y * (3.0 * xx - yy) * sh3_of(instance, local, 0);
        color += 2.890611442640554 * x * y * z * sh3_of(instance, local, 1);
        color += -0.4570457994644658 * y * (4.0 * zz - xx - yy) * sh3_of(instance, local, 2);
        color += 0.3731763325901154 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy) * sh3_of(instance, local, 3);
        color += -0.4570457994644658 * x * (4.0 * zz - xx - yy) * sh3_of(instance, local, 4);
        color += 1.445305721320277 * z * (xx - yy) * sh3_of(instance, local, 5);
        color += -0.5900435899266435 * x * (xx - 3.0 * yy) * sh3_of(instance, local, 6);
    }
    return color + 0.5;
}
