#include "outputs.glsl"
#ifdef RADIANCE
centroid in vec4 lit;
#endif

void main() {
#ifdef RADIANCE
    radiance = lit;
#endif
#ifdef TRUTH
    depth_m = 1.0 / gl_FragCoord.w;
    ids = uvec2(GRASS, 0u);
#endif
}
