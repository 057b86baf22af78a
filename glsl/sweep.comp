// sweep: short characteristics. For the directions of one group (same major axis and sign) slices are swept from the side
// that the rays leave by: T(x) = exp(-tau(x -> slice NEAR further on)) * bilinear(T of that slice), tau marched densely
// through the volume: the nearer matter is exact, and each interpolation of T, which diffuses, spans NEAR slices.
// One invocation is four neighbouring cells of a row, a component of a vec4 each; they share loads, and keep their 4 x 16
// sums in registers over a batch of directions. CPU devices run every branch that one lane takes: tiles without matter
// near have a pipeline of their own, without taps. On a separate card a slice is too few invocations to fill it, and what a
// batch takes is waiting: there LANES invocations share the batch's directions and add up their sums at its end, and the taps
// of the four cells are in flight together.
// Counted per cell and direction: NEAR * (cell edge .. sqrt(3) cell edges)/step taps with 2 table loads each in tiles where
// matter is near, none elsewhere; 2.5 loads of T, 2 of the direction, 1 store, 16 multiply-adds, 40 flops of harmonics.
// Per cell, group of directions and pass: 8 image loads and stores.
// readwrite: transmittance, sums0, sums1, sums2, sums3
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"
#include "sh.glsl"

layout(local_size_x = 32, local_size_y_id = 6) in;

layout(constant_id = 0) const uint BANDS = 4;
layout(constant_id = 1) const uint NEAR = 1; // slices marched densely
layout(constant_id = 2) const uint RING = 2; // slices that the ring holds
layout(constant_id = 3) const uint AXIS = 2; // major axis of the group: slices stand across it
layout(constant_id = 4) const bool DENSE = true; // false: no matter within NEAR slices and nothing to sum, T is only carried
layout(constant_id = 5) const uint CLIPS = 0; // clip planes
layout(constant_id = 6) const uint LANES = 1; // invocations that share the directions of a batch

struct Direction {
    vec4 voxel; // xyz: direction in voxel space, of world length 1
    vec4 world; // xyz: the same in the world, of length 1
};

layout(set = 0, binding = 0, std430) readonly buffer Directions { Direction directions[]; };
layout(set = 0, binding = 1) uniform sampler3D volume;
layout(set = 0, binding = 2, std430) readonly buffer Sigma { float sigma[]; };
// Ring of RING slices x directions of the batch x cells of a slice.
layout(set = 0, binding = 3, std430) buffer Transmittance { float transmittance[]; };
layout(set = 0, binding = 4) uniform usampler3D cell_map; // clear cells around (4 bits), slot in the sums + 1 (0: not wanted)
layout(set = 0, binding = 5, std430) readonly buffer Tiles { uint tiles[]; };
layout(set = 0, binding = 6, rgba32f) uniform image3D sums0;
layout(set = 0, binding = 7, rgba32f) uniform image3D sums1;
layout(set = 0, binding = 8, rgba32f) uniform image3D sums2;
layout(set = 0, binding = 9, rgba32f) uniform image3D sums3;

layout(push_constant) uniform Params {
    vec3 cell_size;      // voxels
    float step_length;   // world units, at most
    vec3 volume_dims;    // voxels
    float map_scale;
    uvec3 field_dims;
    float map_bias;
    uint slice;
    uint ring_slot;      // slot that this slice writes; the slice swept m before stands m slots behind
    uint first_direction;
    uint direction_count;
    uint begin;          // 1: the sums are fresh
    uint first_tile;
};

#include "medium.glsl"
#include "clip.glsl"
#include "slots.glsl"

