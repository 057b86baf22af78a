#version 460
// How finely does the device interpolate? Samples a ramp of two texels, 0 and 1, between their centres: what comes back is the
// weight of the second. With `snap` places are rounded to so many steps before they are sampled: for the test of this probe.
layout(local_size_x = 64) in;

layout(push_constant) uniform Params {
    uint places;
    float snap;
};

layout(set = 0, binding = 0) uniform sampler3D ramp;
layout(set = 0, binding = 1, std430) writeonly buffer Weights { float weights[]; };

void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= places) return;
    float f = (float(i) + 0.5) / float(places);
    if (snap > 0.0) f = floor(f * snap + 0.5) / snap;
    weights[i] = textureLod(ramp, vec3(0.25 + 0.5 * f, 0.5, 0.5), 0.0).r;
}
