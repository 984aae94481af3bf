// The rasters of the ground. A cell is a square between four texel centres; `at` is the place in it, 0..1.
uniform sampler2D height_map;
uniform sampler2D lawn_map;
uniform float texel_m;
uniform ivec2 camera_cell;    // under the camera
uniform vec2 camera_offset;   // of the camera from that cell's lower corner, m

struct Place {
    ivec2 cell;
    vec2 at;
    vec2 free;     // 0 along an axis on which the point is beyond the raster, else 1
    bool within;
};

Place place_of(vec2 rel_xy) {
    vec2 grid = (rel_xy + camera_offset) / texel_m, whole = floor(grid);
    Place place = Place(camera_cell + ivec2(whole), grid - whole, vec2(1.0), true);
    ivec2 last = textureSize(height_map, 0) - 2;
    place.free = vec2(greaterThanEqual(place.cell, ivec2(0))) * vec2(lessThanEqual(place.cell, last));
    place.within = all(equal(place.free, vec2(1.0)));
    if (place.cell.x < 0) { place.cell.x = 0; place.at.x = 0.0; }
    if (place.cell.y < 0) { place.cell.y = 0; place.at.y = 0.0; }
    if (place.cell.x > last.x) { place.cell.x = last.x; place.at.x = 1.0; }
    if (place.cell.y > last.y) { place.cell.y = last.y; place.at.y = 1.0; }
    return place;
}

vec4 corners(sampler2D map, ivec2 cell) {
    return vec4(
        texelFetch(map, cell, 0).r, texelFetch(map, cell + ivec2(1, 0), 0).r,
        texelFetch(map, cell + ivec2(0, 1), 0).r, texelFetch(map, cell + ivec2(1, 1), 0).r);
}

// Gradient and height of the triangle above a point, in the map.
vec3 triangle_at(Place place) {
    vec4 z = corners(height_map, place.cell);
    bool lower = place.at.x + place.at.y <= 1.0;
    vec2 slope = lower ? vec2(z.y - z.x, z.z - z.x) : vec2(z.w - z.z, z.w - z.y);
    float height = lower ? z.x + dot(slope, place.at) : z.w - dot(slope, 1.0 - place.at);
    return vec3(place.free * slope / texel_m, height);
}

// Distance to the border of the lawn; beyond the raster all is lawn.
float lawn_at(Place place) {
    if (!place.within) return 1.0;
    vec4 d = corners(lawn_map, place.cell);
    return mix(mix(d.x, d.y, place.at.x), mix(d.z, d.w, place.at.x), place.at.y);
}
