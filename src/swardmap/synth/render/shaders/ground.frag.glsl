#include "frame.glsl"
#include "outputs.glsl"
#include "ground_map.glsl"
#ifdef RADIANCE
#include "light.glsl"
#include "noise.glsl"
#endif
in vec3 facing;

#ifdef RADIANCE
uniform sampler2D albedo_map;
uniform usampler2D surface_map;
uniform sampler2DArray details;  // a third of the factor on the albedo, a layer each surface
uniform float tile_m[12];
uniform vec3 lawn_color;         // beyond the raster

vec3 detail(float layer, vec2 xy) {
    return 3.0 * texture(details, vec3(xy / tile_m[int(layer)], layer)).rgb;
}

vec3 albedo_at(vec2 xy, Place place, float lawn) {
    vec2 grid = (vec2(place.cell) + place.at + 0.5) / vec2(textureSize(height_map, 0));
    vec3 albedo = place.within ? texture(albedo_map, grid).rgb : lawn_color;
    if (lawn > 0.0) {
        vec2 turned = mat2(0.8, 0.6, -0.6, 0.8) * xy;
        return albedo * mix(detail(0.0, xy), detail(0.0, turned * 0.23), 0.35);
    }
    vec2 stray = vec2(chance(ivec2(floor(xy * 300.0))), chance(ivec2(floor(xy * 300.0)) + 71)) - 0.5;
    ivec2 texel = place.cell + ivec2(place.at + 0.5 + 0.8 * stray);
    uint surface = texelFetch(surface_map, clamp(texel, ivec2(0), textureSize(height_map, 0) - 1), 0).r;
    return albedo * detail(float(surface), xy);
}

vec4 shaded(Place place, vec3 rel) {
    vec2 xy = rel.xy + camera.xy;
    float lawn = lawn_at(place);
    vec3 normal = unit(facing);
    vec3 albedo = albedo_at(xy, place, lawn);
    // near the camera blades stand on it and take their share of the light
    if (lawn > 0.0) albedo *= mix(0.55, 0.74, smoothstep(4.0, 14.0, length(rel)));
    vec3 sky = albedo * ambient(normal);
    vec3 direct = albedo * sun.rgb * max(dot(normal, sun_direction.xyz), 0.0) * sunlit(rel, normal, 3);
    vec3 total = sky + direct;
    float part = dot(sky, vec3(0.3, 0.6, 0.1)) / max(dot(total, vec3(0.3, 0.6, 0.1)), 1e-6);
    return vec4(through_air(total, rel), part);
}
#endif

#ifdef TRUTH
// The drawn triangles are coarser far off: find where the ray meets the true ones by Newton's method.
float true_depth(vec3 ray, float depth) {
    for (int k = 0; k < 3; k++) {
        vec3 ground = triangle_at(place_of(ray.xy * depth));
        float above = ray.z * depth + camera.z - ground.z;
        float fall = dot(ground.xy, ray.xy) - ray.z;
        if (fall < 1e-3) break;
        depth += clamp(above / fall, -0.5, 0.5);
    }
    return depth;
}
#endif

void main() {
    vec3 ray = ray_of(gl_FragCoord.xy);
    float depth = depth_of(gl_FragCoord, vec2(0.0, 1000.0));
#ifdef RADIANCE
    radiance = shaded(place_of(ray.xy * depth), ray * depth);
#endif
#ifdef TRUTH
    depth_m = true_depth(ray, depth);
    ids = uvec2(lawn_at(place_of(ray.xy * depth_m)) > 0.0 ? GRASS : OTHER, 0u);
#endif
}
