#include "frame.glsl"
#include "ground_map.glsl"
in ivec3 local;   // vertex of a tile, in texels; the third is 1 for the skirt that hides gaps between tiles
in ivec2 tile;    // its first texel
uniform ivec2 low;   // vertices stay within
uniform ivec2 high;
out vec3 facing;

float height_of(ivec2 vertex) {
    return texelFetch(height_map, clamp(vertex, ivec2(0), textureSize(height_map, 0) - 1), 0).r;
}

void main() {
    ivec2 vertex = clamp(tile + local.xy, low, high);
    vec3 rel = vec3(vec2(vertex - camera_cell) * texel_m - camera_offset, height_of(vertex) - camera.z);
    rel.z -= local.z == 1 ? 0.15 : 0.0;
    vec2 slope = vec2(
        height_of(vertex + ivec2(1, 0)) - height_of(vertex - ivec2(1, 0)),
        height_of(vertex + ivec2(0, 1)) - height_of(vertex - ivec2(0, 1))) / (2.0 * texel_m);
    facing = vec3(-slope, 1.0);
    gl_Position = clip_from_rel * vec4(rel, 1.0);
}
