// Views of a picture in a window.

const uint SHOW_COLOR = 0;      // colour over the background
const uint SHOW_ALPHA = 1;      // grey: 1 - T
const uint SHOW_DEPTH = 2;      // grey: white at the near end of the range, black at the far end and where nothing is
const uint SHOW_INSTANCES = 3;  // a colour for each instance, black where there is none
const uint SHOW_TEMPLATES = 4;  // a colour for each template, dark grey for the background's Gaussians, black where nothing is
const uint SHOW_TILE_LOAD = 5;  // heat: (splat, tile) pairs of the tile, in the last depth slab
const uint SHOW_OFFSETS = 6;    // heat: position offset of the Gaussian at the surface, relative to its template's radius
const uint SHOW_MARKS = 7;      // the output of tile_marks
const uint SHOW_NOTHING = 8;    // black: the inputs of the view are missing

// Heat colours from 0 to 1: black, violet, red, orange, pale yellow. Lightness increases, so they also read as grey.
vec3 heat(float part) {
    const vec3 stops[5] = vec3[5](vec3(0.0), vec3(0.34, 0.06, 0.47), vec3(0.80, 0.22, 0.26), vec3(0.98, 0.62, 0.11), vec3(1.0, 1.0, 0.8));
    float place = clamp(part, 0.0, 1.0) * 4.0;
    uint below = min(uint(place), 3);
    return mix(stops[below], stops[below + 1], place - float(below));
}
