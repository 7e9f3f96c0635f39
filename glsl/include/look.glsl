// Centre of a Gaussian of an instance: its template's, plus the instance's offset. The including file declares the buffers.

vec3 mean_of(Instance instance, uint local) {
    vec3 own = means[instance.first_source + local];
    if (instance.first_offset != NO_OFFSET) own += offset_means[instance.first_offset + local];
    return own;
}
