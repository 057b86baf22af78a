// aov: what lies behind a pixel besides its colour, in a second march over raymarch.comp's samples. Sums over steps with the
// weight w = T alpha: w, w distance, w normal (world, length 1, against the gradient of extinction), w albedo,
// w irradiance, w mean visibility; and the distance at which opacity reaches FIRST. A surface is looked at where
// isosurface.comp hit it: its normal, and its visibility from the same cells around it.
// Counted per step in matter: raymarch's, and 6 taps for the normal. Per hit: 6 taps, and 8 taps and 8 texels, twice where no cell
// around lies in vacuum.
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
layout(set = 0, binding = 4, std430) buffer State { vec4 state[]; }; // four a pixel, see main
layout(set = 0, binding = 5, std430) readonly buffer Window { vec4 window[2]; }; // as raymarch.comp's
layout(set = 0, binding = 6, std430) readonly buffer Hits { float hits[]; };    // a surface's, as isosurface.comp left them
layout(set = 0, binding = 7, std430) readonly buffer Frame {
    mat4 voxel_to_world_normal; // direction of a gradient in voxel space -> world space
    float iso;  // as the volume's image returns it
    float side; // as isosurface.comp's
    float light_scale;
    float unused;
};

layout(set = 0, binding = 8) uniform sampler3D occupancy;

layout(constant_id = 3) const uint SKIP = 1; // 1: leap over empty blocks
layout(constant_id = 0) const uint CLIPS = 0;   // clip planes
layout(constant_id = 1) const uint SURFACE = 0; // 1: an isosurface
layout(constant_id = 2) const uint GREY = 0;    // 1: the irradiance volume has one channel of light

layout(push_constant) uniform Params {
    vec3 origin;
    float step_length;
    vec3 corner;
    float map_scale;
    vec3 du;
    float map_bias;
    vec3 dv;
    uint width;
    vec3 metric_diagonal;
    uint first_row;
    vec3 metric_cross;
    uint rows;
    uint first_step;
    uint step_count;
    uint bounds_x; // as raymarch.comp's
    uint bounds_y;
    uint bounds_z;
    float per_unit; // see view.glsl
};
#include "medium.glsl"
#include "clip.glsl"
#include "view.glsl"
#include "occupancy.glsl"
#include "hit.glsl"
#include "around.glsl"

const float DARK = 1e-3;  // transmittance at which a ray ends
const float FIRST = 0.05; // opacity of the first hit
const float FLAT = 1e-5;  // share of extinction by which rounding may change it
const uint RUN = 8u;      // steps between two looks at the blocks

float sigma_at(vec3 n) {
    return extinction(textureLod(volume, n, 0.0).r);
}

// Where extinction falls fastest, world, length 1; zero where it changes by no more than rounding.
vec3 medium_normal(vec3 n, vec3 dims) {
    vec3 h = 1.0 / dims;
    vec3 after = vec3(sigma_at(n + vec3(h.x, 0.0, 0.0)), sigma_at(n + vec3(0.0, h.y, 0.0)), sigma_at(n + vec3(0.0, 0.0, h.z)));
    vec3 before = vec3(sigma_at(n - vec3(h.x, 0.0, 0.0)), sigma_at(n - vec3(0.0, h.y, 0.0)), sigma_at(n - vec3(0.0, 0.0, h.z)));
    vec3 g = after - before;
    if (dot(abs(g), vec3(1.0)) <= FLAT * dot(after + before, vec3(1.0))) return vec3(0.0);
    vec3 w = -(mat3(voxel_to_world_normal) * near_one(g));
    float l = length(w);
    return l > 0.0 ? w / l : vec3(0.0);
}

