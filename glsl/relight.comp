// relight: field x light -> irradiance volume, the light brought to the range of half floats by the caller.
// S/albedo = 1/(4 pi) sum v_lm L_lm per colour channel (isotropic phase function); alpha holds the mean visibility v_00/(2 sqrt(pi)). The dot product is linear, so filtering its result
// afterwards is exact. The irradiance holds the box around all bricks of the field, so that renderers filter it without
// looking anything up; cells of bricks that are not held are dark.
// Counted per cell of the box: 4 texels and one of the directory read, 48 multiply-adds, 8 bytes written (grey: 4); where no
// brick is held only the bytes and the directory's texel.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "half.glsl"
#include "constants.glsl"

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

layout(constant_id = 0) const uint BANDS = 4;
#include "field.glsl"
#include "field_bricks.glsl"
layout(constant_id = 2) const uint GREY = 0; // 1: the light is the same in all channels: (S/albedo, mean visibility)

layout(set = 0, binding = 0) uniform sampler3D field0;
layout(set = 0, binding = 1) uniform sampler3D field1;
layout(set = 0, binding = 2) uniform sampler3D field2;
layout(set = 0, binding = 3) uniform sampler3D field3;
layout(set = 0, binding = 4, std430) readonly buffer Light { vec4 light[16]; };
layout(set = 0, binding = 5) uniform writeonly image3D irradiance;
layout(set = 0, binding = 6) uniform usampler3D bricks;

layout(push_constant) uniform Params {
    uvec3 field_dims;
    uint first_slice; // of the box
    uint corner_x;    // first cell of the box: a brick begins there, as do work groups
    uint corner_y;
    uint corner_z;
};

const float INV_4PI = 0.07957747154594767;
const float INV_V00 = 0.28209479177387814; // 1/(2 sqrt(pi))

vec3 group_product(vec4 v, uint g) {
    return v.x * light[4u * g].rgb + v.y * light[4u * g + 1u].rgb + v.z * light[4u * g + 2u].rgb + v.w * light[4u * g + 3u].rgb;
}

void main() {
    ivec3 at = ivec3(gl_GlobalInvocationID) + ivec3(0, 0, first_slice);
    ivec3 cell = at + ivec3(corner_x, corner_y, corner_z);
    if (any(greaterThanEqual(at, imageSize(irradiance)))) return;
    uint brick = brick_of(bricks, cell);
    if (brick < HELD) {
        imageStore(irradiance, at, vec4(0.0));
        return;
    }
    ivec3 p = texel_of(brick, cell, ivec3(field_dims));
    vec4 v0 = decode(texelFetch(field0, p, 0), 0u);
    if (BANDS == 1) v0.yzw = vec3(0.0);
    vec3 sum = group_product(v0, 0u);
    if (BANDS > 2) sum += group_product(decode(texelFetch(field1, p, 0), 1u), 1u);
    if (BANDS > 2) sum += group_product(decode(texelFetch(field2, p, 0), 2u), 2u);
    if (BANDS > 3) sum += group_product(decode(texelFetch(field3, p, 0), 3u), 3u);
    vec3 s = sum * INV_4PI;
    float mean = v0.x * INV_V00;
    imageStore(irradiance, at, to_nearest_half(GREY == 1 ? vec4(s.r, mean, 0.0, 0.0) : vec4(s, mean)));
}
