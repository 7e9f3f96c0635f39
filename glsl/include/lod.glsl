// Which level of detail of an instance is shown: the coarsest whose cells are at most so many pixels wide where the
// instance is nearest. The next finer one fades over, so nothing pops; the two have weights that add up to 1.
layout(constant_id = 8) const uint LEVELS = 0;  // 1 = the scene has levels of detail

// A level fades in while its cells go from the error to this many octaves below it: a quarter, 16 % of the distance.
const float FADE_OCTAVES = 0.25;

// Pixels that a template unit is wide where the instance is nearest. All levels of an instance have the same ball.
float pixels_per_unit(View view, Instance instance) {
    vec3 center = transform_point(view.view_from_world, transform_point(instance.world_from_template, instance.bound_center));
    float z = max(center.z - instance.scale * instance.bound_radius, view.near);
    float px = max(view.focal_px.x, view.focal_px.y) * instance.scale / z;
    return is_below(px, 1e30) ? px : 1e30;  // NaN and infinity: in full
}

// 0 = cells are too wide, 1 = narrow enough to need nothing finer.
float fade_in(float cell, float px, float error_px) {
    return cell > 0.0 ? clamp(log2(error_px / (cell * px)) / FADE_OCTAVES, 0.0, 1.0) : 1.0;
}

// How much of an instance's level is shown.
float level_weight(View view, Instance instance, float error_px) {
    float px = pixels_per_unit(view, instance);
    return fade_in(instance.cell, px, error_px) - fade_in(instance.next_cell, px, error_px);
}

// Opacity with a part of its optical depth: two levels with weights that add up to 1 take as much light as one.
float faded(float opacity, float weight) {
    return weight < 1.0 ? 1.0 - pow(1.0 - opacity, weight) : opacity;
}
