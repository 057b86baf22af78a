// What the estimators of the visibility field share: which cells, which directions, and the sums of V*Y_lm.
// One invocation is one field cell; it adds a run of directions to its 16 sums, in order, so that the bits do not
// depend on how directions are split over dispatches.

layout(constant_id = 0) const uint BANDS = 4;

struct Direction {
    vec4 voxel;  // xyz: direction in voxel space, of world length 1
    vec4 basis[4]; // Y_lm of the world direction, index l(l+1)+m
};

layout(set = 0, binding = 0, std430) readonly buffer Cells { uint cells[]; };              // linear field indices
layout(set = 0, binding = 1, std430) readonly buffer Directions { Direction directions[]; }; // pattern after pattern
layout(set = 0, binding = 2, std430) buffer Sums { float sums[]; };                          // coefficient after coefficient

uint pcg_hash(uint v) {
    uint state = v * 747796405u + 2891336453u;
    uint word = ((state >> ((state >> 28u) + 4u)) ^ state) * 277803737u;
    return (word >> 22u) ^ word;
}

// Centre of a field cell in voxel coordinates.
vec3 cell_centre(uint cell, uvec3 field_dims, vec3 cell_size) {
    uvec3 c = uvec3(cell % field_dims.x, (cell / field_dims.x) % field_dims.y, cell / (field_dims.x * field_dims.y));
    return (vec3(c) + 0.5) * cell_size;
}

vec4 load_sums(uint i, uint group, uint capacity) {
    uint k = 4u * group * capacity + i;
    return vec4(sums[k], sums[k + capacity], sums[k + 2u * capacity], sums[k + 3u * capacity]);
}

void store_sums(uint i, uint group, uint capacity, vec4 s) {
    uint k = 4u * group * capacity + i;
    sums[k] = s.x;
    sums[k + capacity] = s.y;
    sums[k + 2u * capacity] = s.z;
    sums[k + 3u * capacity] = s.w;
}

// World distance from p (inside the box) along d to where the ray leaves the box 0..dims.
float exit_distance(vec3 p, vec3 d, vec3 dims) {
    vec3 t = (mix(vec3(0.0), dims, greaterThan(d, vec3(0.0))) - p) / d;
    return max(min(min(t.x, t.y), t.z), 0.0);
}
