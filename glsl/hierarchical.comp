// hierarchical: the paper's estimator (Ritschel 2007, section 3.1). The ray starts in O_0 with steps of one voxel; the
// step grows with distance and the level of the opacity pyramid follows it (quadrilinear).
// Counted per cell and direction: about 1/growth + log(length*growth)/log(1+growth) quadrilinear taps (25 for growth 1/4
// and 440 voxels), one log2 and one exp2 each, a pow where the step is not the length that its level states; 16 multiply-adds.
// readwrite: sums
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "estimate.glsl"

layout(local_size_x = 64) in;

layout(set = 0, binding = 3) uniform sampler3D pyramid;

layout(push_constant) uniform Params {
    vec3 cell_size;     // voxels
    float voxel_length; // world units
    vec3 volume_dims;   // voxels
    float growth;       // step per distance
    uvec3 field_dims;
    uint cell_count;
    uint capacity;
    uint first_direction;
    uint direction_count;
    uint pattern_size;
    uint patterns;
};

const float DARK = 1e-4;     // transmittance at which a ray ends
const uint MAX_STEPS = 4096u; // a bound only: growth 0.05 over 4096 voxels takes 190 steps

float visibility(vec3 x, vec3 d) {
    float end = exit_distance(x, d, volume_dims);
    vec3 scale = 1.0 / volume_dims;
    float t = 0.0;
    float transmittance = 1.0;
    float top = float(textureQueryLevels(pyramid) - 1);
    for (uint i = 0; i < MAX_STEPS && t < end; i++) {
        float s = max(voxel_length, growth * t);
        float part = min((end - t) / s, 1.0); // the last step is cut where the volume ends
        float level = log2(s / voxel_length);
        // The pyramid states opacity over 2^level voxel lengths = s; a shorter step sees the power, and so does one that is longer
        // than the coarsest level's.
        float power = level > top ? part * exp2(level - top) : part;
        level = min(level, top);
        // Between two levels blended by length: right for thin matter, whose opacity goes with it.
        float blend = floor(level) + exp2(fract(level)) - 1.0;
        float clear = 1.0 - textureLod(pyramid, (x + d * (t + 0.5 * part * s)) * scale, blend).r;
        transmittance *= power != 1.0 ? (clear > 0.0 ? pow(clear, power) : 0.0) : clear;
        if (transmittance < DARK) break;
        t += s;
    }
    return transmittance;
}

#include "estimate_main.glsl"
