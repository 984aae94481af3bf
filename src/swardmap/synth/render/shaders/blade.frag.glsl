#include "frame.glsl"
#include "outputs.glsl"
#ifdef RADIANCE
flat in vec3 sky;
flat in vec3 direct;
flat in float haze;
in float along;
#endif

void main() {
#ifdef RADIANCE
    float t = clamp(along, 0.0, 1.0);
    vec3 from_sky = sky * mix(0.45, 1.2, t), total = from_sky + direct * mix(0.55, 1.2, t);
    float part = dot(from_sky, vec3(0.3, 0.6, 0.1)) / max(dot(total, vec3(0.3, 0.6, 0.1)), 1e-6);
    radiance = vec4(mix(horizon.rgb, total, haze), part);
#endif
#ifdef TRUTH
    depth_m = 1.0 / gl_FragCoord.w;
    ids = uvec2(GRASS, 0u);
#endif
}
