// What all programs know of a frame. `rel` = axes of the map, origin at the camera: keeps numbers small.
layout(std140) uniform Frame {
    mat4 clip_from_rel;
    mat4 near_from_rel;   // to the shadow maps, 0..1
    mat4 far_from_rel;
    vec4 right;           // axes of the camera in the map
    vec4 down;
    vec4 forward;
    vec4 lens;            // fx, fy, cx, cy in pixels
    vec4 camera;          // its place in the map, m
    vec4 sun_direction;
    vec4 sun;
    vec4 zenith;
    vec4 horizon;
    vec4 bounce;
    vec4 air;             // haze per metre, clouds, half-shadow in near and in far map (share of its edge)
    vec4 screen;          // picture elements an edge of a pixel, width, height, chance of the garden 0..1
};

// Ray through a fragment, of length 1 along the optical axis.
vec3 ray_of(vec2 fragment) {
#ifdef TRUTH
    vec2 pixel = fragment - 0.5;  // one element a pixel, whatever the picture has
#else
    vec2 pixel = fragment / screen.x - 0.5;
#endif
    return forward.xyz + right.xyz * ((pixel.x - lens.z) / lens.x) + down.xyz * ((pixel.y - lens.w) / lens.y);
}

// Interpolated values of slivers may be anything, even no number. What is compared with them is false then.
vec3 unit(vec3 v) {
    float square = dot(v, v);
    return square > 1e-12 && square < 1e12 ? v * inversesqrt(square) : vec3(0.0, 0.0, 1.0);
}

// Depth of a fragment, within bounds.
float depth_of(vec4 fragment, vec2 span) {
    float depth = 1.0 / fragment.w;
    return depth > span.x ? min(depth, span.y) : span.x;
}
