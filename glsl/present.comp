#version 460
// Packs a picture into the pixels of a window: 8 bits per colour, in the byte order of the window, scaled between the
// centres of pixels if the sizes differ.
//
// - Reads by pixel of the picture, for the view that is shown: `colors`, `depths`, `tile_ranges`, `marks`, or
//   `surfaces` and what they index. If an instance is selected, also `surfaces` of the pixel and its 24 neighbours.
// - Reads `counters`: a picture for which a buffer was too small, or that lacks a depth slab, is not shown, and the
//   window's pixels stay unchanged: the host may learn of that only later.
// - Writes `pixels`, by pixel of the window.
// - Grid: one thread per pixel of the window. Bytes per pixel at equal sizes: 16 (depth: 8) read, 4 written.
// - SHOW, OUTLINE and SCALED are spec constants: lavapipe executes both sides of a branch, so every pixel would do the
//   outline's 125 reads, which took half as long as blending.
//
// Twin: `instgs_reference::present`. Test: `tests/kernels/present.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "counters.glsl"
#include "scene.glsl"
#include "show.glsl"
#include "surface.glsl"

// One pipeline per view: a driver that executes both sides of a branch would run all of them for every pixel.
layout(constant_id = 2) const uint SHOW = 0;     // SHOW_*
layout(constant_id = 3) const uint OUTLINE = 0;  // 1 = an instance is selected, and the id buffer is available
layout(constant_id = 4) const uint SCALED = 0;   // 1 = picture and window have different sizes

layout(scalar, binding = 0) readonly buffer Colors { vec4 colors[]; };       // rgb over the background, and alpha, by pixel of the picture
layout(scalar, binding = 1) readonly buffer Depths { vec2 depths[]; };       // expected view depth, and T, by pixel of the picture
layout(scalar, binding = 2) readonly buffer Surfaces { uvec2 surfaces[]; };  // instance and local index at the surface, by pixel of the picture; read for an outline and the views that need it
layout(scalar, binding = 3) readonly buffer Looks { uint looks[]; };         // by instance: 1 if it is selected, plus twice its template
layout(scalar, binding = 4) writeonly buffer Pixels { uint pixels[]; };      // bytes red, green, blue (or the reverse), 255, by pixel of the window
layout(scalar, binding = 5) readonly buffer Counters { uint counters[]; };   // COUNTER_* of the picture
layout(scalar, binding = 6) readonly buffer TileRanges { uvec2 tile_ranges[]; };  // first and end intersection per tile
layout(scalar, binding = 7) readonly buffer Instances { Instance instances[]; };  // rows of instances, background last
layout(scalar, binding = 8) readonly buffer OffsetMeans { vec3 offset_means[]; };  // mean offsets, template frame, of scenes in f32
layout(scalar, binding = 10) readonly buffer PackedOffsetMeans { uint packed_offset_means[]; };  // those of packed scenes
layout(scalar, binding = 11) readonly buffer OffsetRanges { float offset_ranges[]; };  // limits of their codes
layout(scalar, binding = 9) readonly buffer Marks { uint marks[]; };              // red, green and blue from the lowest byte, by pixel of the picture
layout(scalar, push_constant) uniform PresentParams {
    uvec2 size_px;        // width and height of the picture
    uvec2 shown_px;       // width and height of the window
    uint blue_first;      // 1 = blue in the lowest byte
    vec2 range;           // SHOW_DEPTH: view depths that are white and black, scene units; heat: y is the top of the scale
    uint instance_count;  // elements of looks; instances from here on are the background's own
    uint posed_rows;      // rows of instances besides the background
    uint tile_size;       // side of a tile of the picture, pixels
    uvec2 capacities;     // candidates and work items that the picture's buffers held
    uint offset_count;    // offset records of the scene
};

#include "packed_offsets.glsl"

const vec3 LINE_COLOR = vec3(1.0, 0.72, 0.0);
const uint LINE_LEAST = 8, LINE_MOST = 17;  // of 25
const vec3 BACKGROUND_GREY = vec3(0.2);

// The seven colours besides black that Okabe and Ito chose so that people with any colour vision tell them apart (Color Universal
// Design, 2002, revised 2008: https://jfly.uni-koeln.de/color/); then the same darker, and lighter.
const vec3 PALETTE[7] = vec3[](
    vec3(230, 159, 0) / 255, vec3(86, 180, 233) / 255, vec3(0, 158, 115) / 255, vec3(240, 228, 66) / 255,
    vec3(0, 114, 178) / 255, vec3(213, 94, 0) / 255, vec3(204, 121, 167) / 255);
const float DARKER = 0.6, LIGHTER = 0.5;

vec3 color_of(uint number) {
    vec3 color = PALETTE[number % 7];
    uint round = number / 7 % 3;
    return round == 0 ? color : round == 1 ? DARKER * color : mix(color, vec3(1.0), LIGHTER);
}

