// trace: the reference renderer, Monte Carlo single scattering in the medium itself, without harmonics or a field.
// Per sample: a scattering point from the viewing ray, by ratio tracking in cells of known majorant (every tentative
// collision i has weight T_i sigma_t/majorant; one is kept by its weight); a direction of the sky by its brightness; the
// transmittance to the sky by ratio tracking. No step, no cut: the mean is the integral itself. A surface is found as
// isosurface.comp finds it, and its shadow rays look for D >= iso every shadow_step, from a random first place on.
// Samples come in blocks of STRATA^2 whose sky directions are stratified; the mean and the squares of block means are
// kept (Welford), so that the standard error counts what stratification gains.
// Counted per sample: a tap and 3 loads per tentative collision (on average the integral of the majorant along both
// rays, less what is dark, and TENTATIVE at most besides), a texel per cell crossed between the
// first and the last cell of matter (viewing ray) or up to the box's end (to the sky); log2(width x height) + 4 loads for the sky.
// readwrite: state
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "ray.glsl"
#include "random.glsl"

layout(local_size_x = 8, local_size_y = 8) in;

layout(constant_id = 0) const uint CELL = 8;
layout(constant_id = 1) const uint MATTER = 0; // 0: the medium; 1: isotropic surface; 2: Lambert surface
layout(constant_id = 2) const uint CLIPS = 0; // clip planes
#include "cells.glsl"

layout(set = 0, binding = 0) uniform sampler3D volume;
layout(set = 0, binding = 1, std430) readonly buffer Sigma { float sigma[]; };
layout(set = 0, binding = 2, std430) readonly buffer Albedo { vec4 albedo[]; };
layout(set = 0, binding = 3) uniform sampler3D majorants;
layout(set = 0, binding = 4, std430) readonly buffer Cumulative { float cumulative[]; }; // of the rows, then of each row's pixels
layout(set = 0, binding = 5, std430) readonly buffer Sky { vec4 sky[]; }; // radiance / (4 pi density)
layout(set = 0, binding = 6, std430) readonly buffer Setting {
    mat4 sky_to_voxel; // a direction of the unturned sky -> voxel space, world length 1
    mat4 voxel_to_world_normal;
    mat4 world_to_sky;
    vec4 surface_albedo;
    uvec4 sky_size;    // columns, rows
    float iso;         // as the volume's image returns it
    float side;        // 1: values rise into the surface; -1: the stored samples are negated values
    float shadow_step; // world units
    float scale;       // of the light
};
layout(set = 0, binding = 7, std430) buffer State { vec4 state[]; }; // block so far, mean of blocks, squares of blocks

layout(push_constant) uniform Params {
    vec3 origin;
    float step_length; // of the search for a surface, world units
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
    uint band_row; // the first row of this state
    uint first_sample;
    uint sample_count;
    uint most_events; // iterations that this invocation may make
    uint seed;
    float per_unit; // see view.glsl
};
#include "medium.glsl"
#include "clip.glsl"
#include "view.glsl"
#include "hit.glsl"

const int REFINEMENTS = 8; // bisections besides, for the start of shadow rays
const uint STRATA = 4;
const uint BATCH = STRATA * STRATA;
const float TENTATIVE = 8.0; // collisions that a viewing ray through matter meets at least, on average: less noise in haze
const float ROULETTE = 0.1; // transmittance below which a ray goes on by chance

uint events = 0;
uvec3 key; // pixel, sample, count of draws

// The first entry above u among `count` from `first` on; u becomes its place within that entry.
uint inverted(uint first, uint count, inout float u) {
    uint lo = 0u;
    uint hi = count - 1u;
    while (lo < hi) {
        uint middle = (lo + hi) / 2u;
        if (cumulative[first + middle] > u) hi = middle;
        else lo = middle + 1u;
    }
    float below = lo > 0u ? cumulative[first + lo - 1u] : 0.0;
    u = clamp((u - below) / (cumulative[first + lo] - below), 0.0, 1.0);
    return lo;
}

// A direction of the unturned sky by its brightness, even within a pixel's solid angle, and radiance/(4 pi density).
vec3 sample_sky(vec2 u, out vec3 weight) {
    uint row = inverted(0u, sky_size.y, u.x);
    uint column = inverted(sky_size.y + row * sky_size.x, sky_size.x, u.y);
    weight = sky[row * sky_size.x + column].rgb;
    float band = 3.141592653589793 / float(sky_size.y);
    float z = mix(cos(band * float(row)), cos(band * float(row + 1u)), u.x);
    float azimuth = 6.283185307179586 * (float(column) + u.y) / float(sky_size.x);
    float r = sqrt(max(1.0 - z * z, 0.0));
    return vec3(r * sin(azimuth), r * cos(azimuth), z);
}

