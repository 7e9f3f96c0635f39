// Common to the four passes of the image loss: the target picture, the SSIM window, strips of pixels.

const uint STRIP = 8;          // pixels that one thread of an image-loss pass computes, in a row or a column
const uint WINDOW_RADIUS = 5;  // half width of the 11x11 SSIM window

// exp(-k^2 / (2 1.5^2)) for k = 0..5, divided by the sum over -5..5.
const float WINDOW[6] = float[6](0.2660117248617943, 0.21300553771125366, 0.1093606895097, 0.03600077212843082,
                                 0.007598758135239184, 0.0010283800844791099);

const float SSIM_C1 = 0.0001;  // 0.01^2
const float SSIM_C2 = 0.0009;  // 0.03^2

// Moments are of colours minus this value: variances, as differences, lose fewer digits. Outside the image it is 0.
const float SHIFT = 0.5;

// Upper limit of a picture's colour, also used for NaN: its square must not spread over the window.
const float LARGEST_COLOR = 100.0;

// Moments of colours minus SHIFT.
struct Moments {
    vec3 x;   // mean of the picture
    vec3 y;   // mean of the target
    vec3 xx;  // mean of picture squared
    vec3 yy;  // mean of target squared
    vec3 xy;  // mean of picture times target
};

struct SsimGradient {
    vec3 x;   // by the picture's mean
    vec3 xx;  // by the mean of picture squared
    vec3 xy;  // by the mean of picture times target
};

float window_weight(int distance) {
    return WINDOW[abs(distance)];
}

struct ColorPair {
    vec3 picture;  // rendered colour
    vec3 target;   // colour of the photo
};

// A rendered colour; NaN and what is too large count as the largest.
vec3 counted_color(vec3 rendered) {
    return mix(vec3(LARGEST_COLOR), rendered, is_below(rendered, LARGEST_COLOR));
}

// Picture and target of a pixel. The target's alpha is 0 for an ignored pixel, else 1 + 254 times its coverage of the
// background; an ignored pixel has the target's colour in both, whatever was rendered there.
ColorPair color_pair(vec4 rendered, uint rgba, vec3 background) {
    vec3 picture = counted_color(rendered.rgb);
    vec4 c = unpackUnorm4x8(rgba);
    bool counts = c.a > 0.0;
    vec3 target = counts ? mix(background, c.rgb, (c.a * 255.0 - 1.0) / 254.0) : c.rgb;
    return ColorPair(counts ? picture : target, target);
}
