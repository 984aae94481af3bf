#include "frame.glsl"
#include "noise.glsl"
#ifdef RADIANCE
#include "light.glsl"
#endif
in vec3 corner;    // across -1..1, along 0..1, which blade of the tuft
in vec4 root;      // x, y from the tile's corner, z, mean length of the blades
in vec2 draw;      // direction of the tuft, chance 0..1
in vec4 look;      // square root of linear RGB of the living blades, share of dead ones
uniform vec3 tile_rel;   // the tile's corner; its z is that of the map's origin
uniform float full;      // tufts of a tile
uniform vec3 straw;
#ifdef TRUTH
flat out vec2 span;   // nearest and farthest depth of the blade
#endif
#ifdef RADIANCE
// The same at all corners of a blade, mixed by `along`: interpolated light leaves its bounds on slivers.
flat out vec3 sky;
flat out vec3 direct;
flat out float haze;
out float along;
#endif

// Share of the tufts that is drawn at a distance, as in lawn.py.
float share_at(float distance) {
    return clamp(pow(2.2 / max(distance, 2.2), 1.6), 0.0, 1.0) * (1.0 - smoothstep(10.0, 16.0, distance));
}

void main() {
    uint seed = uint(draw.y * 16777216.0) * 8u + uint(corner.z);
    vec4 some = vec4(chance(seed), chance(seed + 0x10000000u), chance(seed + 0x20000000u), chance(seed + 0x30000000u));
    vec4 more = vec4(chance(seed + 0x40000000u), chance(seed + 0x50000000u), chance(seed + 0x60000000u), chance(seed + 0x70000000u));
    vec3 base = tile_rel + root.xyz;
    float distance = length(base), share = share_at(distance);
    float rank = float(gl_InstanceID) / full;
    float grown = clamp((share - rank) / (0.25 * share + 1e-4), 0.0, 1.0);
    float widened = pow(max(share, 0.01), -0.55);

    float turn = draw.x + corner.z * 2.4 + 1.5 * some.x, t = corner.y;
    vec2 ahead = vec2(cos(turn), sin(turn)), across = vec2(-ahead.y, ahead.x);
    float length_m = root.w * (0.6 + 0.7 * some.y) * grown;
    float lean = 0.15 + 0.75 * some.z * some.z + 0.3 * some.w;
    float bend = lean * t * t;
    float width = 0.0019 * widened * (0.7 + 0.7 * more.x) * (1.0 - 0.8 * t);
    vec2 foot = base.xy + (more.yz - 0.5) * 0.05 * widened + ahead * 0.008;
    vec3 rel = vec3(
        foot + ahead * (length_m * bend) + across * (corner.x * width),
        base.z + length_m * t * (1.0 - 0.3 * bend));
    gl_Position = clip_from_rel * vec4(rel, 1.0);
#ifdef TRUTH
    vec3 tip = vec3(foot + ahead * (length_m * lean), base.z + length_m * (1.0 - 0.3 * lean));
    vec2 ends = vec2(dot(vec3(foot, base.z), forward.xyz), dot(tip, forward.xyz));
    span = vec2(min(ends.x, ends.y), max(ends.x, ends.y)) + vec2(-0.004, 0.004) * widened;
#endif
#ifdef RADIANCE
    vec3 tangent = normalize(vec3(ahead * (1.2 * lean), 1.0));
    vec3 normal = cross(vec3(across, 0.0), tangent);
    normal = normalize(mix(vec3(0.0, 0.0, 1.0), normal.z < 0.0 ? -normal : normal, 0.5));
    vec3 albedo = more.w < look.a ? straw : look.rgb * look.rgb * (0.75 + 0.5 * some.w);
    float towards = dot(normal, sun_direction.xyz);
    vec3 middle = vec3(foot, base.z + 0.6 * length_m);
    sky = albedo * ambient(normal);
    direct = albedo * (max(towards, 0.0) + vec3(1.0, 1.1, 0.5) * 0.35 * max(0.25 - towards, 0.0));
    direct *= sun.rgb * sunlit(middle, vec3(0.0, 0.0, 1.0), 1);
    haze = exp(-air.x * length(middle));
    along = t;
#endif
}
