// SH bands 1 to 3 of a Gaussian of an instance: its template's, plus the instance's offset. The including file declares the
// buffers. Scenes without offsets of these bands, which are nearly all, have kernels without their code.
layout(constant_id = 7) const uint OFFSET_SH_REST = 0;  // SH coefficients above 0 that have offsets: 0, 3, 8 or 15

// `own` plus the offset of SH coefficient `c`, from 1.
vec3 with_sh_offset(Instance instance, uint local, uint c, vec3 own) {
    if (c <= OFFSET_SH_REST && instance.first_offset != NO_OFFSET) {
        own += offset_sh_rest[(instance.first_offset + local) * OFFSET_SH_REST + c - 1];
    }
    return own;
}

vec3 sh1_of(Instance instance, uint local, uint m) {
    return with_sh_offset(instance, local, 1 + m, sh1[3 * (instance.first_in_band[0] + local) + m]);
}

vec3 sh2_of(Instance instance, uint local, uint m) {
    return with_sh_offset(instance, local, 4 + m, sh2[5 * (instance.first_in_band[1] + local) + m]);
}

vec3 sh3_of(Instance instance, uint local, uint m) {
    return with_sh_offset(instance, local, 9 + m, sh3[7 * (instance.first_in_band[2] + local) + m]);
}

// Coefficients are read one by one: nothing is kept for a band.
void begin_sh1(Instance instance, uint local) {}

void begin_sh2(Instance instance, uint local) {}

void begin_sh3(Instance instance, uint local) {}
