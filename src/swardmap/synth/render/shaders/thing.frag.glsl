#include "frame.glsl"
#include "outputs.glsl"
#ifdef RADIANCE
#include "light.glsl"
#endif
in vec3 facing;
in vec2 at;
uniform sampler2D picture;
uniform bool textured;
uniform bool cutout;
uniform vec3 color;
uniform vec3 gloss;  // translucency, specular, roughness
uniform uvec2 identity;  // label, thing
uniform vec2 span;       // nearest and farthest depth of the thing

#ifdef RADIANCE
vec4 shaded(vec3 albedo, vec3 rel) {
    vec3 normal = unit(facing);
    if (!cutout) {
        vec3 flat_normal = cross(dFdx(rel), dFdy(rel));
        if (dot(flat_normal, rel) > 0.0) flat_normal = -flat_normal;
        if (dot(flat_normal, normal) < 0.0) normal = -normal;
    }
    float towards = dot(normal, sun_direction.xyz);
    float share = sunlit(rel, normal, 3);
    vec3 view = -unit(rel);
    vec3 sky = albedo * ambient(normal);
    vec3 direct = albedo * max(towards, 0.0);
    direct += albedo * vec3(1.0, 1.1, 0.55) * gloss.x * (cutout ? max(0.2 - 0.8 * towards, 0.0) : max(-towards, 0.0));
    if (gloss.y > 0.0) {
        float sharp = 2.0 / max(gloss.z * gloss.z * gloss.z * gloss.z, 1e-3);
        vec3 halfway = unit(view + sun_direction.xyz);
        float fresnel = 0.04 + 0.96 * pow(1.0 - min(abs(dot(normal, view)), 1.0), 5.0);
        direct += gloss.y * 0.04 * (sharp + 2.0) / 8.0 * pow(max(dot(normal, halfway), 0.0), sharp) * step(0.0, towards);
        sky += gloss.y * fresnel * (1.0 - gloss.z) * sky_color(reflect(-view, normal));
    }
    direct *= sun.rgb * share;
    vec3 total = sky + direct;
    float part = dot(sky, vec3(0.3, 0.6, 0.1)) / max(dot(total, vec3(0.3, 0.6, 0.1)), 1e-6);
    return vec4(through_air(total, rel), part);
}
#endif

void main() {
    vec4 texel = textured ? texture(picture, at) : vec4(1.0);
    if (cutout && texel.a < 0.4) discard;
    float depth = depth_of(gl_FragCoord, span);
#ifdef RADIANCE
    radiance = shaded(color * texel.rgb, ray_of(gl_FragCoord.xy) * depth);
#endif
#ifdef TRUTH
    depth_m = depth;
    ids = identity;
#endif
}
