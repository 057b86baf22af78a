// isosurface: direct isosurface rendering. The first t with D(t) >= iso, found by marching and then bisection; shaded
// once, in the paper's isotropic form (albedo/(4 pi) int V L) or as Lambert (albedo/pi int V L max(0, n.w)) with the
// gradient normal, through the SH product of visibility, light and clamped cosine (bands 0, 1, 2, 4, 6: exact for V and
// L of 4 bands). A pixel's state stays in memory so that a long ray can be split over dispatches.
// Blocks without matter are leapt over on the same sample positions (see raymarch.comp).
// Counted: one texel per leap, one tap per step in blocks with matter, 12 for bisection, 6 for the gradient; then once per hit 8 taps, 8 texels of
// the directory, 32 of the field and 31 x 48 multiply-adds.
// readwrite: state
#version 460
#extension GL_GOOGLE_include_directive : require
#extension GL_EXT_control_flow_attributes : require
#include "constants.glsl"
#include "ray.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(constant_id = 0) const uint BANDS = 4;
#include "field.glsl"
#include "field_bricks.glsl"
layout(constant_id = 2) const uint LAMBERT = 1;
layout(constant_id = 3) const uint SKIP = 1; // 1: leap over empty blocks
layout(constant_id = 4) const uint RUN = 4;  // steps between two looks at the blocks
layout(constant_id = 5) const uint CLIPS = 0; // clip planes

layout(set = 0, binding = 0) uniform sampler3D volume;
layout(set = 0, binding = 1) uniform sampler3D field0;
layout(set = 0, binding = 2) uniform sampler3D field1;
layout(set = 0, binding = 3) uniform sampler3D field2;
layout(set = 0, binding = 4) uniform sampler3D field3;
layout(set = 0, binding = 5, std430) readonly buffer View {
    mat4 voxel_to_world_normal; // direction of a gradient in voxel space -> world space (inverse transpose of the linear part)
    vec4 albedo;
    vec4 field_dims;
    // Isotropic: row 0 holds L_i. Lambert: rows k = 0..30 hold, for coefficient i, sum_j G_ijk L_j h_l(k).
    vec4 product[31 * 16];
    vec4 clip_planes[16]; // see clip.glsl
};
layout(set = 0, binding = 6, std430) buffer State { vec4 state[]; };        // radiance, coverage
layout(set = 0, binding = 7, std430) writeonly buffer Depth { float hit_distance[]; }; // world units from the camera; -1: none
layout(set = 0, binding = 8) uniform sampler3D occupancy;
layout(set = 0, binding = 9) uniform usampler3D bricks;

layout(push_constant) uniform Params {
    vec3 origin;
    float step_length;
    vec3 corner;
    float iso; // as the volume's image returns it
    vec3 du;
    float side; // 1: values rise into the surface; -1: the stored samples are negated values
    vec3 dv;
    uint width;
    vec3 metric_diagonal;
    uint first_row;
    vec3 metric_cross;
    uint rows;
    uint first_step;
    uint step_count;
    uint bounds_x;        // first voxel with matter around it, and << 16 one past the last
    uint bounds_y;
    uint bounds_z;
    float per_unit; // see view.glsl
};
#include "view.glsl"
#include "occupancy.glsl"
#include "sh.glsl"
#include "sh_high.glsl"
vec4 clip_plane(uint k) {
    return clip_planes[k];
}
#include "clip.glsl"
#include "hit.glsl"
#include "around.glsl"

const float INV_4PI = 0.07957747154594767;
const float INV_PI = 0.3183098861837907;

vec3 light_group(vec4 v, uint row, uint g) {
    uint k = row * 16u + 4u * g;
    return v.x * product[k].rgb + v.y * product[k + 1u].rgb + v.z * product[k + 2u].rgb + v.w * product[k + 3u].rgb;
}

vec3 light_row(vec4 v[4], uint row) {
    vec3 sum = light_group(v[0], row, 0u);
    if (BANDS > 2) sum += light_group(v[1], row, 1u) + light_group(v[2], row, 2u);
    if (BANDS > 3) sum += light_group(v[3], row, 3u);
    return sum;
}

// What an open plane sees: the zonal coefficients of a half space about its normal, sqrt(4 pi/(2l+1)) z_l Y_lm(normal).
void half_space(vec3 normal, out vec4 v[4]) {
    float y[16];
    sh_basis(normal, y);
    const float zonal[4] = float[4](6.283185307179586, 3.141592653589793, 0.0, -0.7853981633974483);
    v[0] = vec4(zonal[0] * y[0], zonal[1] * vec3(y[1], y[2], y[3]));
    v[1] = vec4(0.0);
    v[2] = vec4(0.0, zonal[3] * vec3(y[9], y[10], y[11]));
    v[3] = zonal[3] * vec4(y[12], y[13], y[14], y[15]);
}

