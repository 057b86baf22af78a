// The estimators' main: sums += V(x, w_i) Y(w_i) over this dispatch's run of directions.
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= cell_count) return;
    uint cell = cells[i];
    vec3 x = cell_centre(cell, field_dims, cell_size);
    uint first = (patterns > 1u ? pcg_hash(cell) % patterns : 0u) * pattern_size + first_direction;
    bool begin = first_direction == 0u;
    vec4 s0 = begin ? vec4(0.0) : load_sums(i, 0u, capacity);
    vec4 s1 = begin || BANDS < 3 ? vec4(0.0) : load_sums(i, 1u, capacity);
    vec4 s2 = begin || BANDS < 3 ? vec4(0.0) : load_sums(i, 2u, capacity);
    vec4 s3 = begin || BANDS < 4 ? vec4(0.0) : load_sums(i, 3u, capacity);
    for (uint k = first; k < first + direction_count; k++) {
        float v = visibility(x, directions[k].voxel.xyz);
        s0 += v * directions[k].basis[0];
        if (BANDS > 2) s1 += v * directions[k].basis[1];
        if (BANDS > 2) s2 += v * directions[k].basis[2];
        if (BANDS > 3) s3 += v * directions[k].basis[3];
    }
    store_sums(i, 0u, capacity, s0);
    if (BANDS > 2) store_sums(i, 1u, capacity, s1);
    if (BANDS > 2) store_sums(i, 2u, capacity, s2);
    if (BANDS > 3) store_sums(i, 3u, capacity, s3);
}