// Mean visibility at a place on a surface: trilinear among the cells around it as isosurface.comp takes them (around.glsl).
float surface_visibility(vec3 n, vec3 normal, vec3 dims) {
    // The irradiance is a window on the field, dark around it.
    vec3 size = vec3(textureSize(irradiance, 0));
    vec3 field_dims = round(window[0].xyz * size);
    ivec3 first = ivec3(round(-window[1].xyz * size));
    vec3 q = n * field_dims - 0.5;
    vec2 sum = vec2(0.0);
    for (int attempt = 0; attempt < 2; attempt++) {
        sum = vec2(0.0);
        for (int i = 0; i < 8; i++) {
            ivec3 c;
            float w;
            uint rule = cell_around(q, i, field_dims, attempt == 1, c, w);
            if (rule == SILENT) continue;
            float seen = 0.5;
            if (rule == SAYS) {
                ivec3 p = clamp(c - first, ivec3(0), ivec3(size) - 1);
                vec4 texel = texelFetch(irradiance, p, 0);
                seen = p != c - first ? 0.0 : GREY == 1 ? texel.g : texel.a;
            }
            sum += w * vec2(seen, 1.0);
        }
        if (sum.y > 1e-4) break;
        q += one_cell_out(normal, dims, field_dims);
    }
    return sum.y > 0.0 ? sum.x / sum.y : 0.0;
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= width || pixel.y >= rows) return;
    uint slot = 4u * (pixel.y * width + pixel.x);
    // Sums of w normal and w distance; w albedo and the first hit (-1: none yet); w irradiance and w visibility; optical
    // depth and w.
    vec4 a = vec4(0.0);
    vec4 b = vec4(0.0, 0.0, 0.0, -1.0);
    vec4 c = vec4(0.0);
    vec4 e = vec4(0.0);
    if (first_step > 0u) {
        a = state[slot];
        b = state[slot + 1u];
        c = state[slot + 2u];
        e = state[slot + 3u];
    }
    vec3 dims = vec3(textureSize(volume, 0));
    vec3 d = pixel_direction(pixel + uvec2(0u, first_row));
    vec2 span = clip_span(origin, d, box_span(origin, d, dims));
    float begin = max(span.x, 0.0);
    float total = span.y - begin;
    if (SURFACE == 1) {
        float t = hits[pixel.y * width + pixel.x];
        if (t >= 0.0) {
            Line line = line_of(origin, d, begin, span.y, dims);
            // isosurface.comp left `begin` itself where the box or a plane cuts the surface open: compiled apart, it may be rounded
            // another way there, by a few units in the last place.
            float inside = t <= begin * (1.0 + 1e-6) ? 0.0 : t - begin;
            vec3 normal = normal_at(line, inside, inside == 0.0);
            a = vec4(normal, t);
            b.a = t;
            c.a = surface_visibility(line.p0 + line.dn * inside, normal, dims);
            e.y = 1.0;
        }
    } else {
        uint steps = total > 0.0 ? uint(ceil(total / step_length)) : 0u;
        uint end = min(steps, first_step + step_count);
        vec3 p0 = (origin + d * begin) / dims;
        vec3 dn = d / dims;
        float transmittance = exp(-e.x);
        vec3 q0 = origin + d * begin;
        vec2 inside = matter_span(origin, d) - begin;
        uint i = max(first_step, uint(clamp(inside.x / step_length - 2.0, 0.0, float(steps))));
        end = min(end, uint(clamp(inside.y / step_length + 2.0, 0.0, float(steps))));
        while (i < end && transmittance > DARK) {
            if (SKIP == 1) {
                while (i < end) {
                    float t = float(i) * step_length;
                    float steps = leap(q0 + d * (t + 0.5 * min(step_length, total - t)), d);
                    if (steps == 0.0) break;
                    i += uint(steps);
                }
            }
            uint stop = min(i + RUN, end);
            for (; i < stop && transmittance > DARK; i++) {
                float t = float(i) * step_length;
                float ds = min(step_length, total - t);
                vec3 p = p0 + dn * (t + 0.5 * ds);
                float u = table_coordinate(textureLod(volume, p, 0.0).r);
                uint k = min(uint(u), TABLE_SIZE - 2u);
                float f = u - float(k);
                float depth = mix(sigma[k], sigma[k + 1u], f) * ds;
                if (depth > 0.0) {
                    float w = transmittance * opacity_of(depth);
                    float before = e.x;
                    vec4 light = textureLod(irradiance, p * window[0].xyz + window[1].xyz, 0.0);
                    a += w * vec4(medium_normal(p, dims), begin + t + 0.5 * ds);
                    b.rgb += w * mix(albedo[k].rgb, albedo[k + 1u].rgb, f);
                    c += w * vec4(max(GREY == 1 ? light.rrr : light.rgb, vec3(0.0)) * light_scale, GREY == 1 ? light.g : light.a);
                    e.x += depth;
                    e.y += w;
                    transmittance = exp(-e.x);
                    float needed = -log(1.0 - FIRST);
                    if (b.a < 0.0 && e.x >= needed) b.a = begin + t + ds * (needed - before) / depth;
                }
            }
        }
    }
    state[slot] = a;
    state[slot + 1u] = b;
    state[slot + 2u] = c;
    state[slot + 3u] = e;
}
