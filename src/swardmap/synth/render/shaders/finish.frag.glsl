// The mean of the samples of a pixel; ambient occlusion takes from the light of the sky only.
#include "frame.glsl"
uniform sampler2D picture;
uniform sampler2D depth_map;
uniform sampler2D occlusion_map;
out vec4 result;

// Mean over a square of 4 x 4, of what is about as far.
float dark_at(ivec2 pixel) {
    float depth = texelFetch(depth_map, pixel, 0).r;
    if (depth <= 0.0) return 0.0;
    ivec2 last = textureSize(depth_map, 0) - 1;
    vec2 sum = vec2(0.0);
    for (int j = -2; j < 2; j++)
        for (int i = -2; i < 2; i++) {
            ivec2 at = clamp(pixel + ivec2(i, j), ivec2(0), last);
            float off = abs(texelFetch(depth_map, at, 0).r - depth);
            float weight = off < 0.05 + 0.06 * depth ? 1.0 : 0.0;
            sum += weight * vec2(texelFetch(occlusion_map, at, 0).r, 1.0);
        }
    return sum.x / sum.y;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    float dark = dark_at(pixel);
    int n = int(screen.x);
    vec3 sum = vec3(0.0);
    for (int j = 0; j < n; j++)
        for (int i = 0; i < n; i++) {
            vec4 color = texelFetch(picture, pixel * n + ivec2(i, j), 0);
            sum += color.rgb * (1.0 - color.a * dark);
        }
    result = vec4(sum / float(n * n), 1.0);
}
