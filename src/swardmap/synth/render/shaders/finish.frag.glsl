// Ambient occlusion in screen space, on the light of the sky only.
#include "frame.glsl"
#include "noise.glsl"
uniform sampler2D picture;
uniform sampler2D depth_map;
out vec4 result;

float occlusion(ivec2 pixel, float depth) {
    float radius = 0.3, sum = 0.0, start = 6.2832 * chance(pixel);
    ivec2 last = textureSize(depth_map, 0) - 1;
    for (int k = 0; k < 9; k++) {
        float angle = start + float(k) * 2.4, reach = radius * (float(k) + 0.7) / 9.0;
        vec2 off = vec2(cos(angle), sin(angle)) * reach * lens.xy / depth;
        float other = texelFetch(depth_map, clamp(pixel + ivec2(off), ivec2(0), last), 0).r;
        float nearer = depth - other;
        if (other > 0.0) sum += clamp((nearer - 0.012) / reach, 0.0, 1.0) * smoothstep(3.0 * radius, radius, nearer);
    }
    return sum / 9.0;
}

void main() {
    ivec2 pixel = ivec2(gl_FragCoord.xy);
    vec4 color = texelFetch(picture, pixel, 0);
    float depth = texelFetch(depth_map, pixel, 0).r;
    float dark = depth > 0.0 && depth < 15.0 ? 1.3 * occlusion(pixel, depth) : 0.0;
    result = vec4(color.rgb * (1.0 - color.a * min(dark, 0.8)), 1.0);
}