// Optical depth along the ray up to distance b, by the midpoint rule with n even steps. n is the same for all invocations:
// lavapipe 22.3.6 takes what a loop leaves behind from its last run, also for invocations that left it earlier; and it runs
// a loop's body once more after a question at the top is denied, so all loops here ask at the end.
float optical_depth(vec3 x, vec3 d, float b, float n, vec3 scale) {
    vec2 kept = clip_span(x, d, vec2(0.0, b));
    float s = max(kept.y - kept.x, 0.0) / n;
    float i = 0.5;
    float sum = 0.0;
    do {
        sum += extinction(textureLod(volume, (x + d * (kept.x + i * s)) * scale, 0.0).r);
        i += 1.0;
    } while (i < n);
    return sum * s;
}

// The same of four cells, `next` apart, side by side.
vec4 optical_depths(vec3 x, vec3 next, vec3 d, vec4 b, float n, vec3 scale) {
    vec2 k0 = clip_span(x, d, vec2(0.0, b.x));
    vec2 k1 = clip_span(x + next, d, vec2(0.0, b.y));
    vec2 k2 = clip_span(x + 2.0 * next, d, vec2(0.0, b.z));
    vec2 k3 = clip_span(x + 3.0 * next, d, vec2(0.0, b.w));
    vec4 from = vec4(k0.x, k1.x, k2.x, k3.x);
    vec4 s = max(vec4(k0.y, k1.y, k2.y, k3.y) - from, vec4(0.0)) / n;
    float i = 0.5;
    vec4 sum = vec4(0.0);
    do {
        vec4 t = from + i * s;
        sum.x += extinction(textureLod(volume, (x + d * t.x) * scale, 0.0).r);
        sum.y += extinction(textureLod(volume, (x + next + d * t.y) * scale, 0.0).r);
        sum.z += extinction(textureLod(volume, (x + 2.0 * next + d * t.z) * scale, 0.0).r);
        sum.w += extinction(textureLod(volume, (x + 3.0 * next + d * t.w) * scale, 0.0).r);
        i += 1.0;
    } while (i < n);
    return sum * s;
}

// Cells 0..3 of this invocation along the row.
const vec4 FOUR = vec4(0.0, 1.0, 2.0, 3.0);

// What the lanes have of four coefficients: cell after cell, lane after lane.
shared vec4 lanes[4 * uint(MOST_LANES) * 32];

// Four coefficients of cell `lane`, of all lanes together; the lanes beyond four have none.
vec4 together(vec4 a, vec4 b, vec4 c, vec4 d) {
    uint l = gl_LocalInvocationID.x;
    uint lane = gl_LocalInvocationID.y;
    barrier(); // those before have been read
    for (uint j = 0u; j < 4u; j++) lanes[(j * LANES + lane) * 32u + l] = vec4(a[j], b[j], c[j], d[j]);
    barrier();
    vec4 sum = vec4(0.0);
    if (lane < 4u) for (uint k = 0u; k < LANES; k++) sum += lanes[(lane * LANES + k) * 32u + l];
    return sum;
}

// Values of T in columns base .. base + 4 of a row of the ring, the ends repeated.
#define LOAD(i) transmittance[start + clamp(base + i, 0, last)]

