#version 460
// Turns the colours of the scene into those of the photo: M rgb + b, by the exposure of the view, over the background. Runs between blending
// and the image loss, in training with `exposure.rate` above 0.
//
// - Reads `colors` (rgb over the background, and alpha) and the three rows of the view in `exposures`.
// - Writes `exposed_colors` by pixel; alpha stays.
// - Grid: one thread per pixel. Bytes per pixel: 16 read, 16 written.
// - A colour that is not finite counts as the largest one, as in the loss.
//
// Twin: `instgs_reference::exposure`. Test: `tests/kernels/exposure.rs`.
#extension GL_GOOGLE_include_directive : require
#include "common.glsl"
#include "numbers.glsl"
#include "image_loss.glsl"
#include "exposure.glsl"
#include "exposable.glsl"

layout(scalar, binding = 0) readonly buffer Colors { vec4 colors[]; };                 // the picture: rgb over the background, and alpha
layout(scalar, binding = 1) readonly buffer Exposures { vec4 exposures[]; };           // rows of the exposures, three per view
layout(scalar, binding = 2) writeonly buffer ExposedColors { vec4 exposed_colors[]; };  // the picture as the photo's exposure shows it
layout(scalar, push_constant) uniform ApplyExposureParams {
    uint pixels;      // of the picture
    uint view;        // index of the training view
    vec3 background;  // colour behind the scene
};

void main() {
    uint i = thread_index();
    if (i >= pixels) return;
    vec4 extended = exposable(colors[i], background);
    uint row = EXPOSURE_ROWS * view;
    vec3 exposed = vec3(dot(exposures[row], extended), dot(exposures[row + 1], extended), dot(exposures[row + 2], extended));
    exposed_colors[i] = vec4(exposed + (1.0 - extended.a) * background, colors[i].a);
}
