// What the rows of an exposure are multiplied by: the scene's own colour, without the background colour behind it, and alpha.
// The background colour is no scene's, and no photo exposes it. A colour or alpha that is not finite counts as the largest.
vec4 exposable(vec4 color, vec3 background) {
    float alpha = is_below(color.a, 2.0) ? color.a : 1.0;
    return vec4(counted_color(color.rgb) - (1.0 - alpha) * background, alpha);
}
