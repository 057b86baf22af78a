// fit_start: what the fit begins with, for four coefficients: the cells' own sums, which those that no point reads keep.
// Counted per wanted cell: a texel read and one written, 8 bytes of lists, 16 written where points read.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 64) in;

layout(set = 0, binding = 0, std430) readonly buffer Wanted { uint wanted[]; }; // slot by slot
layout(set = 0, binding = 1, std430) readonly buffer Places { uint places[]; }; // per cell of the field: its equation + 1, or 0
layout(set = 0, binding = 2) uniform sampler3D sums;
layout(set = 0, binding = 3, std430) writeonly buffer Solution { vec4 solution[]; };
layout(set = 0, binding = 4, rgba32f) uniform writeonly image3D fitted;

layout(push_constant) uniform Params {
    uint first_slot;
    uint count;
};
#include "slots.glsl"

void main() {
    uint g = gl_GlobalInvocationID.x;
    if (g >= count) return;
    ivec3 p = slot_place(first_slot + g);
    vec4 own = texelFetch(sums, p, 0);
    uint place = places[wanted[first_slot + g]];
    if (place > 0u) solution[place - 1u] = own;
    imageStore(fitted, p, own);
}
