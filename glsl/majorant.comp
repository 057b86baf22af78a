// majorant: the largest extinction in each cell of CELL voxels a side, over all values that trilinear interpolation can
// take there: those between the least and the greatest sample of the cell and of one voxel around it.
// Counted per cell: (CELL + 2)^3 texels read, at most TABLE_SIZE loads, 4 bytes written.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

layout(constant_id = 0) const uint CELL = 8;

layout(set = 0, binding = 0) uniform sampler3D volume;
layout(set = 0, binding = 1, std430) readonly buffer Sigma { float sigma[]; };
layout(set = 0, binding = 2) uniform writeonly image3D majorants;

layout(push_constant) uniform Params {
    uvec3 cells;
    uint first_slice;
    float map_scale;
    float map_bias;
};
#include "medium.glsl"

void main() {
    ivec3 cell = ivec3(gl_GlobalInvocationID) + ivec3(0, 0, first_slice);
    if (any(greaterThanEqual(cell, ivec3(cells)))) return;
    ivec3 last = textureSize(volume, 0) - 1;
    ivec3 lo = max(cell * int(CELL) - 1, ivec3(0));
    ivec3 hi = min((cell + 1) * int(CELL), last);
    float least = 3.402823466e38;
    float most = -3.402823466e38;
    for (int z = lo.z; z <= hi.z; z++) {
        for (int y = lo.y; y <= hi.y; y++) {
            for (int x = lo.x; x <= hi.x; x++) {
                float d = texelFetch(volume, ivec3(x, y, z), 0).r;
                least = min(least, d);
                most = max(most, d);
            }
        }
    }
    // One entry more on both sides: filters round.
    float a = table_coordinate(least);
    float b = table_coordinate(most);
    uint first = uint(max(min(a, b) - 1.0, 0.0));
    uint end = min(uint(max(a, b)) + 2u, uint(TABLE_SIZE - 1));
    float bound = 0.0;
    for (uint i = first; i <= end; i++) bound = max(bound, sigma[i]);
    imageStore(majorants, cell, vec4(bound));
}
