// buried: which cells of a field are centred inside an opaque surface. They see nothing, so nobody estimates them. The
// same test at the same place as isosurface.comp's: what that reads for vacuum is never called buried here.
// Counted per cell: one tap, a bit written.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 64) in;

layout(constant_id = 0) const uint CLIPS = 0; // clip planes

layout(set = 0, binding = 0) uniform sampler3D volume;
layout(set = 0, binding = 1, std430) readonly buffer Sigma { float sigma[]; };
layout(set = 0, binding = 2, std430) writeonly buffer Words { uint words[]; }; // 32 cells each, the first in bit 0

layout(push_constant) uniform Params {
    vec3 field_dims;
    float iso; // as the volume's image returns it
    float side; // 1: values rise into the surface; -1: the stored samples are negated values
    float map_scale;
    float map_bias;
    uint first_word;
    uint word_count;
};
#include "medium.glsl"
#include "clip.glsl"

void main() {
    uint w = gl_GlobalInvocationID.x;
    if (w >= word_count) return;
    uvec3 dims = uvec3(field_dims);
    vec3 voxels = vec3(textureSize(volume, 0));
    uint bits = 0u;
    for (uint b = 0u; b < 32u; b++) {
        uint cell = 32u * (first_word + w) + b;
        vec3 c = vec3(cell % dims.x, (cell / dims.x) % dims.y, cell / (dims.x * dims.y));
        vec3 centre = (c + 0.5) / field_dims;
        bool inside = side * (textureLod(volume, centre, 0.0).r - iso) >= 0.0 && is_kept(centre * voxels);
        if (inside && c.z < field_dims.z) bits |= 1u << b;
    }
    words[w] = bits;
}
