#version 460
// Packs a picture into the pixels of a window, which may have another size. Grid: one thread per pixel of the window.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "show.glsl"

layout(scalar, binding = 0) readonly buffer Colors { vec4 colors[]; };       // rgb over the background, and alpha, by pixel of the picture
layout(scalar, binding = 1) readonly buffer Depths { vec2 depths[]; };       // expected view depth, and T, by pixel of the picture
layout(scalar, binding = 2) writeonly buffer Pixels { uint pixels[]; };      // bytes red, green, blue (or the reverse), 255, by pixel of the window
layout(scalar, push_constant) uniform PresentParams {
    uvec2 size_px;       // width and height of the picture
    uvec2 shown_px;      // width and height of the window
    uint show;           // SHOW_*
    uint blue_first;     // 1 = blue in the lowest byte
    vec2 depth_range;    // view depths that are white and black, scene units
};

vec4 shown_at(uvec2 at) {
    uint i = at.y * size_px.x + at.x;
    if (show == SHOW_COLOR) return vec4(colors[i].rgb, 1.0);
    if (show == SHOW_ALPHA) return vec4(colors[i].aaa, 1.0);
    float depth = depths[i].x;
    float grey = depth > 0.0 ? (depth_range.y - depth) / (depth_range.y - depth_range.x) : 0.0;
    return vec4(vec3(clamp(grey, 0.0, 1.0)), 1.0);
}

// Between the centres of four pixels; exact where the sizes are the same.
vec4 sampled(vec2 position) {
    vec2 place = clamp(position - 0.5, vec2(0.0), vec2(size_px - 1));
    uvec2 low = uvec2(place), high = min(low + 1, size_px - 1);
    vec2 part = place - vec2(low);
    vec4 above = mix(shown_at(low), shown_at(uvec2(high.x, low.y)), part.x);
    vec4 below = mix(shown_at(uvec2(low.x, high.y)), shown_at(high), part.x);
    return mix(above, below, part.y);
}

void main() {
    uint i = thread_index();
    if (i >= shown_px.x * shown_px.y) return;
    uvec2 at = uvec2(i % shown_px.x, i / shown_px.x);
    vec4 value = shown_px == size_px ? shown_at(at) : sampled((vec2(at) + 0.5) * vec2(size_px) / vec2(shown_px));
    // To the nearest of 256 levels.
    uvec3 level = uvec3(clamp(value.rgb, 0.0, 1.0) * 255.0 + 0.5);
    if (blue_first != 0) level = level.bgr;
    pixels[i] = level.r | level.g << 8 | level.b << 16 | 0xFF000000;
}
