// block_ranges: smallest and largest sample of each block of BLOCK^3 voxels and of one voxel around it, and over all of
// them; samples that are not finite are counted. Compared by their bits, in order, so that no float is rounded or flushed.
// Counted per block: (BLOCK + 2)^3 = 216 texels (3.4 per voxel), one texel written; per work group three atomics.
// readwrite: found
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

layout(set = 0, binding = 0) uniform sampler3D volume;
layout(set = 0, binding = 1) uniform writeonly image3D bounds;
layout(set = 0, binding = 2, std430) buffer Found { uint found[3]; }; // keys of the smallest and largest, odd samples

layout(push_constant) uniform Params {
    uint first_slice;
    uint slices;
};

shared uint least;
shared uint most;
shared uint odd;

// Unsigned integers in the order of the floats.
uint key_of(uint bits) {
    return bits ^ ((bits >> 31) != 0u ? 0xffffffffu : 0x80000000u);
}

uint bits_of(uint key) {
    return key ^ ((key >> 31) != 0u ? 0x80000000u : 0xffffffffu);
}

void main() {
    if (gl_LocalInvocationIndex == 0u) {
        least = 0xffffffffu;
        most = 0u;
        odd = 0u;
    }
    barrier();
    ivec3 block = ivec3(gl_GlobalInvocationID) + ivec3(0, 0, first_slice);
    ivec3 dims = textureSize(volume, 0);
    ivec3 first = block * BLOCK;
    if (all(lessThan(first, dims)) && gl_GlobalInvocationID.z < slices) {
        ivec3 from = max(first - 1, ivec3(0));
        ivec3 to = min(first + BLOCK + 1, dims);
        uint lo = 0xffffffffu;
        uint hi = 0u;
        uint bad = 0u;
        for (int z = from.z; z < to.z; z++) {
            for (int y = from.y; y < to.y; y++) {
                for (int x = from.x; x < to.x; x++) {
                    uint bits = floatBitsToUint(texelFetch(volume, ivec3(x, y, z), 0).r);
                    uint key = key_of(bits);
                    lo = min(lo, key);
                    hi = max(hi, key);
                    // Voxels around the block are other blocks' to count.
                    bool own = all(greaterThanEqual(ivec3(x, y, z), first)) && all(lessThan(ivec3(x, y, z), first + BLOCK));
                    if (own && (bits & 0x7f800000u) == 0x7f800000u) bad++;
                }
            }
        }
        imageStore(bounds, block, vec4(uintBitsToFloat(bits_of(lo)), uintBitsToFloat(bits_of(hi)), 0.0, 0.0));
        atomicMin(least, lo);
        atomicMax(most, hi);
        if (bad > 0u) atomicAdd(odd, bad);
    }
    barrier();
    if (gl_LocalInvocationIndex == 0u) {
        atomicMin(found[0], least);
        atomicMax(found[1], most);
        if (odd > 0u) atomicAdd(found[2], odd);
    }
}
