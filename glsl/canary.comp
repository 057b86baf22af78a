#version 460
// Does a long loop run to its end? One invocation counts `trips` iterations and says how many it made.
// Mesa 22.3's llvmpipe leaves loops after 65,535 iterations, silently.
layout(local_size_x = 1) in;

layout(push_constant) uniform Params {
    uint trips;
};

layout(set = 0, binding = 0, std430) writeonly buffer Counted {
    uint counted[];
};

void main() {
    // The generator keeps the compiler from replacing the loop by its result.
    uint state = trips;
    uint count = 0u;
    for (uint i = 0u; i < trips; ++i) {
        state = state * 1664525u + 1013904223u;
        count += (state | 1u) & 1u;
    }
    counted[0] = count;
    counted[1] = state;
}
