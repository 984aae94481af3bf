#include "frame.glsl"
in vec3 xyz;
in vec3 normal;
in vec2 uv;
uniform mat4 rel_from_model;
uniform mat3 normal_matrix;
out vec3 facing;
out vec2 at;

void main() {
    vec3 rel = (rel_from_model * vec4(xyz, 1.0)).xyz;
    facing = normal_matrix * normal;
    at = uv;
    gl_Position = clip_from_rel * vec4(rel, 1.0);
}
