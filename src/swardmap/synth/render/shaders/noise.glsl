// Whole-number hashes: the same on every driver. PCG, after Jarzynski and Olano 2020.
uint hashed(uint x) {
    uint state = x * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

float chance(uint x) { return float(hashed(x) >> 8u) / 16777216.0; }

float chance(ivec2 at) { return chance(uint(at.x) + hashed(uint(at.y))); }

// Smooth noise of mean 0.5, one knot a unit.
float smooth_noise(vec2 p) {
    vec2 whole = floor(p), t = p - whole;
    ivec2 i = ivec2(whole);
    t = t * t * (3.0 - 2.0 * t);
    return mix(
        mix(chance(i), chance(i + ivec2(1, 0)), t.x),
        mix(chance(i + ivec2(0, 1)), chance(i + ivec2(1, 1)), t.x), t.y);
}

// Noise of many scales, mean about 0.5.
float layered_noise(vec2 p, int layers) {
    float sum = 0.0, weight = 0.5, total = 0.0;
    for (int k = 0; k < layers; k++) {
        sum += weight * smooth_noise(p);
        total += weight;
        p = mat2(1.6, 1.2, -1.2, 1.6) * p + 17.3;
        weight *= 0.5;
    }
    return sum / total;
}
