// Leaps over empty blocks. Needs in scope: occupancy (sampler3D of block distances), bounds_x, bounds_y, bounds_z, step_length.

const float MATTER = 0.5;

// Box around all that holds matter, voxels.
vec2 matter_span(vec3 p, vec3 d) {
    vec3 lo = vec3(bounds_x & 0xffffu, bounds_y & 0xffffu, bounds_z & 0xffffu);
    vec3 hi = vec3(bounds_x >> 16, bounds_y >> 16, bounds_z >> 16);
    return box_span(p - lo, d, hi - lo);
}

// Steps from voxel position q to the first that may hold matter; 0 where this block does. The box of blocks nearer than the
// distance is empty, and so is half a voxel around it: rounding does not matter.
float leap(vec3 q, vec3 d) {
    ivec3 last = textureSize(occupancy, 0) - 1;
    ivec3 block = clamp(ivec3(q * (1.0 / float(BLOCK))), ivec3(0), last);
    float far = texelFetch(occupancy, block, 0).r * 255.0;
    if (far < MATTER) return 0.0;
    vec3 wall = (vec3(block) + mix(vec3(1.0 - far), vec3(far), greaterThan(d, vec3(0.0)))) * float(BLOCK);
    vec3 room = (wall - q) / d;
    return max(ceil(min(min(room.x, room.y), room.z) / step_length), 1.0);
}
