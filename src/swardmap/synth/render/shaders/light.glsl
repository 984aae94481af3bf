uniform sampler2DShadow shadow_near;
uniform sampler2DShadow shadow_far;

// Share of the sun that reaches a point; `taps` on an edge of the filter.
float lit_share(sampler2DShadow map, vec3 at, float radius, int taps) {
    float sum = 0.0;
    float step = taps > 1 ? 2.0 / float(taps - 1) : 0.0;
    for (int j = 0; j < taps; j++)
        for (int i = 0; i < taps; i++) {
            vec2 off = taps > 1 ? vec2(float(i), float(j)) * step - 1.0 : vec2(0.0);
            sum += texture(map, vec3(at.xy + off * radius, at.z));
        }
    return sum / float(taps * taps);
}

float sunlit(vec3 rel, vec3 normal, int taps) {
    vec3 at = (near_from_rel * vec4(rel + normal * 0.012, 1.0)).xyz;
    if (all(greaterThan(at.xy, vec2(0.02))) && all(lessThan(at.xy, vec2(0.98))))
        return lit_share(shadow_near, at, air.z, taps);
    at = (far_from_rel * vec4(rel + normal * 0.04, 1.0)).xyz;
    if (any(lessThan(at.xy, vec2(0.01))) || any(greaterThan(at.xy, vec2(0.99)))) return 1.0;
    return lit_share(shadow_far, at, air.w, taps);
}

// Light of sky and ground on a surface that faces along `normal`, as radiance of white.
vec3 ambient(vec3 normal) {
    vec3 above = 0.55 * zenith.rgb + 0.45 * horizon.rgb;
    vec3 beside = 0.5 * (0.35 * zenith.rgb + 0.65 * horizon.rgb) + 0.5 * bounce.rgb;
    return normal.z > 0.0 ? mix(beside, above, normal.z) : mix(beside, bounce.rgb, -normal.z);
}

// Colour of the clear sky.
vec3 sky_color(vec3 direction) {
    float up = max(direction.z, 0.0);
    vec3 color = mix(horizon.rgb, zenith.rgb, 1.0 - exp(-3.0 * up));
    float near = max(dot(direction, sun_direction.xyz), 0.0);
    return color + sun.rgb * (0.025 * pow(near, 8.0) + 0.05 * pow(near, 90.0));
}

vec3 through_air(vec3 color, vec3 rel) {
    return mix(horizon.rgb, color, exp(-air.x * length(rel)));
}
