// Common to the four passes of the image loss: the target picture, the SSIM window, strips of pixels.

const uint STRIP = 8;          // pixels that one thread of an image-loss pass computes, in a row or a column
const uint CHANNELS = 3;       // colour channels
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

// A vec4 of moments is of one channel, of colours minus SHIFT: means of the picture, of the target, of the sum of both
// squares (SSIM does not need them apart), of the product. A vec3 of gradients has the derivatives of SSIM by the first, the
// third and the fourth.

float window_weight(int distance) {
    return WINDOW[abs(distance)];
}

// One channel of a pixel.
struct ColorPair {
    float picture;  // rendered colour
    float target;   // colour of the photo
};

// A rendered colour; NaN and what is too large count as the largest.
float counted_color(float rendered) {
    return is_below(rendered, LARGEST_COLOR) ? rendered : LARGEST_COLOR;
}

vec3 counted_color(vec3 rendered) {
    return vec3(counted_color(rendered.r), counted_color(rendered.g), counted_color(rendered.b));
}

// A channel of a pixel. The target's alpha is 0 for an ignored pixel, else 1 + 254 times its coverage of the background; an
// ignored pixel has the target's colour in both, whatever was rendered there.
ColorPair color_pair(float rendered, uint rgba, uint channel, float background) {
    float picture = counted_color(rendered);
    float target = float(rgba >> (8 * channel) & 255) / 255.0;
    uint alpha = rgba >> 24;
    bool counts = alpha > 0;
    target = counts ? mix(background, target, (float(alpha) - 1.0) / 254.0) : target;
    return ColorPair(counts ? picture : target, target);
}
