// How the colour of an instance follows from its template's. The including file declares the buffer. Scenes without such
// matrices have kernels without their code.
layout(constant_id = 9) const uint COLOR_MATRICES = 0;  // 1 = instances have colour matrices

// True if a matrix changes the colours. Those of own Gaussians and of the background are as they are.
bool has_color_matrix(Instance instance) {
    return COLOR_MATRICES != 0 && instance.color != NO_COLOR;
}

// M rgb + b; a level of an instance has its instance's matrix.
vec3 instance_color(Instance instance, vec3 rgb) {
    if (!has_color_matrix(instance)) return rgb;
    uint first = 3 * instance.color;
    vec4 extended = vec4(rgb, 1.0);
    return vec3(dot(color_from_template[first], extended), dot(color_from_template[first + 1], extended),
                dot(color_from_template[first + 2], extended));
}

// The gradient by rgb, from that by M rgb + b.
vec3 template_color_gradient(Instance instance, vec3 by_color) {
    if (!has_color_matrix(instance)) return by_color;
    uint first = 3 * instance.color;
    return by_color.r * color_from_template[first].xyz + by_color.g * color_from_template[first + 1].xyz +
           by_color.b * color_from_template[first + 2].xyz;
}
