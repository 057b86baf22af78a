#version 460
// For the tests of the runtime: writes four bytes into each texel, `first` in the lowest, one more in each of the next.
layout(local_size_x = 4, local_size_y = 4, local_size_z = 1) in;

layout(push_constant) uniform Params {
    uint first;
};

layout(set = 0, binding = 0, r32ui) uniform writeonly uimage3D texels;

void main() {
    ivec3 p = ivec3(gl_GlobalInvocationID);
    if (any(greaterThanEqual(p, imageSize(texels)))) {
        return;
    }
    uint low = first + uint(p.x);
    imageStore(texels, p, uvec4(low | (low + 1u) << 8 | (low + 2u) << 16 | (low + 3u) << 24));
}
