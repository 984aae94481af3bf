// The mean of the samples of a pixel, with ambient occlusion in screen space on the light of the sky only.
#include "frame.glsl"
#include "noise.glsl"
uniform sampler2D picture;
uniform sampler2D depth_map;
out vec4 result;

// Pairs of opposite places: of a plane, the inverse depth in the middle is the mean of both, so that planes
// do not darken themselves however they lie.
float occlusion(ivec2 pixel, float depth) {
    float radius = 0.55, sum = 0.0, start = 3.1416 * chance(pixel);
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
    float dark = depth > 0.0 && depth < 15.0 ? min(1.6 * occlusion(pixel, depth), 0.8) : 0.0;
    int n = int(screen.x);
    vec3 sum = vec3(0.0);
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++) {
            vec4 color = texelFetch(picture, pixel * n + ivec2(i, j), 0);
            sum += color.rgb * (1.0 - color.a * dark);
        }
    result = vec4(sum / float(n * n), 1.0);
}
