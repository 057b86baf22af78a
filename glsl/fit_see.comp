// readwrite: seen
// fit_see: what the points of a slice of cells see in the directions of a batch, right after the sweep came there:
// V = exp(-tau(point -> the centre plane of the slice NEAR further on)) * bilinear(T there), as sweep.comp has it of cells.
// Counted per point and direction: (NEAR - 1/2 .. NEAR + 1/2) x (cell edge .. sqrt(3) cell edges)/step taps with 2 table
// loads each, 4 loads of T, 2 of the direction, 16 multiply-adds, 40 flops of harmonics; per point and batch 32 loads and stores.
// On a separate card LANES invocations share the batch's directions: see sweep.comp.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "sh.glsl"

layout(local_size_x = 64, local_size_y_id = 4) in;

layout(constant_id = 0) const uint BANDS = 4;
layout(constant_id = 1) const uint NEAR = 1; // slices marched densely
layout(constant_id = 2) const uint AXIS = 2; // major axis of the group: slices stand across it
layout(constant_id = 3) const uint CLIPS = 0; // clip planes
layout(constant_id = 4) const uint LANES = 1; // invocations that share the directions of a batch

struct Direction {
    vec4 voxel; // xyz: direction in voxel space, of world length 1
    vec4 world; // xyz: the same in the world, of length 1
};

layout(set = 0, binding = 0, std430) readonly buffer Directions { Direction directions[]; };
layout(set = 0, binding = 1) uniform sampler3D volume;
layout(set = 0, binding = 2, std430) readonly buffer Sigma { float sigma[]; };
layout(set = 0, binding = 3, std430) readonly buffer Transmittance { float transmittance[]; }; // see sweep.comp
layout(set = 0, binding = 4, std430) readonly buffer Points { vec4 points[]; };
layout(set = 0, binding = 5, std430) readonly buffer Order { uint order[]; }; // boxes slice by slice, axis by axis
layout(set = 0, binding = 6, std430) buffer Seen { float seen[]; };           // 16 coefficients x all points

layout(push_constant) uniform Params {
    vec3 cell_size;      // voxels
    float step_length;   // world units, at most
    vec3 volume_dims;    // voxels
    float map_scale;
    uvec3 field_dims;
    float map_bias;
    float plane;         // voxels along the axis: the centre plane whose T is read
    uint ring_slot;      // slot that holds it
    uint first_direction;
    uint direction_count;
    uint begin;          // 1: the sums are fresh
    uint first_box;      // of the order
    uint count;          // points of the slice
    uint point_count;    // per box
    uint capacity;       // all points
};

#include "medium.glsl"
#include "clip.glsl"

// Adds up eight coefficients of the lanes; each lane stores some.
#define SHARE(FIRST) \
    if (BANDS * BANDS > FIRST) { \
        barrier(); \
        for (int j = 0; j < 8; j++) lanes[(j * int(LANES) + int(lane)) * 64 + int(l)] = s[FIRST + j]; \
        barrier(); \
        for (uint j = lane; j < 8u; j += LANES) { \
            float sum = 0.0; \
            for (uint i = 0u; i < LANES; i++) sum += lanes[(j * LANES + i) * 64u + l]; \
            uint at = (uint(FIRST) + j) * capacity + point; \
            if (!outside && uint(FIRST) + j < BANDS * BANDS) seen[at] = begin == 0u ? seen[at] + sum : sum; \
        } \
    }

// What the lanes have of eight coefficients: lane after lane.
shared float lanes[8 * uint(MOST_LANES) * 64];

void main() {
    uint g = gl_GlobalInvocationID.x;
    bool outside = g >= count;
    // Lanes wait for each other.
    if (LANES == 1u && outside) return;
    uint lane = LANES == 1u ? 0u : gl_LocalInvocationID.y;
    g = min(g, count - 1u);
    uint point = order[first_box + g / point_count] * point_count + g % point_count;
    vec3 x = points[point].xyz;
    const uint row = AXIS == 0u ? 1u : 0u;
    const uint column = AXIS == 2u ? 1u : 2u;
    int width = int(field_dims[row]);
    int height = int(field_dims[column]);
    vec3 scale = 1.0 / volume_dims;
    float s[16];
    for (int i = 0; i < 16; i++) s[i] = 0.0;
    uint k = lane;
    if (LANES == 1u || !outside && k < direction_count) do {
        vec3 d = directions[first_direction + k].voxel.xyz;
        vec3 wall = (mix(vec3(0.0), volume_dims, greaterThan(d, vec3(0.0))) - x) / d;
        float end = max(min(min(wall.x, wall.y), wall.z), 0.0);
        float t = (plane - x[AXIS]) / d[AXIS];
        // As many steps for all points: see sweep.comp. The farthest stand half a slice further off.
        float n = max(ceil((float(NEAR) + 0.5) * cell_size[AXIS] / abs(d[AXIS]) / step_length - 1e-3), 1.0);
        vec2 kept = clip_span(x, d, vec2(0.0, min(t, end)));
        float ds = max(kept.y - kept.x, 0.0) / n;
        float depth = 0.0;
        float i = 0.5;
        do {
            depth += extinction(textureLod(volume, (x + d * (kept.x + i * ds)) * scale, 0.0).r);
            i += 1.0;
        } while (i < n);
        vec2 at = vec2(x[row] + d[row] * t, x[column] + d[column] * t) / vec2(cell_size[row], cell_size[column]) - 0.5;
        ivec2 cell = ivec2(floor(at));
        vec2 f = at - vec2(cell);
        ivec2 last = ivec2(width, height) - 1;
        ivec2 lo = clamp(cell, ivec2(0), last);
        ivec2 hi = clamp(cell + 1, ivec2(0), last);
        int base = int((ring_slot * direction_count + k) * uint(width * height));
        float above = mix(transmittance[base + lo.y * width + lo.x], transmittance[base + lo.y * width + hi.x], f.x);
        float below = mix(transmittance[base + hi.y * width + lo.x], transmittance[base + hi.y * width + hi.x], f.x);
        // Beyond the last cell centre T rises to 1 at the wall, half a cell off.
        vec2 out_at = max(max(-at, at - vec2(last)), vec2(0.0));
        vec2 inside = clamp(1.0 - 2.0 * out_at, 0.0, 1.0);
        float beyond = t >= end ? 1.0 : mix(1.0, mix(above, below, f.y), inside.x * inside.y);
        float v = exp(-depth * ds) * beyond;
        float y[16];
        sh_basis(directions[first_direction + k].world.xyz, y);
        for (int c = 0; c < int(BANDS * BANDS); c++) s[c] += v * y[c];
        k += LANES;
    } while (k < direction_count);
    if (LANES > 1u) {
        uint l = gl_LocalInvocationID.x;
        // Written out in the first index: s stays in registers.
        SHARE(0)
        SHARE(8)
        return;
    }
    for (uint c = 0u; c < BANDS * BANDS; c++) {
        uint at = c * capacity + point;
        seen[at] = begin == 0u ? seen[at] + s[c] : s[c];
    }
}
