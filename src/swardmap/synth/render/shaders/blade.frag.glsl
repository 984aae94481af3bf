#include "frame.glsl"
#include "outputs.glsl"
#ifdef TRUTH
flat in vec2 span;
#endif
#ifdef RADIANCE
flat in vec3 sky;
flat in vec3 direct;
flat in float haze;
in float along;
#endif

void main() {
#ifdef RADIANCE
    float t = along > 0.0 ? min(along, 1.0) : 0.0;  // may be no number on slivers
    vec3 from_sky = sky * mix(0.55, 1.45, t), total = from_sky + direct * mix(0.65, 1.45, t);
    float part = dot(from_sky, vec3(0.3, 0.6, 0.1)) / max(dot(total, vec3(0.3, 0.6, 0.1)), 1e-6);
    radiance = vec4(mix(horizon.rgb, total, haze), part);
#endif
#ifdef TRUTH
    depth_m = depth_of(gl_FragCoord, span);
    ids = uvec2(GRASS, 0u);
#endif
}
