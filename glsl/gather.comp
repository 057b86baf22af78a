// readwrite: sums
// gather: the sweep's sums of some cells -> the estimators' common layout, coefficient after coefficient; cells that were
// not wanted are given zero.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 0) const uint BANDS = 4;

layout(set = 0, binding = 0, std430) readonly buffer Cells { uint cells[]; };
layout(set = 0, binding = 1) uniform usampler3D cell_map;
layout(set = 0, binding = 2) uniform sampler3D sums0;
layout(set = 0, binding = 3) uniform sampler3D sums1;
layout(set = 0, binding = 4) uniform sampler3D sums2;
layout(set = 0, binding = 5) uniform sampler3D sums3;
layout(set = 0, binding = 6, std430) buffer Sums { float sums[]; };

layout(push_constant) uniform Params {
    uvec3 field_dims;
    uint cell_count;
    uint capacity;
};
#include "slots.glsl"

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
    ivec3 at = ivec3(cell % field_dims.x, (cell / field_dims.x) % field_dims.y, cell / (field_dims.x * field_dims.y));
    uint slot = texelFetch(cell_map, at, 0).x >> 4;
    bool wanted = slot > 0u;
    ivec3 p = slot_place(max(slot, 1u) - 1u);
    store_sums(i, 0u, wanted ? texelFetch(sums0, p, 0) : vec4(0.0));
    if (BANDS > 2) store_sums(i, 1u, wanted ? texelFetch(sums1, p, 0) : vec4(0.0));
    if (BANDS > 2) store_sums(i, 2u, wanted ? texelFetch(sums2, p, 0) : vec4(0.0));
    if (BANDS > 3) store_sums(i, 3u, wanted ? texelFetch(sums3, p, 0) : vec4(0.0));
}
