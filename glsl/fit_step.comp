// fit_step: an iteration of the fit (Chebyshev semi-iteration: Golub and Varga 1961), for four coefficients:
// r = side - row.x + lambda (x0 - x), move = keep*move + add*r, x' = x + move. The last one stores what was found, within
// the range that a fitted field packs.
// Counted per cell: 2 texels, 27 x 24 bytes of rows, places and neighbours, 80 more; 108 multiply-adds.
// readwrite: moves
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 0) const bool LAST = false;

layout(set = 0, binding = 0, std430) readonly buffer Cells { uint cells[]; };
layout(set = 0, binding = 1, std430) readonly buffer Places { uint places[]; }; // per cell of the field: its equation + 1, or 0
layout(set = 0, binding = 2, std430) readonly buffer Rows { float rows[]; };
layout(set = 0, binding = 3, std430) readonly buffer Side { float side[]; };
layout(set = 0, binding = 4) uniform usampler3D cell_map;
layout(set = 0, binding = 5) uniform sampler3D sums; // what the fit begins with and is held to
layout(set = 0, binding = 6, std430) readonly buffer Before { vec4 before[]; };
layout(set = 0, binding = 7, std430) writeonly buffer After { vec4 after[]; };
layout(set = 0, binding = 8, std430) buffer Moves { vec4 moves[]; };
layout(set = 0, binding = 9, rgba32f) uniform writeonly image3D fitted;

layout(push_constant) uniform Params {
    uvec3 field_dims;
    uint first_cell;
    uint count;
    uint cell_count;
    uint coefficient; // the first of the four
    uint kept;        // coefficients that there are
    float keep;
    float add;
    float lambda;
    float unit; // sums to a coefficient of 1: N/(4 pi)
};
#include "slots.glsl"

void main() {
    uint g = gl_GlobalInvocationID.x;
    if (g >= count) return;
    uint slot = first_cell + g;
    uint cell = cells[slot];
    ivec3 dims = ivec3(field_dims);
    ivec3 at = ivec3(cell % field_dims.x, (cell / field_dims.x) % field_dims.y, cell / (field_dims.x * field_dims.y));
    vec4 x = before[slot];
    vec4 r = vec4(0.0);
    for (uint c = 0u; c < 4u; c++) {
        if (coefficient + c < kept) r[c] = side[(coefficient + c) * cell_count + slot];
    }
    for (int i = 0; i < 27; i++) {
        float a = rows[uint(i) * cell_count + slot];
        ivec3 q = clamp(at + ivec3(i % 3, i / 3 % 3, i / 9) - 1, ivec3(0), dims - 1);
        uint other = places[q.x + dims.x * (q.y + dims.y * q.z)];
        r -= (other > 0u ? a : 0.0) * before[max(other, 1u) - 1u];
    }
    // The centre's weight: a cell that no visible point reads stays as it is.
    bool read = rows[13u * cell_count + slot] > 0.0;
    ivec3 p = slot_place(max(texelFetch(cell_map, at, 0).x >> 4, 1u) - 1u);
    r += lambda * (texelFetch(sums, p, 0) - x);
    vec4 move = keep > 0.0 ? keep * moves[slot] + add * r : add * r;
    x += read ? move : vec4(0.0);
    if (LAST) {
        vec4 range = unit * vec4(PACK_RANGE[coefficient], PACK_RANGE[coefficient + 1u], PACK_RANGE[coefficient + 2u], PACK_RANGE[coefficient + 3u]);
        vec4 least = -2.0 * range;
        vec4 most = 2.0 * range;
        if (coefficient == 0u) least.x = -0.5 * range.x;
        if (coefficient == 0u) most.x = 1.5 * range.x;
        imageStore(fitted, p, clamp(x, least, most));
    } else {
        moves[slot] = move;
        after[slot] = x;
    }
}
