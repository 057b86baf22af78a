// sweep: short characteristics. For the directions of one group (same major axis and sign) slices are swept from the side
// that the rays leave by: T(x) = exp(-tau(x -> next slice)) * bilinear(T of the next slice), tau marched densely through
// the volume. V takes NEAR such segments before it trusts the swept T, which diffuses from slice to slice.
// One invocation is one cell of the slice; it takes a batch of directions and keeps its 16 sums in registers.
// Counted per cell and direction: NEAR * (cell edge .. sqrt(3) cell edges)/step taps and table lookups, 4 loads for each
// of 1 or 2 bilinear values, 2 exp, one store, 16 multiply-adds.
// readwrite: transmittance, sums0, sums1, sums2, sums3
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 0) const uint BANDS = 4;
layout(constant_id = 1) const uint NEAR = 1; // slices marched densely before the swept value

struct Direction {
    vec4 voxel;
    vec4 basis[4];
};

layout(set = 0, binding = 0, std430) readonly buffer Directions { Direction directions[]; };
layout(set = 0, binding = 1) uniform sampler3D volume;
layout(set = 0, binding = 2, std430) readonly buffer Sigma { float sigma[]; };
// Ring of NEAR + 1 slices x directions of the batch x cells of a slice.
layout(set = 0, binding = 3, std430) buffer Transmittance { float transmittance[]; };
layout(set = 0, binding = 4, rgba32f) uniform image3D sums0;
layout(set = 0, binding = 5, rgba32f) uniform image3D sums1;
layout(set = 0, binding = 6, rgba32f) uniform image3D sums2;
layout(set = 0, binding = 7, rgba32f) uniform image3D sums3;

layout(push_constant) uniform Params {
    vec3 cell_size;      // voxels
    float step_length;   // world units, at most
    vec3 volume_dims;    // voxels
    float map_scale;
    uvec3 field_dims;
    float map_bias;
    uint axis;           // major axis of the group: slices stand across it
    uint slice;
    uint ring_slot;      // slot that this slice writes; the slice swept m before stands m slots behind
    uint first_direction;
    uint direction_count;
    uint begin;          // 1: the sums are fresh
};
#include "medium.glsl"
#include "ray.glsl"

// Optical depth from distance a to b along the ray, by the midpoint rule with even steps of at most step_length.
float optical_depth(vec3 x, vec3 d, float a, float b, vec3 scale) {
    float n = ceil((b - a) / step_length - 1e-3);
    float s = (b - a) / max(n, 1.0);
    float sum = 0.0;
    for (float i = 0.5; i < n; i += 1.0) sum += extinction(textureLod(volume, (x + d * (a + i * s)) * scale, 0.0).r);
    return sum * s;
}

void main() {
    uint row = axis == 0u ? 1u : 0u;    // axes that span the slice
    uint column = axis == 2u ? 1u : 2u;
    uint width = field_dims[row];
    uint height = field_dims[column];
    uint i = gl_GlobalInvocationID.x;
    uint area = width * height;
    if (i >= area) return;
    vec2 place = vec2(float(i % width), float(i / width));
    uvec3 cell;
    cell[axis] = slice;
    cell[row] = i % width;
    cell[column] = i / width;
    vec3 x = (vec3(cell) + 0.5) * cell_size;
    vec3 scale = 1.0 / volume_dims;
    vec2 last = vec2(float(width) - 1.0, float(height) - 1.0);

    vec4 s0 = vec4(0.0);
    vec4 s1 = vec4(0.0);
    vec4 s2 = vec4(0.0);
    vec4 s3 = vec4(0.0);
    for (uint k = 0u; k < direction_count; k++) {
        vec3 d = directions[first_direction + k].voxel.xyz;
        vec3 room = (mix(vec3(0.0), volume_dims, greaterThan(d, vec3(0.0))) - x) / d;
        float end = min(min(room.x, room.y), room.z);
        float ds = cell_size[axis] / abs(d[axis]); // world distance from slice to slice
        vec2 shift = vec2(d[row] / cell_size[row], d[column] / cell_size[column]) * ds;

        float depth = 0.0;
        float v = 0.0;
        for (uint m = 1u; m <= NEAR; m++) {
            float a = float(m - 1u) * ds;
            float b = min(float(m) * ds, end);
            if (b > a) depth += optical_depth(x, d, a, b, scale);
            float beyond = 1.0; // the ray has left the volume
            if (float(m) * ds < end) {
                vec2 wanted = place + float(m) * shift;
                vec2 q = clamp(wanted, vec2(0.0), last);
                // Beyond the last cell centre T rises to 1 at the wall, half a cell off.
                vec2 inside = 1.0 - clamp(2.0 * abs(wanted - q), 0.0, 1.0);
                vec2 base = min(floor(q), max(last - 1.0, vec2(0.0)));
                vec2 f = q - base;
                uint slot = (ring_slot + NEAR + 1u - m) % (NEAR + 1u);
                uint at = (slot * direction_count + k) * area + uint(base.y) * width + uint(base.x);
                uint right = width > 1u ? 1u : 0u;
                uint below = height > 1u ? width : 0u;
                float upper = mix(transmittance[at], transmittance[at + right], f.x);
                float lower = mix(transmittance[at + below], transmittance[at + below + right], f.x);
                beyond = mix(1.0, mix(upper, lower, f.y), inside.x * inside.y);
            }
            v = exp(-depth) * beyond;
            if (m == 1u) transmittance[(ring_slot * direction_count + k) * area + i] = v;
        }
        s0 += v * directions[first_direction + k].basis[0];
        if (BANDS > 2) s1 += v * directions[first_direction + k].basis[1];
        if (BANDS > 2) s2 += v * directions[first_direction + k].basis[2];
        if (BANDS > 3) s3 += v * directions[first_direction + k].basis[3];
    }

    ivec3 p = ivec3(cell);
    if (begin == 0u) {
        s0 += imageLoad(sums0, p);
        if (BANDS > 2) s1 += imageLoad(sums1, p);
        if (BANDS > 2) s2 += imageLoad(sums2, p);
        if (BANDS > 3) s3 += imageLoad(sums3, p);
    }
    imageStore(sums0, p, s0);
    if (BANDS > 2) imageStore(sums1, p, s1);
    if (BANDS > 2) imageStore(sums2, p, s2);
    if (BANDS > 3) imageStore(sums3, p, s3);
}
