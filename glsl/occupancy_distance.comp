// occupancy_distance: one axis of the separable Chebyshev distance transform, in blocks: d'(p) = min over k of
// max(|k|, d(p + k)). After x, y and z all blocks nearer than d hold no matter (Deakin & Knoll 2019). The search ends where
// |k| reaches what is found. Counted per block: 1 to 2 MAX_LEAP + 1 texels, one byte written.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

layout(set = 0, binding = 0) uniform sampler3D before;
layout(set = 0, binding = 1) uniform writeonly image3D after;

layout(push_constant) uniform Params {
    uint axis;
    uint first_slice;
};

float at(ivec3 p) {
    return texelFetch(before, p, 0).r * 255.0;
}

void main() {
    ivec3 p = ivec3(gl_GlobalInvocationID) + ivec3(0, 0, first_slice);
    ivec3 dims = textureSize(before, 0);
    if (any(greaterThanEqual(p, dims))) return;
    ivec3 along = ivec3(axis == 0u, axis == 1u, axis == 2u);
    int place = p[axis];
    int length = dims[axis];
    float d = at(p);
    for (int k = 1; float(k) < d - 0.5; k++) {
        // Beyond the volume there is nothing.
        if (place >= k) d = min(d, max(float(k), at(p - k * along)));
        if (place + k < length) d = min(d, max(float(k), at(p + k * along)));
    }
    imageStore(after, p, vec4(d / 255.0));
}
