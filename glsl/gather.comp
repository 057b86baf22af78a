// readwrite: sums
// gather: the sweep's sums of some cells -> the estimators' common layout, coefficient after coefficient.
// Counted per cell: 5 texels read, 16 floats written; 256 multiply-adds if CORRECT.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 0) const uint BANDS = 4;
layout(constant_id = 1) const bool CORRECT = false; // least squares: for the first directions of a set

layout(set = 0, binding = 0, std430) readonly buffer Cells { uint cells[]; };
layout(set = 0, binding = 1) uniform usampler3D cell_map;
layout(set = 0, binding = 2) uniform sampler3D sums0;
layout(set = 0, binding = 3) uniform sampler3D sums1;
layout(set = 0, binding = 4) uniform sampler3D sums2;
layout(set = 0, binding = 5) uniform sampler3D sums3;
layout(set = 0, binding = 6, std430) readonly buffer Correction { float correction[]; }; // 16 rows of 16, if CORRECT
layout(set = 0, binding = 7, std430) buffer Sums { float sums[]; };

layout(push_constant) uniform Params {
    uvec3 field_dims;
    uint cell_count;
    uint capacity;
};
#include "slots.glsl"

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= cell_count) return;
    uint cell = cells[i];
    ivec3 at = ivec3(cell % field_dims.x, (cell / field_dims.x) % field_dims.y, cell / (field_dims.x * field_dims.y));
    ivec3 p = slot_place(max(texelFetch(cell_map, at, 0).x >> 4, 1u) - 1u);
    vec4 v[4];
    v[0] = texelFetch(sums0, p, 0);
    v[1] = BANDS > 2 ? texelFetch(sums1, p, 0) : vec4(0.0);
    v[2] = BANDS > 2 ? texelFetch(sums2, p, 0) : vec4(0.0);
    v[3] = BANDS > 3 ? texelFetch(sums3, p, 0) : vec4(0.0);
    uint kept = BANDS > 3 ? 4u : BANDS > 2 ? 3u : 1u;
    for (uint c = 0u; c < 4u * kept; c++) {
        float sum = v[c / 4u][c % 4u];
        if (CORRECT) {
            vec4 parts = vec4(0.0);
            for (uint g = 0u; g < kept; g++) {
                uint k = 16u * c + 4u * g;
                parts += v[g] * vec4(correction[k], correction[k + 1u], correction[k + 2u], correction[k + 3u]);
            }
            sum = dot(parts, vec4(1.0));
        }
        sums[c * capacity + i] = sum;
    }
}