// Goes on by chance where little is left; unbiased.
float roulette(float t) {
    if (t >= ROULETTE) return t;
    return draw(key).x * ROULETTE < t ? ROULETTE : 0.0;
}

// The stretch of a ray from its first to its last cell with matter; x > y where there is none.
vec2 matter_span(vec3 p, vec3 d, vec2 span) {
    ivec3 cells = textureSize(majorants, 0);
    Walk w = walk_from(p, d, span.x, cells);
    float t = span.x;
    vec2 inner = vec2(span.y, span.x);
    for (; events < most_events; events++) {
        float boundary = min(walk_boundary(w), span.y);
        if (texelFetch(majorants, w.cell, 0).r > 0.0) inner = vec2(min(inner.x, t), boundary);
        t = boundary;
        if (boundary >= span.y || !walk_on(w, cells)) break;
    }
    return inner;
}

// The integral of T sigma_t along the viewing ray, and a place drawn in proportion to it; transmittance in `through`.
float scatter(vec3 p, vec3 d, vec2 span, float least, out float place, out float through) {
    ivec3 cells = textureSize(majorants, 0);
    vec3 scale3 = 1.0 / vec3(textureSize(volume, 0));
    Walk w = walk_from(p, d, span.x, cells);
    float t = span.x;
    float depth = -log(1.0 - draw(key).x); // to the next tentative collision
    float sum = 0.0;
    place = 0.0;
    through = 1.0;
    for (; events < most_events; events++) {
        float bound = texelFetch(majorants, w.cell, 0).r;
        if (bound > 0.0) bound = max(bound, least);
        float boundary = min(walk_boundary(w), span.y);
        float ahead = bound * (boundary - t);
        if (ahead > depth) {
            t += depth / bound;
            vec2 u = draw(key);
            depth = -log(1.0 - u.x);
            float share = min(extinction(textureLod(volume, (p + d * t) * scale3, 0.0).r) / bound, 1.0);
            float weight = through * share;
            sum += weight;
            if (u.y * sum < weight) place = t;
            through = roulette(through - weight);
            if (through <= 0.0) break;
        } else {
            depth -= max(ahead, 0.0);
            t = boundary;
            if (boundary >= span.y || !walk_on(w, cells)) break;
        }
    }
    return sum;
}

// Transmittance from p along d to the end of the volume, unbiased.
float transmittance(vec3 p, vec3 d, vec3 dims) {
    ivec3 cells = textureSize(majorants, 0);
    vec3 scale3 = 1.0 / dims;
    vec2 span = clip_span(p, d, vec2(0.0, box_span(p, d, dims).y));
    if (CLIPS > 0u && !(span.y > span.x)) return 1.0;
    float end = span.y;
    Walk w = walk_from(p, d, span.x, cells);
    float t = span.x;
    float depth = -log(1.0 - draw(key).x);
    float through = 1.0;
    for (; events < most_events; events++) {
        float bound = texelFetch(majorants, w.cell, 0).r;
        float boundary = min(walk_boundary(w), end);
        float ahead = bound * (boundary - t);
        if (ahead > depth) {
            t += depth / bound;
            depth = -log(1.0 - draw(key).x);
            float share = min(extinction(textureLod(volume, (p + d * t) * scale3, 0.0).r) / bound, 1.0);
            through = roulette(through * (1.0 - share));
            if (through <= 0.0) break;
        } else {
            depth -= max(ahead, 0.0);
            t = boundary;
            if (boundary >= end || !walk_on(w, cells)) break;
        }
    }
    return through;
}

