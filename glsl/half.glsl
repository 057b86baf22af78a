// Rounds to the nearest half float (ties to even) ahead of a store: devices may truncate, which would be a bias that the
// pyramid squares from level to level. Values below 2^-14 keep the device's own rounding.
vec4 to_nearest_half(vec4 x) {
    uvec4 u = floatBitsToUint(x);
    u += 0xfffu + ((u >> 13) & 1u);
    vec4 rounded = uintBitsToFloat(u & 0xffffe000u);
    return mix(x, rounded, greaterThanEqual(abs(x), vec4(6.103515625e-5)));
}
