#include "frame.glsl"
#include "outputs.glsl"
#include "light.glsl"
#include "noise.glsl"

void main() {
    vec3 direction = normalize(ray_of(gl_FragCoord.xy));
    vec3 color = sky_color(direction);
    if (direction.z > 0.0) {
        vec2 at = direction.xy / (direction.z + 0.12) * 1.3 + 100.0 * screen.w;
        float thick = layered_noise(at, 5);
        float cover = smoothstep(0.85 - 0.75 * air.y, 1.05 - 0.75 * air.y, thick + 0.1);
        vec3 white = horizon.rgb * 1.15 + sun.rgb * 0.12;
        color = mix(color, white, cover * smoothstep(0.0, 0.15, direction.z) * min(1.0, 3.0 * air.y));
    }
    // woods around, far off: their outline, and crowns that catch the light
    float around = atan(direction.y, direction.x), here = 50.0 * screen.w;
    float outline = 0.75 * layered_noise(vec2(around * 6.0 + here, 3.0), 3) + 0.25 * layered_noise(vec2(around * 40.0 + here, 9.0), 3);
    float top = 0.015 + 0.085 * outline;
    float inside = smoothstep(top + 0.002, top - 0.003, direction.z);
    float crowns = layered_noise(vec2(around * 70.0 + here, direction.z * 90.0), 3);
    vec3 leaves = vec3(0.055, 0.085, 0.03) * (0.35 + 1.3 * crowns);
    vec3 woods = leaves * (ambient(vec3(0.0, 0.0, 0.3)) + 0.5 * sun.rgb * max(sun_direction.z, 0.2));
    color = mix(color, mix(horizon.rgb, woods, 0.92 * exp(-120.0 * air.x)), inside);
    radiance = vec4(color, 0.0);
#ifdef TRUTH
    depth_m = 0.0;
    ids = uvec2(OTHER, 0u);
#endif
}