// 1 where the ray meets no D >= iso; cells without any are crossed at once.
float unshadowed(vec3 p, vec3 d, vec3 dims) {
    ivec3 cells = textureSize(majorants, 0);
    vec3 scale3 = 1.0 / dims;
    vec2 span = clip_span(p, d, box_span(p, d, dims));
    if (!(span.y > max(span.x, 0.0))) return 1.0;
    float first = max(span.x, 0.0) + draw(key).x * shadow_step;
    Walk w = walk_from(p, d, max(span.x, 0.0), cells);
    float i = 0.0; // places looked at: first + i shadow_step
    for (; events < most_events; events++) {
        float t = first + i * shadow_step;
        float boundary = min(walk_boundary(w), span.y);
        if (t >= boundary || texelFetch(majorants, w.cell, 0).r <= 0.0) {
            i = max(i, ceil((boundary - first) / shadow_step));
            if (boundary >= span.y || !walk_on(w, cells)) break;
        } else {
            if (above((p + d * t) * scale3) >= 0.0) return 0.0;
            i += 1.0;
        }
    }
    return 1.0;
}

void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (pixel.x >= width || pixel.y >= rows) return;
    pixel.y += first_row;
    uint slot = 3u * ((pixel.y - band_row) * width + pixel.x);
    vec4 block = vec4(0.0);
    vec4 mean = vec4(0.0);
    vec4 squares = vec4(0.0);
    if (first_sample > 0u) {
        block = state[slot];
        mean = state[slot + 1u];
        squares = state[slot + 2u];
    }
    vec3 dims = vec3(textureSize(volume, 0));
    vec3 d = pixel_direction(pixel);
    vec2 span = clip_span(origin, d, box_span(origin, d, dims));
    span.x = max(span.x, 0.0);

    bool found = span.y > span.x;
    float least = TENTATIVE / (span.y - span.x);
    if (MATTER == 0 && found) {
        span = matter_span(origin, d, span); // once for all samples
        found = span.y > span.x;
    }
    vec3 start = vec3(0.0);
    vec3 normal = vec3(0.0);
    if (MATTER > 0 && found) {
        Line line = line_of(origin, d, span.x, span.y, dims);
        float lo = 0.0;
        float hi = above(line.p0) >= 0.0 ? 0.0 : -1.0;
        bool cut_open = hi == 0.0;
        if (!cut_open) {
            search(line, 1u, uint(ceil(line.total / step_length)) + 1u, lo, hi);
            if (hi >= 0.0) bisect(line, BISECTIONS, lo, hi);
        }
        found = hi >= 0.0;
        if (found) {
            normal = mat3(world_to_sky) * normal_at(line, 0.5 * (lo + hi), cut_open);
            if (!cut_open) bisect(line, REFINEMENTS, lo, hi);
            start = origin + d * (span.x + lo); // the last place before it that is surely vacuum
        }
    }
    key.x = pixel.y * width + pixel.x;
    for (uint s = first_sample; found && s < first_sample + sample_count; s++) {
        key.y = s;
        key.z = seed * 0x9E3779B9u; // counts of neighbouring seeds lie far apart: none draws what another draws
        vec2 jitter = draw(key);
        uint k = s % BATCH;
        vec2 u = min((vec2(k % STRATA, k / STRATA) + jitter) / float(STRATA), vec2(0.99999994));
        vec3 weight;
        vec3 toward = sample_sky(u, weight);
        vec3 w = safe_direction(mat3(sky_to_voxel) * toward);
        if (MATTER == 0) {
            float place;
            float through;
            float sum = scatter(origin, d, span, least, place, through);
            if (sum > 0.0) {
                vec3 p = origin + d * place;
                float c = table_coordinate(textureLod(volume, p / dims, 0.0).r);
                uint i = min(uint(c), TABLE_SIZE - 2u);
                vec3 a = mix(albedo[i].rgb, albedo[i + 1u].rgb, c - float(i));
                block.rgb += sum * transmittance(p, w, dims) * a * weight * scale;
            }
            block.a += through > 0.5 ? sum : 1.0 - through; // the same number; the sum keeps thin matter exact
        } else {
            float lobe = MATTER == 2 ? 4.0 * max(dot(normal, toward), 0.0) : 1.0;
            if (lobe > 0.0) block.rgb += lobe * unshadowed(start, w, dims) * surface_albedo.rgb * weight * scale;
            block.a += 1.0;
        }
        if (k == BATCH - 1u) {
            vec4 m = block / float(BATCH);
            vec4 change = m - mean;
            mean += change / float(s / BATCH + 1u);
            squares.rgb += change.rgb * (m.rgb - mean.rgb);
            block = vec4(0.0);
        }
    }
    // Told to the host: this picture is cut short.
    if (events >= most_events) squares.a = 1.0;
    state[slot] = block;
    state[slot + 1u] = mean;
    state[slot + 2u] = squares;
}
