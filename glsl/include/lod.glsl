// Selects the level of detail of an instance: the coarsest whose cells are at most `lod_error_px` wide at the nearest
// point of the instance. The next finer level fades in gradually; the weights of the two add up to 1.
layout(constant_id = 8) const uint LEVELS = 0;  // 1 = the scene has levels of detail

// A level fades in while its cells shrink from the error to this many octaves below: a quarter, 16 % of the distance.
const float FADE_OCTAVES = 0.25;

// Pixels per template unit at the nearest point of the instance. All levels of an instance have the same ball.
float pixels_per_unit(View view, Instance instance) {
    vec3 center = transform_point(view.view_from_world, transform_point(instance.world_from_template, instance.bound_center));
    float z = max(center.z - instance.scale * instance.bound_radius, view.near);
    float px = max(view.focal_px.x, view.focal_px.y) * instance.scale / z;
    return is_below(px, 1e30) ? px : 1e30;  // NaN and infinity: full detail
}

// 0 = the cells are too wide, 1 = no finer level is needed.
float fade_in(float cell, float px, float error_px) {
    if (cell <= 0.0) return 1.0;
    float ratio = error_px / (cell * px);
    return ratio > 0.0 ? clamp(log2(ratio) / FADE_OCTAVES, 0.0, 1.0) : 0.0;  // log2(0) is undefined: at an error of 0 no level is shown
}

// Weight of an instance's level, 0 to 1.
float level_weight(View view, Instance instance, float error_px) {
    float px = pixels_per_unit(view, instance);
    return fade_in(instance.cell, px, error_px) - fade_in(instance.next_cell, px, error_px);
}

// Opacity for a fraction of the optical depth: two levels with weights that add up to 1 absorb as much light as one.
float faded(float opacity, float weight) {
    return weight < 1.0 ? 1.0 - pow(1.0 - opacity, weight) : opacity;
}
