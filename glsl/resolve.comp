// resolve: a pixel's state -> premultiplied RGBA, as single or half floats. In a volume the state's last number is the optical
// depth, whose opacity is the coverage; a surface's is the coverage itself. Halves are rounded to the nearest, ties to even, by
// bits: devices may truncate.
// Counted per pixel: 16 bytes read, an exp, 16 or 8 bytes written.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "opacity.glsl"

layout(local_size_x = 128) in;

layout(set = 0, binding = 0, std430) readonly buffer State { vec4 state[]; };  // radiance, optical depth or coverage
layout(set = 0, binding = 1, std430) writeonly buffer Pixels { uint pixels[]; };

layout(constant_id = 0) const uint DEPTH = 1; // 1: optical depth
layout(constant_id = 1) const uint HALF = 0;  // 1: half floats

layout(push_constant) uniform Params {
    uint count; // pixels
};

uint half_of(float x) {
    uint bits = floatBitsToUint(x);
    uint sign = bits >> 16 & 0x8000u;
    uint size = bits & 0x7fffffffu;
    if (size > 0x7f800000u) return sign | 0x7e00u;
    // 65520 and more round to infinity.
    if (size >= 0x477ff000u) return sign | 0x7c00u;
    // Below 2^-14 halves are multiples of 2^-24.
    if (size < 0x38800000u) return sign | uint(roundEven(uintBitsToFloat(size) * 16777216.0));
    size += 0xfffu + (size >> 13 & 1u);
    return sign | (size >> 13) - 0x1c000u;
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= count) return;
    vec4 s = state[i];
    if (DEPTH == 1) s.a = opacity_of(s.a);
    if (HALF == 1) {
        pixels[2u * i] = half_of(s.r) | half_of(s.g) << 16;
        pixels[2u * i + 1u] = half_of(s.b) | half_of(s.a) << 16;
    } else {
        for (uint c = 0u; c < 4u; c++) pixels[4u * i + c] = floatBitsToUint(s[c]);
    }
}
