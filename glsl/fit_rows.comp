// fit_rows: the normal equations of the cells that points read: with phi the trilinear weights by which a point reads cells,
// D = sum w phi, row = sum w phi phi' / D over the 27 cells around, side = sum w phi v / D. A point counts by its weight times
// the share of the sky that it sees: what sees light is seen.
// Counted per cell: 27 boxes' points, 20 bytes each; for those within reach 64 bytes and 60 multiply-adds; 172 bytes written.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 0) const uint BANDS = 4;

layout(set = 0, binding = 0, std430) readonly buffer Cells { uint cells[]; };
layout(set = 0, binding = 1, std430) readonly buffer Boxes { uint boxes[]; }; // per cell of the field: its box + 1, 0 without points
layout(set = 0, binding = 2, std430) readonly buffer Points { vec4 points[]; };
layout(set = 0, binding = 3, std430) readonly buffer Seen { float seen[]; };  // bands^2 x points
layout(set = 0, binding = 4, std430) writeonly buffer Rows { float rows[]; }; // 27 x cells
layout(set = 0, binding = 5, std430) writeonly buffer Side { float side[]; }; // bands^2 x cells

layout(push_constant) uniform Params {
    vec3 cell_size; // voxels
    uint first_cell;
    uvec3 field_dims;
    uint count;
    uint cell_count;
    uint point_count; // per box
    uint capacity;    // all points
    float mean;       // of V from the first sum: 1/(N Y_00)
};

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
    float b[16];
    for (int i = 0; i < 16; i++) b[i] = 0.0;
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
                for (uint c = 0u; c < BANDS * BANDS; c++) b[c] += w * seen[c * capacity + point];
                vec3 below = max(-u, 0.0);
                vec3 above = max(u, 0.0);
                float wx[3] = float[3](below.x, phi.x, above.x);
                float wy[3] = float[3](below.y, phi.y, above.y);
                float wz[3] = float[3](below.z, phi.z, above.z);
                for (int i = 0; i < 27; i++) row[i] += w * wx[i % 3] * wy[i / 3 % 3] * wz[i / 9];
            }
        }
    }
    float scale = total > 0.0 ? 1.0 / total : 0.0;
    for (int i = 0; i < 27; i++) rows[uint(i) * cell_count + slot] = row[i] * scale;
    for (uint c = 0u; c < BANDS * BANDS; c++) side[c * cell_count + slot] = b[c] * scale;
}
