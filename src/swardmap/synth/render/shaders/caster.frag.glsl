in vec2 at;
uniform sampler2D picture;
uniform bool cutout;

void main() {
    if (cutout && texture(picture, at).a < 0.4) discard;
}
