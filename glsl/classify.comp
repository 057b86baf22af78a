// classify: volume -> O_0, the expected opacity of each voxel over one voxel length (Ritschel 2007, section 3.1).
// Absorption is integrated across the voxel along x, y and z through its centre, classification inside the integral.
// Counted: 7 fetches, 12 table lookups, 3 exp per voxel; 2 bytes written.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "half.glsl"
#include "opacity.glsl"
#include "constants.glsl"

layout(local_size_x = 8, local_size_y = 8, local_size_z = 1) in;

layout(constant_id = 0) const uint CLIPS = 0; // clip planes

layout(set = 0, binding = 0) uniform sampler3D volume;
layout(set = 0, binding = 1, std430) readonly buffer Sigma { float sigma[]; };
layout(set = 0, binding = 2) uniform writeonly image3D opacity;

layout(push_constant) uniform Params {
    float map_scale;
    float map_bias;
    float voxel_length; // world units
    uint first_slice;
};
#include "medium.glsl"
#include "clip.glsl"

float fetch(ivec3 p) {
    return texelFetch(volume, clamp(p, ivec3(0), textureSize(volume, 0) - 1), 0).r;
}

// Mean sigma_t along the axis across the voxel: before, here and after are the samples at centre - 1, centre, centre + 1;
// D is linear between them. Midpoint rule with two points in each half; a point that is clipped away counts as vacuum.
float mean_extinction(float before, float here, float after, vec3 centre, vec3 axis) {
    float sum = is_kept(centre - 0.375 * axis) ? extinction(mix(here, before, 0.375)) : 0.0;
    sum += is_kept(centre - 0.125 * axis) ? extinction(mix(here, before, 0.125)) : 0.0;
    sum += is_kept(centre + 0.125 * axis) ? extinction(mix(here, after, 0.125)) : 0.0;
    sum += is_kept(centre + 0.375 * axis) ? extinction(mix(here, after, 0.375)) : 0.0;
    return 0.25 * sum;
}

void main() {
    ivec3 p = ivec3(gl_GlobalInvocationID) + ivec3(0, 0, first_slice);
    if (any(greaterThanEqual(p, textureSize(volume, 0)))) return;
    float here = fetch(p);
    vec3 c = vec3(p) + 0.5;
    vec3 mean = vec3(
        mean_extinction(fetch(p - ivec3(1, 0, 0)), here, fetch(p + ivec3(1, 0, 0)), c, vec3(1.0, 0.0, 0.0)),
        mean_extinction(fetch(p - ivec3(0, 1, 0)), here, fetch(p + ivec3(0, 1, 0)), c, vec3(0.0, 1.0, 0.0)),
        mean_extinction(fetch(p - ivec3(0, 0, 1)), here, fetch(p + ivec3(0, 0, 1)), c, vec3(0.0, 0.0, 1.0)));
    vec3 depth = mean * voxel_length;
    float o = (opacity_of(depth.x) + opacity_of(depth.y) + opacity_of(depth.z)) / 3.0;
    imageStore(opacity, p, to_nearest_half(vec4(o)));
}
