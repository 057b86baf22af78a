// The camera's rays in voxel space. Needs in scope: origin; corner, du, dv, metric_diagonal and metric_cross in a unit of length near
// a voxel's, so that no square leaves single precision; per_unit, that unit's worth in world units, inverted. A power of two: it
// changes no bit.

// Direction of the ray through the centre of pixel (i, j), row 0 on top, scaled to world length 1.
vec3 pixel_direction(uvec2 pixel) {
    vec3 d = corner + float(pixel.x) * du + float(pixel.y) * dv;
    // Its length from the metric M^T M (diagonal, and xy, xz, yz): that in the world, for the unit falls out.
    float length2 = dot(metric_diagonal, d * d) + 2.0 * dot(metric_cross, vec3(d.x * d.y, d.x * d.z, d.y * d.z));
    return safe_direction(d * inversesqrt(length2) * per_unit);
}
