// Counter-based random numbers: a pixel's draws depend on pixel, sample and count alone, however the work is split.

// pcg3d: Jarzynski and Olano 2020, Hash Functions for GPU Rendering.
uvec3 pcg3d(uvec3 v) {
    v = v * 1664525u + 1013904223u;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    v ^= v >> 16;
    v.x += v.y * v.z;
    v.y += v.z * v.x;
    v.z += v.x * v.y;
    return v;
}

// Two numbers in [0, 1) of 24 bits; advances the count.
vec2 draw(inout uvec3 key) {
    uvec3 h = pcg3d(key);
    key.z++;
    return vec2(h.xy >> 8) * 5.9604644775390625e-8;
}
