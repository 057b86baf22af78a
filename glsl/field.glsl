// The visibility field's packed coefficients: t in 0..1 (or the float itself at 32 bits) <-> v_lm. v_00 takes
// [0, 2 sqrt(pi)]; the others take [-R, R] with R = PACK_RANGE, zero exactly representable. Coefficients that are fitted to
// what is read between cells go beyond what can be seen from any point: WIDE, ranges are twice as wide, v_00 from -sqrt(pi).

layout(constant_id = 1) const uint BITS = 8;
layout(constant_id = 9) const bool WIDE = false;

const float UNIT = BITS == 8 ? 255.0 : 65535.0;
const float ZERO = BITS == 8 ? 128.0 : 32768.0;
const float SPAN = BITS == 8 ? 127.0 : 32767.0;

vec4 pack_range(uint group) {
    return vec4(PACK_RANGE[4u * group], PACK_RANGE[4u * group + 1u], PACK_RANGE[4u * group + 2u], PACK_RANGE[4u * group + 3u]);
}

// Coefficients 4*group .. 4*group+3 from a texel of image `group`.
vec4 decode(vec4 texel, uint group) {
    if (BITS == 32) return texel;
    vec4 v = (texel * UNIT - ZERO) * (pack_range(group) / SPAN * (WIDE ? 2.0 : 1.0));
    if (group == 0u) v.x = WIDE ? (texel.x * UNIT - 0.5 * ZERO) * (PACK_RANGE[0] / SPAN) : texel.x * PACK_RANGE[0];
    return v;
}

// The integers that stand for coefficients 4*group .. 4*group+3.
uvec4 quantise(vec4 v, uint group) {
    if (BITS == 32) return floatBitsToUint(v);
    vec4 q = clamp(round(v / pack_range(group) * (WIDE ? 0.5 * SPAN : SPAN)), -SPAN, SPAN) + ZERO;
    if (group == 0u) q.x = WIDE ? clamp(round(v.x / PACK_RANGE[0] * SPAN) + 0.5 * ZERO, 0.0, UNIT) : clamp(round(v.x / PACK_RANGE[0] * UNIT), 0.0, UNIT);
    return uvec4(q);
}
