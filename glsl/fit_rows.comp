// fit_rows: the normal equations of a wanted cell, for four coefficients: with phi the trilinear weights by which points read
// cells, D = sum w phi, row = sum w phi phi' / D over the 27 cells around, side = sum w phi v / D. A point counts by its
// weight times the share of the sky that it sees: what sees light is seen. Begins the solution with the cell's own sums.
// Counted per cell: 27 boxes' points, 32 bytes each, and for those within reach 16 more and 40 multiply-adds; 156 bytes written.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 0) const bool ROWS = true; // false: the rows are known, only the side is wanted

layout(set = 0, binding = 0, std430) readonly buffer Cells { uint cells[]; };
layout(set = 0, binding = 1, std430) readonly buffer Boxes { uint boxes[]; }; // per cell of the field: its box + 1, 0 without points
layout(set = 0, binding = 2, std430) readonly buffer Points { vec4 points[]; };
layout(set = 0, binding = 3, std430) readonly buffer Seen { float seen[]; };
layout(set = 0, binding = 4) uniform sampler3D sums; // four coefficients of the wanted cells' slots
layout(set = 0, binding = 5, std430) writeonly buffer Rows { float rows[]; };  // 27 x cells
layout(set = 0, binding = 6, std430) writeonly buffer Side { vec4 side[]; };
layout(set = 0, binding = 7, std430) writeonly buffer Solution { vec4 solution[]; };

layout(push_constant) uniform Params {
    vec3 cell_size; // voxels
    uint first_cell;
    uvec3 field_dims;
    uint count;
    uint cell_count;
    uint point_count; // per box
    uint capacity;    // all points
    uint coefficient; // the first of the four
    uint kept;        // coefficients that there are
    float mean;       // of V from the first sum: 1/(N Y_00)
};
#include "slots.glsl"

void main() {
    uint g = gl_GlobalInvocationID.x;
    if (g >= count) return;
    uint slot = first_cell + g;
    uint cell = cells[slot];
    ivec3 dims = ivec3(field_dims);
    ivec3 at = ivec3(cell % field_dims.x, (cell / field_dims.x) % field_dims.y, cell / (field_dims.x * field_dims.y));
    vec3 last = vec3(dims - 1);
    float row[27];
    for (int i = 0; i < 27; i++) row[i] = 0.0;
    vec4 b = vec4(0.0);
    float total = 0.0;
    for (int nb = 0; nb < 27; nb++) {
        ivec3 q = at + ivec3(nb % 3, nb / 3 % 3, nb / 9) - 1;
        uint box = 0u;
        if (all(greaterThanEqual(q, ivec3(0))) && all(lessThan(q, dims))) box = boxes[q.x + dims.x * (q.y + dims.y * q.z)];
        // The same number of turns for all invocations, as in sweep.comp.
        for (uint j = 0u; j < point_count; j++) {
            uint point = (max(box, 1u) - 1u) * point_count + j;
            vec4 p = points[point];
            // From this cell's centre, in cells; the field is clamped to its outermost centres.
            vec3 u = clamp(p.xyz / cell_size - 0.5, vec3(0.0), last) - vec3(at);
            vec3 phi = max(1.0 - abs(u), 0.0);
            float w = p.w * clamp(seen[point] * mean, 0.0, 1.0) * phi.x * phi.y * phi.z;
            if (box > 0u && w > 0.0) {
                total += w;
                vec4 v = vec4(0.0);
                for (uint c = 0u; c < 4u; c++) {
                    if (coefficient + c < kept) v[c] = seen[(coefficient + c) * capacity + point];
                }
                b += w * v;
                if (ROWS) {
                    vec3 below = max(-u, 0.0);
                    vec3 above = max(u, 0.0);
                    float wx[3] = float[3](below.x, phi.x, above.x);
                    float wy[3] = float[3](below.y, phi.y, above.y);
                    float wz[3] = float[3](below.z, phi.z, above.z);
                    for (int i = 0; i < 27; i++) row[i] += w * wx[i % 3] * wy[i / 3 % 3] * wz[i / 9];
                }
            }
        }
    }
    float scale = total > 0.0 ? 1.0 / total : 0.0;
    if (ROWS) for (int i = 0; i < 27; i++) rows[uint(i) * cell_count + slot] = row[i] * scale;
    side[slot] = b * scale;
    solution[slot] = texelFetch(sums, slot_place(slot), 0);
}