void main() {
    // Axes that span the slice. All indices below are constants once AXIS is.
    const uint row = AXIS == 0u ? 1u : 0u;
    const uint column = AXIS == 2u ? 1u : 2u;
    uint width = field_dims[row];
    uint height = field_dims[column];
    uint area = width * height;
    // A workgroup is a tile, eight of its invocations a quarter of it.
    const uint tile_row = uint(TILE_ROW);
    uint across = (width + tile_row - 1u) / tile_row;
    uint tile = tiles[first_tile + gl_WorkGroupID.x];
    uint l = gl_LocalInvocationID.x;
    uvec2 at = uvec2(tile % across * tile_row, tile / across * uint(TILE_COLUMN));
    at += uvec2(8u * (l >> 3 & 1u) + 4u * (l & 1u), 4u * (l >> 4) + (l >> 1 & 3u));
    bool outside = at.x >= width || at.y >= height;
    // Lanes wait for each other.
    if (LANES == 1u && outside) return;

    // Of cells outside nothing is kept; the nearest inside is looked at.
    at = min(at, uvec2(width, height) - 1u);
    vec3 scale = 1.0 / volume_dims;
    uvec3 first;
    first[AXIS] = slice;
    first[row] = at.x;
    first[column] = at.y;
    vec3 x = (vec3(first) + 0.5) * cell_size; // centre of the first of the four cells
    vec3 next = vec3(0.0);                    // from each to the next
    next[row] = cell_size[row];
    ivec3 p0 = ivec3(first);
    ivec3 p1 = p0;
    ivec3 p2 = p0;
    ivec3 p3 = p0;
    int last = int(width) - 1;
    p1[row] = min(p0[row] + 1, last);
    p2[row] = min(p0[row] + 2, last);
    p3[row] = min(p0[row] + 3, last);
    uvec4 info = uvec4(texelFetch(cell_map, p0, 0).x, texelFetch(cell_map, p1, 0).x, texelFetch(cell_map, p2, 0).x, texelFetch(cell_map, p3, 0).x);
    // What stands beyond the row is neither marched nor stored.
    bvec4 stored = lessThan(uvec4(FOUR) + at.x, uvec4(width));
    bvec4 dense = lessThan(mix(uvec4(15u), info & 15u, stored), uvec4(NEAR)); // matter may be near
    vec4 row_place = FOUR + float(at.x);
    float last_row = float(height) - 1.0;

    vec4 s[16];
    for (int i = 0; i < 16; i++) s[i] = vec4(0.0);
    uint k = LANES == 1u ? 0u : gl_LocalInvocationID.y;
    if (LANES == 1u || !outside && k < direction_count) do {
        vec3 d = directions[first_direction + k].voxel.xyz;
        float ds = cell_size[AXIS] / abs(d[AXIS]); // world distance from slice to slice
        vec2 shift = vec2(d[row] / cell_size[row], d[column] / cell_size[column]) * ds;
        vec3 wall = mix(vec3(0.0), volume_dims, greaterThan(d, vec3(0.0))) - x;
        float room = min(wall[AXIS] / d[AXIS], wall[column] / d[column]);
        vec4 end = min(vec4(room), (wall[row] - FOUR * cell_size[row]) / d[row]);

        vec4 depth = vec4(0.0);
        if (DENSE) {
            float taps = max(ceil(float(NEAR) * ds / step_length - 1e-3), 1.0);
            vec4 b = min(vec4(float(NEAR) * ds), end);
            // Written out: an array indexed in a loop would live in memory.
            if (LANES > 1u) {
                if (any(dense)) depth = mix(vec4(0.0), optical_depths(x, next, d, b, taps, scale), dense);
            } else {
                if (dense.x) depth.x = optical_depth(x, d, b.x, taps, scale);
                if (dense.y) depth.y = optical_depth(x + next, d, b.y, taps, scale);
                if (dense.z) depth.z = optical_depth(x + 2.0 * next, d, b.z, taps, scale);
                if (dense.w) depth.w = optical_depth(x + 3.0 * next, d, b.w, taps, scale);
            }
        }
        // Four cells in a row interpolate among five values in each of two rows.
        vec2 moved = float(NEAR) * shift;
        ivec2 near_cell = ivec2(at) + ivec2(floor(moved));
        vec2 f = fract(moved);
        uint slot = ring_slot + (ring_slot < NEAR ? RING : 0u) - NEAR;
        int plane = int((slot * direction_count + k) * area);
        int base = near_cell.x;
        int start = plane + clamp(near_cell.y, 0, int(height) - 1) * int(width);
        vec4 ul = vec4(LOAD(0), LOAD(1), LOAD(2), LOAD(3));
        vec4 ur = vec4(ul.yzw, LOAD(4));
        start = plane + clamp(near_cell.y + 1, 0, int(height) - 1) * int(width);
        vec4 ll = vec4(LOAD(0), LOAD(1), LOAD(2), LOAD(3));
        vec4 lr = vec4(ll.yzw, LOAD(4));
        vec4 swept = mix(mix(ul, ur, f.x), mix(ll, lr, f.x), f.y);
        // Beyond the last cell centre T rises to 1 at the wall, half a cell off.
        vec4 place_x = row_place + moved.x;
        float place_y = float(at.y) + moved.y;
        vec4 out_x = max(max(-place_x, place_x - float(last)), vec4(0.0));
        float out_y = max(max(-place_y, place_y - last_row), 0.0);
        vec4 inside = clamp(1.0 - 2.0 * out_x, 0.0, 1.0) * clamp(1.0 - 2.0 * out_y, 0.0, 1.0);
        bvec4 left = greaterThanEqual(vec4(float(NEAR) * ds), end); // the ray has left the volume
        vec4 v = exp(-depth) * mix(mix(vec4(1.0), swept, inside), vec4(1.0), left);
        uint own = (ring_slot * direction_count + k) * area + at.y * width + at.x;
        transmittance[own] = v.x;
        if (stored.y) transmittance[own + 1u] = v.y;
        if (stored.z) transmittance[own + 2u] = v.z;
        if (stored.w) transmittance[own + 3u] = v.w;
        if (DENSE) {
            float y[16];
            sh_basis(directions[first_direction + k].world.xyz, y);
            s[0] += v * y[0];
            if (BANDS > 1) for (int i = 1; i < 4; i++) s[i] += v * y[i];
            if (BANDS > 2) for (int i = 4; i < 9; i++) s[i] += v * y[i];
            if (BANDS > 3) for (int i = 9; i < 16; i++) s[i] += v * y[i];
        }
        k += LANES;
    } while (k < direction_count);

    if (!DENSE) return;
    if (LANES > 1u) {
        uint j = gl_LocalInvocationID.y;
        uint slot = j < 4u && !outside && stored[j & 3u] ? info[j & 3u] >> 4 : 0u;
        ivec3 p = slot_place(max(slot, 1u) - 1u);
        bool adds = slot > 0u && begin == 0u;
        vec4 a = together(s[0], s[1], s[2], s[3]);
        if (adds) a += imageLoad(sums0, p);
        if (slot > 0u) imageStore(sums0, p, a);
        if (BANDS > 2) {
            a = together(s[4], s[5], s[6], s[7]);
            if (adds) a += imageLoad(sums1, p);
            if (slot > 0u) imageStore(sums1, p, a);
            a = together(s[8], s[9], s[10], s[11]);
            if (adds) a += imageLoad(sums2, p);
            if (slot > 0u) imageStore(sums2, p, a);
        }
        if (BANDS > 3) {
            a = together(s[12], s[13], s[14], s[15]);
            if (adds) a += imageLoad(sums3, p);
            if (slot > 0u) imageStore(sums3, p, a);
        }
        return;
    }
    for (uint j = 0u; j < 4u; j++) {
        uint slot = info[j] >> 4;
        if (slot == 0u || !stored[j]) continue;
        ivec3 p = slot_place(slot - 1u);
        vec4 a = vec4(s[0][j], s[1][j], s[2][j], s[3][j]);
        imageStore(sums0, p, begin == 0u ? a + imageLoad(sums0, p) : a);
        if (BANDS > 2) {
            a = vec4(s[4][j], s[5][j], s[6][j], s[7][j]);
            imageStore(sums1, p, begin == 0u ? a + imageLoad(sums1, p) : a);
            a = vec4(s[8][j], s[9][j], s[10][j], s[11][j]);
            imageStore(sums2, p, begin == 0u ? a + imageLoad(sums2, p) : a);
        }
        if (BANDS > 3) {
            a = vec4(s[12][j], s[13][j], s[14][j], s[15][j]);
            imageStore(sums3, p, begin == 0u ? a + imageLoad(sums3, p) : a);
        }
    }
}
