// Counter-based random numbers: a draw depends on its purpose and counters, not on earlier draws.

// A bijection of 32-bit words that mixes every bit into every other: the finaliser of MurmurHash3 (Appleby 2011).
uint mix_bits(uint x) {
    x ^= x >> 16;
    x *= 0x85EBCA6B;
    x ^= x >> 13;
    x *= 0xC2B2AE35;
    return x ^ (x >> 16);
}

// Purposes of draws.
const uint RANDOM_SPLIT = 1;  // positions of the children of split Gaussians
const uint RANDOM_PICK = 2;   // the Gaussian that a relocated one joins
const uint RANDOM_NOISE = 3;  // noise on centres

// 32 uniform bits by seed, time (steps), purpose, Gaussian and number of the draw.
uint random_bits(uvec2 seed, uint time, uint purpose, uint index, uint draw) {
    uint h = mix_bits(seed.x + 0x9E3779B9);
    h = mix_bits((h ^ seed.y) + 0x9E3779B9);
    h = mix_bits((h ^ time) + 0x9E3779B9);
    h = mix_bits((h ^ purpose) + 0x9E3779B9);
    h = mix_bits((h ^ index) + 0x9E3779B9);
    return mix_bits((h ^ draw * 0x9E3779B9) + 0x9E3779B9);
}

// A multiple of 2^-24 strictly between 0 and 1, exact in f32.
float uniform_from_bits(uint bits) {
    return (float(bits >> 9) + 0.5) * 1.1920928955078125e-7;
}

// Two independent standard normals from two uniforms (Box and Muller 1958); at most 5.77.
vec2 normal_pair(uint a, uint b) {
    // Drivers may return a positive logarithm of a number just below 1.
    float radius = sqrt(max(0.0, -2.0 * log(uniform_from_bits(a))));
    float angle = 6.283185307179586 * (uniform_from_bits(b) - 0.5);
    return radius * vec2(cos(angle), sin(angle));
}

// Three standard normals from draws 4 set to 4 set + 3.
vec3 random_normals(uvec2 seed, uint time, uint purpose, uint index, uint set) {
    uint bits[4];
    [[unroll]] for (uint k = 0; k < 4; ++k) bits[k] = random_bits(seed, time, purpose, index, 4 * set + k);
    return vec3(normal_pair(bits[0], bits[1]), normal_pair(bits[2], bits[3]).x);
}
