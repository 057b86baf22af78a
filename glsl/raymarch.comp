// raymarch: direct volume rendering. L = sum over steps of T alpha S, front to back: alpha = 1 - exp(-sigma_t ds) for
// any step (midpoint rule, classification after interpolation), S = albedo * irradiance. A pixel's state (radiance,
// optical depth) stays in memory so that a long ray can be split over dispatches; the depth keeps thin media exact.
// Empty blocks are leapt over on the same sample positions, so that the picture does not change. Some devices execute both
// sides of every branch, but leave a loop once all its rays have: leaps and samples are loops of their own, and the
// samples of RUN steps are taken before blocks are looked at again, the same for all rays of a packet.
// Counted per step in or near matter: one tap, a table lookup, one tap of the irradiance volume, two exp, two loads of
// albedo unless it is constant; per leap one texel. Of a step that only coverage is followed through, a tap and a table lookup.
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

layout(set = 0, binding = 5) uniform sampler3D occupancy;
layout(set = 0, binding = 6, std430) readonly buffer Window { vec4 window[2]; }; // volume's normalised coordinates -> irradiance's: scale, shift

layout(constant_id = 0) const uint SKIP = 1; // 1: leap over empty blocks
layout(constant_id = 1) const uint TINTED = 0; // 1: albedo is constant and stands in tint
layout(constant_id = 2) const uint GREY = 0; // 1: the irradiance volume has one channel of light
layout(constant_id = 3) const uint RUN = 8; // steps between two looks at the blocks
layout(constant_id = 4) const uint CLIPS = 0; // clip planes
layout(constant_id = 5) const uint BACKED = 0; // 1: something is laid behind the picture

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
    vec3 tint;            // radiance per unit of the irradiance volume, times albedo where that is constant
    uint bounds_x;        // first voxel with matter around it, and << 16 one past the last
    uint bounds_y;
    uint bounds_z;
    uint first_step;
    uint step_count;
};
#include "medium.glsl"
#include "clip.glsl"
#define per_unit sigma[uint(TABLE_SIZE) + 4u * CLIPS] // see view.glsl
#include "view.glsl"
#include "occupancy.glsl"

const float DARK = 1e-3;    // transmittance at which a ray ends
const float COVERED = 17.4; // optical depth at which coverage rounds to 1

// From step i on, the first that may hold matter.
uint leap_on(uint i, uint end, vec3 q0, vec3 d, float total) {
    while (i < end) {
        float t = float(i) * step_length;
        float steps = leap(q0 + d * (t + 0.5 * min(step_length, total - t)), d);
        if (steps == 0.0) break;
        i += uint(steps);
    }
    return i;
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= width || pixel.y >= rows) return;
    uint slot = pixel.y * width + pixel.x;
    vec4 s = first_step == 0u ? vec4(0.0) : state[slot];
    float transmittance = exp(-s.a);
    vec3 dims = vec3(textureSize(volume, 0));
    vec3 d = pixel_direction(pixel + uvec2(0u, first_row));
    vec2 span = clip_span(origin, d, box_span(origin, d, dims));
    float begin = max(span.x, 0.0);
    float total = span.y - begin;
    uint steps = total > 0.0 ? uint(ceil(total / step_length)) : 0u;
    uint end = min(steps, first_step + step_count);
    vec3 scale = 1.0 / dims;
    vec3 p0 = (origin + d * begin) * scale;
    vec3 dn = d * scale;
    vec3 q0 = origin + d * begin;
    vec3 window_scale = window[0].xyz;
    vec3 window_shift = window[1].xyz;
    // A step more on both sides of the box: positions are rounded.
    vec2 inside = matter_span(origin, d) - begin;
    uint i = max(first_step, uint(clamp(inside.x / step_length - 2.0, 0.0, float(steps))));
    end = min(end, uint(clamp(inside.y / step_length + 2.0, 0.0, float(steps))));
    while (i < end && transmittance > DARK) {
        if (SKIP == 1) i = leap_on(i, end, q0, d, total);
        uint stop = min(i + RUN, end);
        for (; i < stop && transmittance > DARK; i++) {
            float t = float(i) * step_length;
            float ds = min(step_length, total - t);
            vec3 p = p0 + dn * (t + 0.5 * ds); // normalised coordinates
            float u = table_coordinate(textureLod(volume, p, 0.0).r);
            uint k = min(uint(u), TABLE_SIZE - 2u);
            float f = u - float(k);
            float depth = mix(sigma[k], sigma[k + 1u], f) * ds;
            if (depth > 0.0) {
                float alpha = opacity_of(depth);
                vec4 light = textureLod(irradiance, p * window_scale + window_shift, 0.0);
                // The sky seen through spherical harmonics can ring below zero; light does not.
                vec3 source = max(GREY == 1 ? light.rrr : light.rgb, vec3(0.0)) * tint;
                if (TINTED == 0) source *= mix(albedo[k].rgb, albedo[k + 1u].rgb, f);
                s.rgb += transmittance * alpha * source;
                s.a += depth;
                transmittance = exp(-s.a);
            }
        }
    }
    // What is laid behind may be a million times as bright as the volume: of what passes, more than light's last thousandth counts.
    while (BACKED == 1 && i < end && s.a < COVERED) {
        if (SKIP == 1) i = leap_on(i, end, q0, d, total);
        uint stop = min(i + RUN, end);
        for (; i < stop && s.a < COVERED; i++) {
            float t = float(i) * step_length;
            float ds = min(step_length, total - t);
            s.a += extinction(textureLod(volume, p0 + dn * (t + 0.5 * ds), 0.0).r) * ds;
        }
    }
    state[slot] = s;
}
