// minify: O_{k-1} -> O_k, the expected opacity over twice the length (Ritschel 2007, section 3.1): a ray crosses two
// successive cells, so transmittances of pairs are multiplied and then averaged. O_k is stated over 2^k voxel lengths.
// A coarse cell is cut into 2x2x2 halves; a half averages the fine cells that it covers (one cell when dims are even,
// up to 3 per axis otherwise). Counted: 8 fetches per cell when dims are even; 2 bytes written.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "half.glsl"

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

layout(constant_id = 0) const uint FILTER = 2; // 0 box, 1 product, 2 axis, 3 extinction

layout(set = 0, binding = 0) uniform sampler3D finer;
layout(set = 0, binding = 1) uniform writeonly image3D coarser;

layout(push_constant) uniform Params {
    uvec3 coarse_dims;
    uint first_slice;
};

// Mean of f over the fine cells covered by half `h` (0..1 per axis) of coarse cell `c`: opacity, or extinction per
// finer length when FILTER is 3.
float half_mean(uvec3 c, uvec3 h, vec3 width, ivec3 fine_dims) {
    vec3 start = vec3(2u * c + h) * width;
    vec3 end = start + width;
    ivec3 first = ivec3(floor(start + 1e-4));
    ivec3 last = min(ivec3(ceil(end - 1e-4)), fine_dims) - 1;
    float sum = 0.0;
    float weights = 0.0;
    for (int z = first.z; z <= last.z; z++) {
        float wz = min(end.z, float(z + 1)) - max(start.z, float(z));
        for (int y = first.y; y <= last.y; y++) {
            float wyz = wz * (min(end.y, float(y + 1)) - max(start.y, float(y)));
            for (int x = first.x; x <= last.x; x++) {
                float w = wyz * (min(end.x, float(x + 1)) - max(start.x, float(x)));
                float o = texelFetch(finer, ivec3(x, y, z), 0).r;
                if (FILTER == 3) o = -log(max(1.0 - o, 1e-7));
                sum += w * o;
                weights += w;
            }
        }
    }
    return sum / weights;
}

void main() {
    uvec3 c = gl_GlobalInvocationID + uvec3(0, 0, first_slice);
    if (any(greaterThanEqual(c, coarse_dims))) return;
    ivec3 fine_dims = textureSize(finer, 0);
    vec3 width = vec3(fine_dims) / vec3(2u * coarse_dims);
    float m[8]; // index x + 2y + 4z
    for (uint i = 0; i < 8; i++) m[i] = half_mean(c, uvec3(i & 1u, (i >> 1) & 1u, i >> 2), width, fine_dims);
    float mean = 0.125 * (((m[0] + m[1]) + (m[2] + m[3])) + ((m[4] + m[5]) + (m[6] + m[7])));
    float opacity;
    if (FILTER == 0) {
        opacity = mean;
    } else if (FILTER == 1) {
        opacity = mean * (2.0 - mean); // 1 - (1 - mean)^2, without cancellation
    } else if (FILTER == 3) {
        opacity = 1.0 - exp(-2.0 * mean);
    } else {
        // 1 - (1-a)(1-b) = a + b - ab for each of the 12 aligned pairs.
        float sum = 0.0;
        for (uint i = 0; i < 8; i++) {
            if ((i & 1u) == 0u) sum += m[i] + m[i + 1] - m[i] * m[i + 1];
            if ((i & 2u) == 0u) sum += m[i] + m[i + 2] - m[i] * m[i + 2];
            if ((i & 4u) == 0u) sum += m[i] + m[i + 4] - m[i] * m[i + 4];
        }
        opacity = sum / 12.0;
    }
    imageStore(coarser, ivec3(c), to_nearest_half(vec4(opacity)));
}