uint instance_at(uvec2 at) {
    return surfaces[at.y * size_px.x + at.x].x;
}

bool is_chosen(ivec2 at) {
    uint instance = instance_at(uvec2(clamp(at, ivec2(0), ivec2(size_px) - 1)));
    return instance < instance_count && (looks[instance] & 1) != 0;
}

// True on the outline of a selected instance: a third to two thirds of the 5x5 pixels around belong to it. That is two
// pixels wide on a straight edge, and single stray pixels at soft edges leave no speckles.
bool is_line(ivec2 at) {
    uint count = 0;
    for (int y = -2; y <= 2; ++y) {
        for (int x = -2; x <= 2; ++x) count += uint(is_chosen(at + ivec2(x, y)));
    }
    return count >= LINE_LEAST && count <= LINE_MOST;
}

vec3 depth_grey(float depth) {
    float grey = depth > 0.0 ? (range.y - depth) / (range.y - range.x) : 0.0;
    return vec3(clamp(grey, 0.0, 1.0));
}

vec3 load_heat(uvec2 at) {
    uvec2 tile = at / tile_size;
    uvec2 pairs = tile_ranges[tile.y * ((size_px.x + tile_size - 1) / tile_size) + tile.x];
    return heat(float(pairs.y - pairs.x) / range.y);
}

vec3 surface_color(uint instance) {
    bool templates = SHOW == SHOW_TEMPLATES;
    if (instance < instance_count) return color_of(templates ? looks[instance] >> 1 : instance);
    return templates && instance != NO_INSTANCE ? BACKGROUND_GREY : vec3(0.0);
}

// The first row of an instance, by bisection: there are one or two rows for every instance before.
uint first_row_of(uint instance) {
    uint low = min(instance, posed_rows - 1), high = min(2 * instance, posed_rows - 1);
    while (low < high) {
        uint middle = (low + high) / 2;
        if (instances[middle].owner < instance) low = middle + 1;
        else high = middle;
    }
    return low;
}

// Heat of the offset's length relative to the radius of the ball around the template's means. Own Gaussians have no offsets.
vec3 offset_heat(uvec2 point) {
    if (point.x >= instance_count) return vec3(0.0);
    Instance instance = instances[first_row_of(point.x)];
    if (instance.first_offset == NO_OFFSET || point.y >= instance.source_count || offset_count == 0) return vec3(0.0);
    // The id buffer may be of the scene before an edit.
    uint record = min(instance.first_offset + point.y, offset_count - 1);
    vec3 offset = OFFSET_BITS == 0 ? offset_means[record] : mean_and_logit_offset(record).xyz;
    float moved = length(offset), hottest = range.y * instance.bound_radius;
    return heat(moved < hottest ? moved / hottest : moved > 0.0 ? 1.0 : 0.0);
}

vec3 shown_at(uvec2 at) {
    uint i = at.y * size_px.x + at.x;
    if (OUTLINE != 0 && is_line(ivec2(at))) return LINE_COLOR;
    if (SHOW == SHOW_COLOR) return colors[i].rgb;
    if (SHOW == SHOW_ALPHA) return colors[i].aaa;
    if (SHOW == SHOW_DEPTH) return depth_grey(depths[i].x);
    if (SHOW == SHOW_INSTANCES) return surface_color(instance_at(at));
    if (SHOW == SHOW_TEMPLATES) return surface_color(instance_at(at));
    if (SHOW == SHOW_TILE_LOAD) return load_heat(at);
    if (SHOW == SHOW_OFFSETS) return offset_heat(surfaces[i]);
    if (SHOW == SHOW_MARKS) return unpackUnorm4x8(marks[i]).rgb;
    return vec3(0.0);
}

// Interpolates between the centres of four pixels; exact if the sizes are equal.
vec3 sampled(vec2 position) {
    vec2 place = clamp(position - 0.5, vec2(0.0), vec2(size_px - 1));
    uvec2 low = uvec2(place), high = min(low + 1, size_px - 1);
    vec2 part = place - vec2(low);
    vec3 above = mix(shown_at(low), shown_at(uvec2(high.x, low.y)), part.x);
    vec3 below = mix(shown_at(uvec2(low.x, high.y)), shown_at(high), part.x);
    return mix(above, below, part.y);
}

#include "complete.glsl"

void main() {
    uint i = thread_index();
    if (i >= shown_px.x * shown_px.y || !is_complete(capacities)) return;
    uvec2 at = uvec2(i % shown_px.x, i / shown_px.x);
    vec3 value;
    if (SCALED != 0) value = sampled((vec2(at) + 0.5) * vec2(size_px) / vec2(shown_px));
    else value = shown_at(at);
    // Rounds to the nearest of 256 levels.
    uvec3 level = uvec3(clamp(value, 0.0, 1.0) * 255.0 + 0.5);
    if (blue_first != 0) level = level.bgr;
    pixels[i] = level.r | level.g << 8 | level.b << 16 | 0xFF000000;
}
