in vec3 xyz;
in vec2 uv;
uniform mat4 light_from_model;
out vec2 at;

void main() {
    at = uv;
    gl_Position = light_from_model * vec4(xyz, 1.0);
}
