// How a packed scene (`scene::packed`) is read: numbers of 16 bits, two in a word, in rows without padding, so that a row may
// begin in the upper half of a word. The including file declares the buffers.
#include "packed_offsets.glsl"
layout(constant_id = 5) const uint OFFSET_LOG_SCALES = 0;  // 1 = the scene has offsets of log standard deviations
layout(constant_id = 6) const uint OFFSET_QUATS = 0;       // 1 = the scene has offsets of quaternions
layout(constant_id = 7) const uint OFFSET_SH_REST = 0;     // SH coefficients above 0 that have offsets: 0, 3, 8 or 15

// The two words that hold three numbers from number `first` of an array on; GLSL passes no arrays to functions.
#define WORDS_OF_THREE(array, first) uvec2(array[(first) >> 1], array[((first) >> 1) + 1])

// Three f16 numbers of two words, from the upper half of the first one on if `first` is odd.
vec3 three_halves(uvec2 words, uint first) {
    bool odd = (first & 1) == 1;
    return vec3(unpackHalf2x16(odd ? (words.x >> 16) | (words.y << 16) : words.x), unpackHalf2x16(odd ? words.y >> 16 : words.y).x);
}

// Places 0, 1 and 2 in the quaternion of the three numbers that are stored when component `largest` is not.
vec4 with_largest(uint largest, vec3 others, float value) {
    if (largest == 0) return vec4(value, others);
    if (largest == 1) return vec4(others.x, value, others.yz);
    if (largest == 2) return vec4(others.xy, value, others.z);
    return vec4(others, value);
}

// A unit quaternion (w, x, y, z) of three codes of 15 bits: all components but the largest, in steps of sqrt(1/2) / 16383 around
// code 16384. The upper bits of the first two codes are the index of the largest. Codes of 0 stand for no rotation at all.
vec4 source_quat(uint source) {
    uvec2 words = WORDS_OF_THREE(quats, 3 * source);
    uvec3 codes = ((3 * source) & 1) == 0 ? uvec3(words.x & 0xffffu, words.x >> 16, words.y & 0xffffu)
                                          : uvec3(words.x >> 16, words.y & 0xffffu, words.y >> 16);
    uint largest = (codes.x >> 15) | ((codes.y >> 15) << 1);
    codes &= 0x7fffu;
    if (codes.x == 0) return vec4(0.0);
    vec3 others = (vec3(codes) - 16384.0) * (0.70710678118654752 / 16383.0);
    return with_largest(largest, others, sqrt(max(1.0 - dot(others, others), 0.25)));
}

vec3 mean_of(Instance instance, uint local) {
    vec3 own = means[instance.first_source + local];
    if (instance.first_offset != NO_OFFSET) own += mean_and_logit_offset(instance.first_offset + local).xyz;
    return own;
}

float logit_of(Instance instance, uint local) {
    float own = unpackHalf2x16(shapes[2 * (instance.first_source + local) + 1]).y;
    if (instance.first_offset != NO_OFFSET) own += mean_and_logit_offset(instance.first_offset + local).w;
    return own;
}

vec3 log_scales_of(Instance instance, uint local) {
    uint word = 2 * (instance.first_source + local), record = instance.first_offset + local;
    vec3 own = vec3(unpackHalf2x16(shapes[word]), unpackHalf2x16(shapes[word + 1]).x);
    if (OFFSET_LOG_SCALES == 0 || instance.first_offset == NO_OFFSET) return own;
    if (OFFSET_BITS == 8) return own + from_codes(offset_log_scales[record], record, 7).xyz;
    return own + three_halves(WORDS_OF_THREE(offset_log_scales, 3 * record), 3 * record);
}

vec4 quat_of(Instance instance, uint local) {
    uint record = instance.first_offset + local;
    vec4 own = source_quat(instance.first_source + local);
    if (OFFSET_QUATS == 0 || instance.first_offset == NO_OFFSET) return own;
    if (OFFSET_BITS == 8) return own + from_codes(offset_quats[record], record, 10);
    return own + vec4(unpackHalf2x16(offset_quats[2 * record]), unpackHalf2x16(offset_quats[2 * record + 1]));
}

// SH coefficient 0, offset included.
vec3 sh0_of(Instance instance, uint local) {
    uint first = 3 * (instance.first_source + local), record = instance.first_offset + local;
    vec3 own = three_halves(WORDS_OF_THREE(sh0, first), first);
    if (instance.first_offset == NO_OFFSET) return own;
    if (OFFSET_BITS == 8) return own + from_codes(offset_sh_dc[record], record, 4).xyz;
    return own + three_halves(WORDS_OF_THREE(offset_sh_dc, 3 * record), 3 * record);
}

// `own` plus the offset of SH coefficient `c`, from 1.
vec3 with_sh_offset(Instance instance, uint local, uint c, vec3 own) {
    if (c <= OFFSET_SH_REST && instance.first_offset != NO_OFFSET) {
        uint first = 3 * ((instance.first_offset + local) * OFFSET_SH_REST + c - 1);
        own += three_halves(WORDS_OF_THREE(offset_sh_rest, first), first);
    }
    return own;
}

// The coefficients of the band that was begun last: words of a band are read once for all of its coefficients.
vec3 band[7];

// Fills `band` from the words of a band; its first number is in the upper half of the first word if `odd` is 1.
void begin_band(uint words[12], uint odd) {
    vec2 pairs[11];
    [[unroll]] for (uint k = 0; k < 11; ++k) {
        pairs[k] = unpackHalf2x16(odd == 0 ? words[k] : (words[k] >> 16) | (words[k + 1] << 16));
    }
    [[unroll]] for (uint m = 0; m < 7; ++m) {
        [[unroll]] for (uint i = 0; i < 3; ++i) band[m][i] = pairs[(3 * m + i) / 2][(3 * m + i) % 2];
    }
}

void begin_sh1(Instance instance, uint local) {
    uint first = 9 * (instance.first_in_band[0] + local), words[12];
    [[unroll]] for (uint k = 0; k < 12; ++k) words[k] = k < 5 ? sh1[(first >> 1) + k] : 0;
    begin_band(words, first & 1);
}

void begin_sh2(Instance instance, uint local) {
    uint first = 15 * (instance.first_in_band[1] + local), words[12];
    [[unroll]] for (uint k = 0; k < 12; ++k) words[k] = k < 8 ? sh2[(first >> 1) + k] : 0;
    begin_band(words, first & 1);
}

void begin_sh3(Instance instance, uint local) {
    uint first = 21 * (instance.first_in_band[2] + local), words[12];
    [[unroll]] for (uint k = 0; k < 12; ++k) words[k] = k < 11 ? sh3[(first >> 1) + k] : 0;
    begin_band(words, first & 1);
}

vec3 sh1_of(Instance instance, uint local, uint m) {
    return with_sh_offset(instance, local, 1 + m, band[m]);
}

vec3 sh2_of(Instance instance, uint local, uint m) {
    return with_sh_offset(instance, local, 4 + m, band[m]);
}

vec3 sh3_of(Instance instance, uint local, uint m) {
    return with_sh_offset(instance, local, 9 + m, band[m]);
}
