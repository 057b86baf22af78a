// occupancy: smallest and largest sample of each block -> 0 where a value in between scatters or absorbs, else MAX_LEAP,
// which occupancy_distance.comp brings down to the true distance. O(1) per block through the running count of the table's
// entries with sigma_t > 0. Counted per block: one texel, two loads, one byte written.
#version 460
#extension GL_GOOGLE_include_directive : require
#include "constants.glsl"

layout(local_size_x = 4, local_size_y = 4, local_size_z = 4) in;

layout(set = 0, binding = 0) uniform sampler3D bounds;                             // as the volume's image returns samples
layout(set = 0, binding = 1, std430) readonly buffer Filled { uint filled[]; };    // entries with matter before entry i
layout(set = 0, binding = 2) uniform writeonly image3D distances;

layout(push_constant) uniform Params {
    float map_scale;
    float map_bias;
    uint first_slice;
    uint surface; // 1: the isosurface itself is found by comparing samples, not in the table
};

const float FAR = 1e9; // beyond any table, and finite: stray samples must not make NaN

// Entries that rounding may carry a coordinate off: that of the filter, multiplied where a narrow table lies over wide data.
float margin(float d) {
    return min(4.8e-7 * (abs(d * map_scale) + abs(map_bias)), FAR);
}

void main() {
    ivec3 p = ivec3(gl_GlobalInvocationID) + ivec3(0, 0, first_slice);
    if (any(greaterThanEqual(p, textureSize(bounds, 0)))) return;
    vec2 range = texelFetch(bounds, p, 0).rg;
    precise vec2 u = range * map_scale + map_bias; // as table_coordinate
    u = clamp(u, -FAR, FAR);
    // A constant block, such as a background at the value where the table begins, is filtered without rounding.
    vec2 m = range.x == range.y && surface == 0u ? vec2(0.0) : vec2(margin(range.x), margin(range.y));
    // Stored samples may be negated values: the map may fall.
    float lo = min(u.x - m.x, u.y - m.y);
    float hi = max(u.x + m.x, u.y + m.y);
    uint first = uint(clamp(floor(lo), 0.0, float(TABLE_SIZE - 1)));
    uint last = uint(clamp(ceil(hi), 0.0, float(TABLE_SIZE - 1)));
    bool matter = filled[last + 1u] > filled[first];
    imageStore(distances, p, vec4(matter ? 0.0 : float(MAX_LEAP) / 255.0));
}
