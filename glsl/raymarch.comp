// raymarch: direct volume rendering. L = sum over steps of T alpha S, front to back: alpha = 1 - exp(-sigma_t ds) for
// any step (midpoint rule, classification after interpolation), S = albedo * irradiance. A pixel's state (radiance,
// optical depth) stays in memory so that a long ray can be split over dispatches; the depth keeps thin media exact.
// Counted per step: one tap and a table lookup; where there is matter also one tap of the irradiance volume, an exp
// and two loads of albedo.
// readwrite: state
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "ray.glsl"
#include "opacity.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(set = 0, binding = 0) uniform sampler3D volume;
layout(set = 0, binding = 1, std430) readonly buffer Sigma { float sigma[]; };
layout(set = 0, binding = 2, std430) readonly buffer Albedo { vec4 albedo[]; };
layout(set = 0, binding = 3) uniform sampler3D irradiance;
layout(set = 0, binding = 4, std430) buffer State { vec4 state[]; }; // radiance, optical depth

layout(push_constant) uniform Params {
    vec3 origin;          // voxel space
    float step_length;    // world units
    vec3 corner;          // see view.glsl
    float map_scale;
    vec3 du;
    float map_bias;
    vec3 dv;
    uint width;           // pixels per row
    vec3 metric_diagonal;
    uint first_row;
    vec3 metric_cross;
    uint rows;            // rows of this dispatch
    uint first_step;
    uint step_count;
    float light_scale;    // radiance per unit of the irradiance volume
};
#include "medium.glsl"
#include "view.glsl"

const float DARK = 1e-3; // transmittance at which a ray ends

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= width || pixel.y >= rows) return;
    uint slot = pixel.y * width + pixel.x;
    vec4 s = first_step == 0u ? vec4(0.0) : state[slot];
    float transmittance = exp(-s.a);
    vec3 dims = vec3(textureSize(volume, 0));
    vec3 d = pixel_direction(pixel + uvec2(0u, first_row));
    vec2 span = box_span(origin, d, dims);
    float begin = max(span.x, 0.0);
    float total = span.y - begin;
    uint steps = total > 0.0 ? uint(ceil(total / step_length)) : 0u;
    uint end = min(steps, first_step + step_count);
    vec3 scale = 1.0 / dims;
    vec3 p0 = (origin + d * begin) * scale;
    vec3 dn = d * scale;
    for (uint i = first_step; i < end && transmittance > DARK; i++) {
        float t = float(i) * step_length;
        float ds = min(step_length, total - t);
        vec3 p = p0 + dn * (t + 0.5 * ds); // normalised coordinates of volume and field
        float u = table_coordinate(textureLod(volume, p, 0.0).r);
        uint k = min(uint(u), TABLE_SIZE - 2u);
        float f = u - float(k);
        float sigma_t = mix(sigma[k], sigma[k + 1u], f);
        if (sigma_t > 0.0) {
            float depth = sigma_t * ds;
            float alpha = opacity_of(depth);
            vec3 a = mix(albedo[k].rgb, albedo[k + 1u].rgb, f);
            // The sky seen through spherical harmonics can ring below zero; light does not.
            vec3 source = a * max(textureLod(irradiance, p, 0.0).rgb, vec3(0.0)) * light_scale;
            s.rgb += transmittance * alpha * source;
            s.a += depth;
            transmittance = exp(-s.a);
        }
    }
    state[slot] = s;
}
