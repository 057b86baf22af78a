// Rays in voxel space: p + t*d, t in world units, d a voxel-space direction of world length 1.

// No component of a direction is 0 beside the largest, so that the slab test divides safely at any spacing.
vec3 safe_direction(vec3 d) {
    vec3 least = vec3(1e-7 * max(max(abs(d.x), abs(d.y)), abs(d.z)));
    return mix(d, least, lessThan(abs(d), least));
}

// Brought near length 1 by a power of two, lest squares of what is in the world's or the data's unit vanish or overflow.
vec3 near_one(vec3 v) {
    float largest = max(max(abs(v.x), abs(v.y)), abs(v.z));
    return v * uintBitsToFloat((254u - min(floatBitsToUint(largest) >> 23, 253u)) << 23);
}

// Where the ray enters and leaves the box 0..dims; x > y when it misses.
vec2 box_span(vec3 p, vec3 d, vec3 dims) {
    vec3 a = (vec3(0.0) - p) / d;
    vec3 b = (dims - p) / d;
    vec3 lo = min(a, b);
    vec3 hi = max(a, b);
    return vec2(max(max(lo.x, lo.y), lo.z), min(min(hi.x, hi.y), hi.z));
}
