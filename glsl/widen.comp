// widen: samples as a host stores them -> as the volume's image does: 16-bit unorm, or float. 8 bits are spread exactly
// (v 257 / 65535 = v / 255), signed integers are moved by 2^7 or 2^15 first. Exact integer arithmetic, no rounding.
// Counted per word written: one load, 4 bytes written; 1 to 4 bytes read.
#version 460
layout(local_size_x = 128) in;

layout(set = 0, binding = 0, std430) readonly buffer Narrow { uint narrow[]; };  // tightly packed, little-endian
layout(set = 0, binding = 1, std430) writeonly buffer Wide { uint wide[]; };     // as the image takes them

layout(constant_id = 0) const uint KIND = 1; // 1: uint8, 2: int8, 3: int16, 4: float16

layout(push_constant) uniform Params {
    uint words; // to write: two integers or one float each
};

// By bits: unpackHalf2x16 may flush what is below the normal halves.
uint float_of_half(uint h) {
    uint sign = (h & 0x8000u) << 16;
    uint exponent = (h >> 10) & 31u;
    uint mantissa = h & 1023u;
    if (exponent == 31u) return sign | 0x7f800000u | mantissa << 13;
    if (exponent == 0u) return sign | floatBitsToUint(float(mantissa) * 5.9604644775390625e-8);
    return sign | (exponent + 112u) << 23 | mantissa << 13;
}

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= words) return;
    if (KIND == 3) {
        wide[i] = narrow[i] ^ 0x80008000u;
        return;
    }
    uint pair = narrow[i >> 1] >> (16u * (i & 1u)) & 0xffffu;
    if (KIND == 1) {
        wide[i] = (pair & 0xffu) * 257u | ((pair >> 8) * 257u) << 16;
    } else if (KIND == 2) {
        pair ^= 0x8080u;
        wide[i] = (pair & 0xffu) * 257u | ((pair >> 8) * 257u) << 16;
    } else {
        wide[i] = float_of_half(pair);
    }
}
