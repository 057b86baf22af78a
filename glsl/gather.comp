// readwrite: sums
// gather: the sweep's sums of some cells -> the estimators' common layout, coefficient after coefficient.
#version 460

layout(local_size_x = 64) in;

layout(constant_id = 0) const uint BANDS = 4;

layout(set = 0, binding = 0, std430) readonly buffer Cells { uint cells[]; };
layout(set = 0, binding = 1) uniform sampler3D sums0;
layout(set = 0, binding = 2) uniform sampler3D sums1;
layout(set = 0, binding = 3) uniform sampler3D sums2;
layout(set = 0, binding = 4) uniform sampler3D sums3;
layout(set = 0, binding = 5, std430) buffer Sums { float sums[]; };

layout(push_constant) uniform Params {
    uvec3 field_dims;
    uint cell_count;
    uint capacity;
};

void store_sums(uint i, uint group, vec4 s) {
    uint k = 4u * group * capacity + i;
    sums[k] = s.x;
    sums[k + capacity] = s.y;
    sums[k + 2u * capacity] = s.z;
    sums[k + 3u * capacity] = s.w;
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= cell_count) return;
    uint cell = cells[i];
    ivec3 p = ivec3(cell % field_dims.x, (cell / field_dims.x) % field_dims.y, cell / (field_dims.x * field_dims.y));
    store_sums(i, 0u, texelFetch(sums0, p, 0));
    if (BANDS > 2) store_sums(i, 1u, texelFetch(sums1, p, 0));
    if (BANDS > 2) store_sums(i, 2u, texelFetch(sums2, p, 0));
    if (BANDS > 3) store_sums(i, 3u, texelFetch(sums3, p, 0));
}
