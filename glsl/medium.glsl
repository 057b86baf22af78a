// The medium: scalar sample -> extinction. Needs in scope: sigma[] (TABLE_SIZE entries, then four numbers per clip plane, then
// units per world unit, see view.glsl), map_scale, map_bias.

// Table coordinate 0..TABLE_SIZE-1 of a sample as the image returns it.
float table_coordinate(float d) {
    // The same in every kernel, to the last bit: what occupancy.comp finds empty is empty.
    precise float u = d * map_scale + map_bias;
    return clamp(u, 0.0, float(TABLE_SIZE - 1));
}

// sigma_t [1/world unit] of a sample, linear between table entries.
float extinction(float d) {
    float u = table_coordinate(d);
    uint i = min(uint(u), TABLE_SIZE - 2u);
    return mix(sigma[i], sigma[i + 1u], u - float(i));
}

// Clip plane k; see clip.glsl.
vec4 clip_plane(uint k) {
    uint i = uint(TABLE_SIZE) + 4u * k;
    return vec4(sigma[i], sigma[i + 1u], sigma[i + 2u], sigma[i + 3u]);
}
