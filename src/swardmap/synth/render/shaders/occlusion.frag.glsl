// Ambient occlusion in screen space, 0 = open; grainy in squares of 4 x 4, over which `finish` takes the mean.
#include "frame.glsl"
uniform sampler2D depth_map;
out float result;

// 16 directions, each once in a square of 4 x 4, neighbours far apart.
float turn_of(ivec2 pixel) {
    int order[16] = int[16](0, 8, 2, 10, 12, 4, 14, 6, 3, 11, 1, 9, 15, 7, 13, 5);
    return float(order[(pixel.y & 3) * 4 + (pixel.x & 3)]) / 16.0;
}

// Pairs of opposite places: of a plane, the inverse depth in the middle is the mean of both, so that planes
// do not darken themselves however they lie.
float occlusion(ivec2 pixel, float depth) {
    float radius = 0.55, sum = 0.0, start = 3.1416 * turn_of(pixel);
    ivec2 last = textureSize(depth_map, 0) - 1;
    for (int k = 0; k < 8; k++) {
        float angle = start + float(k) * 2.4, reach = radius * (float(k) + 0.5) / 8.0;
        ivec2 off = ivec2(vec2(cos(angle), sin(angle)) * reach * lens.xy / depth);
        float a = texelFetch(depth_map, clamp(pixel + off, ivec2(0), last), 0).r;
        float b = texelFetch(depth_map, clamp(pixel - off, ivec2(0), last), 0).r;
        if (a <= 0.0 || b <= 0.0) continue;
        vec2 nearer = (depth / vec2(a, b) - 1.0) * depth;   // how far both are before the middle
        float hollow = 0.5 * (nearer.x + nearer.y) - 0.006;
        float beside = max(abs(nearer.x), abs(nearer.y));
        sum += clamp(2.0 * hollow / reach, 0.0, 1.0) * smoothstep(3.0 * radius, radius, beside);
    }
    return sum / 8.0;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float depth = texelFetch(depth_map, pixel, 0).r;
    result = depth > 0.0 && depth < 15.0 ? min(1.25 * occlusion(pixel, depth), 0.8) : 0.0;
}
