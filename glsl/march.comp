// march: the dense estimator, and with small steps and many directions the ground truth. V is the transmittance from
// the cell's centre to the end of the volume, integrated by the midpoint rule with classification after interpolation.
// Counted per cell and direction: length/step taps of the volume, as many table lookups, one exp, 16 multiply-adds.
// readwrite: sums
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "estimate.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 1) const uint CLIPS = 0; // clip planes

layout(set = 0, binding = 3) uniform sampler3D volume;
layout(set = 0, binding = 4, std430) readonly buffer Sigma { float sigma[]; };

layout(push_constant) uniform Params {
    vec3 cell_size;      // voxels
    float step_length;   // world units
    vec3 volume_dims;    // voxels
    float map_scale;
    uvec3 field_dims;
    float map_bias;
    uint cell_count;
    uint capacity;         // stride between coefficients in sums
    uint first_direction;
    uint direction_count;
    uint pattern_size;     // directions in a pattern
    uint patterns;
};
#include "medium.glsl"
#include "clip.glsl"

const float OPAQUE_DEPTH = 10.0; // optical depth at which a ray ends; the rest would change V by less than 5e-5

float visibility(vec3 x, vec3 d) {
    vec2 kept = clip_span(x, d, vec2(0.0, exit_distance(x, d, volume_dims)));
    float begin = kept.x;
    float end = kept.y - begin;
    uint steps = uint(ceil(max(end, 0.0) / step_length));
    vec3 scale = 1.0 / volume_dims;
    float depth = 0.0;
    for (uint i = 0; i < steps; i++) {
        float t = float(i) * step_length;
        float s = min(step_length, end - t);
        depth += s * extinction(textureLod(volume, (x + d * (begin + t + 0.5 * s)) * scale, 0.0).r);
        if (depth > OPAQUE_DEPTH) break;
    }
    return exp(-depth);
}

#include "estimate_main.glsl"
