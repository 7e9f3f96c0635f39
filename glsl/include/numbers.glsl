// Tests for finite values by their bits: compilers may assume that neither infinities nor NaN occur, and Vulkan does
// not define comparisons with NaN.

// True for all values but infinities and NaN.
bool is_finite(float x) {
    return (floatBitsToUint(x) & 0x7F800000) != 0x7F800000;
}

bool is_finite(vec3 v) {
    return is_finite(v.x) && is_finite(v.y) && is_finite(v.z);
}

// |x| < limit, for a limit above 0; false for NaN, whose bits are above those of all numbers.
bool is_below(float x, float limit) {
    return (floatBitsToUint(x) & 0x7FFFFFFF) < floatBitsToUint(limit);
}

bvec3 is_below(vec3 v, float limit) {
    return lessThan(floatBitsToUint(v) & 0x7FFFFFFF, uvec3(floatBitsToUint(limit)));
}

bvec4 is_below(vec4 v, float limit) {
    return lessThan(floatBitsToUint(v) & 0x7FFFFFFF, uvec4(floatBitsToUint(limit)));
}
