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
    // woods around, far off
    float around = atan(direction.y, direction.x);
    float top = 0.035 + 0.05 * layered_noise(vec2(around * 9.0 + 50.0 * screen.w, 3.0), 5);
    float inside = smoothstep(top, top - 0.004, direction.z);
    vec3 woods = vec3(0.035, 0.05, 0.02) * (ambient(vec3(0.0, 0.0, 0.4)) + 0.35 * sun.rgb);
    color = mix(color, mix(horizon.rgb, woods, 0.75), inside);
    radiance = vec4(color, 0.0);
#ifdef TRUTH
    depth_m = 0.0;
    ids = uvec2(OTHER, 0u);
#endif
}
