// fit_points: where in a cell matter is seen, for the field to be fitted to (src/stages/fit.rs). A cell's box is looked at in
// CANDIDATES^3 jittered places; `points` of them are drawn by opacity times exposure, what is left of light over the next
// three voxels along four directions. weight: how much the opacity that a point stands for exceeds its chance.
// Counted per cell: 9 taps per candidate; 64 x points comparisons.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 0) const uint CLIPS = 0; // clip planes

layout(set = 0, binding = 0) uniform sampler3D volume;
layout(set = 0, binding = 1, std430) readonly buffer Sigma { float sigma[]; };
layout(set = 0, binding = 2, std430) readonly buffer Cells { uint cells[]; };
layout(set = 0, binding = 3, std430) writeonly buffer Points { vec4 points[]; }; // xyz: voxels; w: weight, 0 where there is no matter

layout(push_constant) uniform Params {
    vec3 cell_size; // voxels
    float voxel;    // world units
    uvec3 field_dims;
    uint cell_count;
    uint point_count; // per cell
    float map_scale;
    float map_bias;
};
#include "medium.glsl"
#include "clip.glsl"
#include "random.glsl"

const uint PLACES = uint(CANDIDATES * CANDIDATES * CANDIDATES);
// What is exposed less is drawn as if it were so much.
const float LEAST_EXPOSURE = 0.05;

float extinction_at(vec3 p) {
    float s = extinction(textureLod(volume, p / vec3(textureSize(volume, 0)), 0.0).r);
    return is_kept(p) ? s : 0.0;
}

// The mean transmittance over the next 3.25 voxels along the corners of a tetrahedron.
float exposure(vec3 p) {
    float sum = 0.0;
    for (int k = 0; k < 4; k++) {
        vec3 d = vec3((k & 1) == 0 ? 1.0 : -1.0, (k & 2) == 0 ? 1.0 : -1.0, k == 0 || k == 3 ? 1.0 : -1.0) * 0.57735027;
        float depth = 1.75 * extinction_at(p + d) + 1.5 * extinction_at(p + 2.5 * d);
        sum += exp(-depth * voxel);
    }
    return max(0.25 * sum, LEAST_EXPOSURE);
}

vec3 place(uint cell, vec3 corner, uint i) {
    uvec3 h = pcg3d(uvec3(cell, i, 0x66697470u));
    vec3 jitter = vec3(h >> 8) * 5.9604644775390625e-8;
    uint edge = uint(CANDIDATES);
    return (corner + (vec3(i % edge, i / edge % edge, i / (edge * edge)) + jitter) / float(CANDIDATES)) * cell_size;
}

void main() {
    uint g = gl_GlobalInvocationID.x;
    if (g >= cell_count) return;
    uint cell = cells[g];
    vec3 corner = vec3(cell % field_dims.x, (cell / field_dims.x) % field_dims.y, cell / (field_dims.x * field_dims.y));
    float chance[PLACES];
    float exposed[PLACES];
    float total = 0.0;
    for (uint i = 0u; i < PLACES; i++) {
        vec3 p = place(cell, corner, i);
        float alpha = 1.0 - exp(-extinction_at(p) * voxel);
        float e = 1.0;
        if (alpha > 0.0) e = exposure(p);
        exposed[i] = e;
        chance[i] = alpha * e;
        total += alpha * e;
    }
    float first = float(pcg3d(uvec3(cell, PLACES, 0x66697470u)).x >> 8) * 5.9604644775390625e-8;
    for (uint j = 0u; j < point_count; j++) {
        float at = total * (first + float(j)) / float(point_count);
        float sum = 0.0;
        uint pick = 0u;
        for (uint i = 0u; i < PLACES; i++) {
            sum += chance[i];
            // The first that brings the sum beyond `at`, and one that has a chance.
            if (sum <= at) pick = i + 1u;
        }
        pick = min(pick, PLACES - 1u);
        float weight = chance[pick] > 0.0 ? total / (float(point_count) * exposed[pick]) : 0.0;
        points[g * point_count + j] = vec4(place(cell, corner, pick), weight);
    }
}
