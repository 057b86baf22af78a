// pack: sums of V*Y_lm -> the four packed images of the field. Multiplies by 4 pi / N (Monte Carlo estimate of the
// integral), scrubs NaN to 0, quantises each coefficient over its own analytic range.
// Counted: 16 floats and a texel of the directory read, 16 to 64 bytes written per cell.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 0) const uint BANDS = 4;
#include "field.glsl"
#include "field_bricks.glsl"

layout(set = 0, binding = 0, std430) readonly buffer Cells { uint cells[]; };
layout(set = 0, binding = 1, std430) readonly buffer Sums { float sums[]; };
layout(set = 0, binding = 2) uniform writeonly uimage3D field0;
layout(set = 0, binding = 3) uniform writeonly uimage3D field1;
layout(set = 0, binding = 4) uniform writeonly uimage3D field2;
layout(set = 0, binding = 5) uniform writeonly uimage3D field3;
layout(set = 0, binding = 6) uniform usampler3D bricks;

layout(push_constant) uniform Params {
    uvec3 field_dims;
    uint cell_count;
    uint capacity;
    float weight; // 4 pi / N; 1 for coefficients that are finished
};

uvec4 packed(uint i, uint group) {
    uint k = 4u * group * capacity + i;
    vec4 v = weight * vec4(sums[k], sums[k + capacity], sums[k + 2u * capacity], sums[k + 3u * capacity]);
    v = mix(v, vec4(0.0), isnan(v));
    // Slots beyond bands^2 stay neutral.
    uint kept = BANDS * BANDS;
    if (4u * group + 1u >= kept) v.y = 0.0;
    if (4u * group + 2u >= kept) v.z = 0.0;
    if (4u * group + 3u >= kept) v.w = 0.0;
    uvec4 q = quantise(v, group);
    // One coefficient alone has an image of one component; four share a word (8 bits) or two (16 bits).
    if (BANDS == 1 || BITS == 32) return q;
    if (BITS == 16) return uvec4(q.x | q.y << 16, q.z | q.w << 16, 0u, 0u);
    return uvec4(q.x | q.y << 8 | q.z << 16 | q.w << 24, 0u, 0u, 0u);
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= cell_count) return;
    uint cell = cells[i];
    ivec3 at = ivec3(cell % field_dims.x, (cell / field_dims.x) % field_dims.y, cell / (field_dims.x * field_dims.y));
    uint brick = brick_of(bricks, at);
    if (brick < HELD) return;
    ivec3 p = texel_of(brick, at, ivec3(field_dims));
    imageStore(field0, p, packed(i, 0u));
    if (BANDS > 2) imageStore(field1, p, packed(i, 1u));
    if (BANDS > 2) imageStore(field2, p, packed(i, 2u));
    if (BANDS > 3) imageStore(field3, p, packed(i, 3u));
}
