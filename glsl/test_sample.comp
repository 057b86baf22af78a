#version 460
// For the tests of the runtime: one sample through the sampler, and one load of a storage image.
layout(local_size_x = 1) in;

layout(push_constant) uniform Params {
    vec3 position;
    float lod;
};

layout(set = 0, binding = 0) uniform sampler3D image;
layout(set = 0, binding = 1, r32ui) uniform readonly uimage3D texels;
layout(set = 0, binding = 2, std430) writeonly buffer Sampled { vec4 sampled[]; };

void main() {
    sampled[0] = textureLod(image, position, lod);
    sampled[1] = vec4(imageLoad(texels, ivec3(0)));
}