// The field at a surface point: trilinear among the eight cells around it that say something; see around.glsl.
void surface_visibility(vec3 n, vec3 normal, vec3 outward, out vec4 v[4]) {
    vec4 open[4];
    half_space(normal, open);
    vec3 q = n * field_dims.xyz - 0.5;
    for (int attempt = 0; attempt < 2; attempt++) {
        for (int g = 0; g < 4; g++) v[g] = vec4(0.0);
        float weights = 0.0;
        for (int i = 0; i < 8; i++) {
            ivec3 c;
            float w;
            uint rule = cell_around(q, i, field_dims.xyz, attempt == 1, c, w);
            if (rule == OPEN) {
                for (int g = 0; g < 4; g++) v[g] += w * open[g];
                weights += w;
            } else if (rule == SAYS) {
                uint brick = brick_of(bricks, c);
                weights += w;
                if (brick < HELD) continue; // nobody computed it: dark
                ivec3 p = texel_of(brick, c, ivec3(field_dims.xyz));
                v[0] += w * decode(texelFetch(field0, p, 0), 0u);
                if (BANDS > 2) v[1] += w * decode(texelFetch(field1, p, 0), 1u);
                if (BANDS > 2) v[2] += w * decode(texelFetch(field2, p, 0), 2u);
                if (BANDS > 3) v[3] += w * decode(texelFetch(field3, p, 0), 3u);
            }
        }
        if (weights > 1e-4) {
            for (int g = 0; g < 4; g++) v[g] /= weights;
            break;
        }
        q += outward;
    }
    if (BANDS == 1) v[0].yzw = vec3(0.0);
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= width || pixel.y >= rows) return;
    uint slot = pixel.y * width + pixel.x;
    if (first_step == 0u) {
        state[slot] = vec4(0.0);
        hit_distance[slot] = -1.0;
    } else if (state[slot].a > 0.0) {
        return;
    }
    vec3 dims = vec3(textureSize(volume, 0));
    vec3 d = pixel_direction(pixel + uvec2(0u, first_row));
    vec2 span = clip_span(origin, d, box_span(origin, d, dims));
    float begin = max(span.x, 0.0);
    float total = span.y - begin;
    if (!(total > 0.0)) return;
    uint steps = uint(ceil(total / step_length));
    uint end = min(steps, first_step + step_count);
    Line line = line_of(origin, d, begin, span.y, dims);

    // Steps before the box around all matter and behind it find nothing; one more on both sides, for positions are rounded.
    vec3 q0 = origin + d * begin;
    vec2 inside = matter_span(origin, d) - begin;
    uint first = max(first_step, uint(clamp(inside.x / step_length - 2.0, 0.0, float(steps))));
    end = min(end, uint(clamp(inside.y / step_length + 2.0, 0.0, float(steps))));
    float lo = min(float(first) * step_length, total);
    float hi = -1.0;
    if (first < end) {
        if (above_at(line, lo) >= 0.0) {
            hi = lo; // the volume's own face, or a clip plane, cuts the surface open
        } else {
            uint i = first + 1u;
            while (i <= end && hi < 0.0) {
                if (SKIP == 1) {
                    while (i <= end) {
                        float steps = leap(q0 + d * min(float(i) * step_length, total), d);
                        if (steps == 0.0) break;
                        i += uint(steps);
                        lo = min(float(i - 1u) * step_length, total);
                    }
                }
                i = search(line, i, min(i + RUN, end + 1u), lo, hi);
            }
        }
    }
    if (hi < 0.0) return;
    bool cut_open = hi == lo;
    if (!cut_open) bisect(line, BISECTIONS, lo, hi);
    float t = 0.5 * (lo + hi);
    vec3 n = line.p0 + line.dn * t;
    vec3 normal = normal_at(line, t, cut_open);
    vec3 outward = one_cell_out(normal, dims, field_dims.xyz);
    vec4 v[4];
    surface_visibility(n, normal, outward, v);
    vec3 radiance;
    if (LAMBERT == 0u) {
        radiance = INV_4PI * light_row(v, 0u);
    } else {
        float y[SH_HIGH_COUNT];
        sh_even(normal, y);
        vec3 sum = vec3(0.0);
        // Unrolled, these rows take lavapipe 20 s to compile at the first dispatch; as a loop 0.4 s.
        [[dont_unroll]] for (uint k = 0u; k < uint(SH_HIGH_COUNT); k++) sum += y[k] * light_row(v, k);
        radiance = INV_PI * sum;
    }
    state[slot] = vec4(albedo.rgb * max(radiance, vec3(0.0)), 1.0);
    hit_distance[slot] = begin + t;
}
