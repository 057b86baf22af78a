#version 460
// For the tests of the runtime: one binding of each access, one specialization constant of each type, parameters of each shape.
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 3) const uint FACTOR = 2u;
layout(constant_id = 7) const int SHIFT = -1;
layout(constant_id = 9) const float SCALE = 0.5;
layout(constant_id = 12) const bool NEGATE = false;

layout(push_constant) uniform Params {
    vec3 offset;
    uint count;
    ivec2 pair;
    float weights[2];
};

layout(set = 0, binding = 4, std430) readonly buffer Source { float source[]; };
layout(set = 0, binding = 1, std430) writeonly buffer Target { float values[]; } target;
// readwrite: total
layout(set = 0, binding = 2, std430) buffer Total { uint total[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) {
        return;
    }
    float value = (source[i] + offset.x + 2.0 * offset.y + 4.0 * offset.z) * float(FACTOR) * SCALE + float(SHIFT + pair.x * pair.y);
    value += weights[0] - weights[1] + PACK_RANGE[1] - PACK_RANGE[COEFFICIENTS - 13];
    target.values[i] = NEGATE ? -value : value;
    total[i] += 1u;
}
