#version 460
// Packs a picture into the pixels of a window, which may have another size, and draws a line around what is chosen. Pixels
// stay as they are if the picture is not complete: the host may learn later than this that a buffer was too small for it.
// Grid: one thread per pixel of the window.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "show.glsl"

layout(scalar, binding = 0) readonly buffer Colors { vec4 colors[]; };       // rgb over the background, and alpha, by pixel of the picture
layout(scalar, binding = 1) readonly buffer Depths { vec2 depths[]; };       // expected view depth, and T, by pixel of the picture
layout(scalar, binding = 2) readonly buffer Surfaces { uvec2 surfaces[]; };  // x: instance at the surface, by pixel of the picture; read if instance_count > 0
layout(scalar, binding = 3) readonly buffer Chosen { uint chosen[]; };       // 1 if the instance is chosen
layout(scalar, binding = 4) writeonly buffer Pixels { uint pixels[]; };      // bytes red, green, blue (or the reverse), 255, by pixel of the window
layout(scalar, binding = 5) readonly buffer Counters { uint counters[]; };   // COUNTER_* of the picture
layout(scalar, push_constant) uniform PresentParams {
    uvec2 size_px;        // width and height of the picture
    uvec2 shown_px;       // width and height of the window
    uint show;            // SHOW_*
    uint blue_first;      // 1 = blue in the lowest byte
    vec2 depth_range;     // view depths that are white and black, scene units
    uint instance_count;  // elements of chosen; 0 = surfaces hold nothing
    uvec2 capacities;     // candidates and work items that the picture's buffers held
};

const vec3 LINE_COLOR = vec3(1.0, 0.72, 0.0);

// Neighbours in number far apart in hue: steps of the golden angle around the colour circle.
vec3 color_of(uint instance) {
    float turn = fract(float(instance) * 0.618034);
    return 0.15 + 0.85 * clamp(abs(fract(turn + vec3(0.0, 2.0 / 3.0, 1.0 / 3.0)) * 6.0 - 3.0) - 1.0, 0.0, 1.0);
}

uint instance_at(uvec2 at) {
    return surfaces[at.y * size_px.x + at.x].x;
}

bool is_chosen(ivec2 at) {
    uint instance = instance_at(uvec2(clamp(at, ivec2(0), ivec2(size_px) - 1)));
    return instance < instance_count && chosen[instance] != 0;
}

// On the inner side of the outline of what is chosen, two pixels wide.
bool is_line(ivec2 at) {
    if (!is_chosen(at)) return false;
    for (int y = -2; y <= 2; ++y) {
        for (int x = -2; x <= 2; ++x) {
            if (!is_chosen(at + ivec2(x, y))) return true;
        }
    }
    return false;
}

vec3 shown_at(uvec2 at) {
    uint i = at.y * size_px.x + at.x;
    if (instance_count > 0 && is_line(ivec2(at))) return LINE_COLOR;
    if (show == SHOW_COLOR) return colors[i].rgb;
    if (show == SHOW_ALPHA) return colors[i].aaa;
    if (show == SHOW_INSTANCES) return instance_count > 0 && instance_at(at) < instance_count ? color_of(instance_at(at)) : vec3(0.0);
    float depth = depths[i].x;
    float grey = depth > 0.0 ? (depth_range.y - depth) / (depth_range.y - depth_range.x) : 0.0;
    return vec3(clamp(grey, 0.0, 1.0));
}

// Between the centres of four pixels; exact where the sizes are the same.
vec3 sampled(vec2 position) {
    vec2 place = clamp(position - 0.5, vec2(0.0), vec2(size_px - 1));
    uvec2 low = uvec2(place), high = min(low + 1, size_px - 1);
    vec2 part = place - vec2(low);
    vec3 above = mix(shown_at(low), shown_at(uvec2(high.x, low.y)), part.x);
    vec3 below = mix(shown_at(uvec2(low.x, high.y)), shown_at(high), part.x);
    return mix(above, below, part.y);
}

bool is_complete() {
    uvec2 needed = uvec2(counters[COUNTER_CANDIDATES_NEEDED], counters[COUNTER_WORK_ITEMS_NEEDED]);
    return all(lessThanEqual(needed, capacities)) && counters[COUNTER_SLAB_END] >= counters[COUNTER_VISIBLE];
}

void main() {
    uint i = thread_index();
    if (i >= shown_px.x * shown_px.y || !is_complete()) return;
    uvec2 at = uvec2(i % shown_px.x, i / shown_px.x);
    vec3 value = shown_px == size_px ? shown_at(at) : sampled((vec2(at) + 0.5) * vec2(size_px) / vec2(shown_px));
    // To the nearest of 256 levels.
    uvec3 level = uvec3(clamp(value, 0.0, 1.0) * 255.0 + 0.5);
    if (blue_first != 0) level = level.bgr;
    pixels[i] = level.r | level.g << 8 | level.b << 16 | 0xFF000000;
}
