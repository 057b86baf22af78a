// The eight field cells around a place on a surface: which of them say what light falls there. Only those in vacuum do: a cell
// centred inside the surface sees nothing. Where the volume's box cuts matter open there are no cells further out: nothing stands
// there, and the surface sees what an open plane sees. Where no cell around says anything, one field cell further out is looked at,
// and what is there taken. Needs in scope: hit.glsl. Counted: one tap per cell.
const uint SILENT = 0u;
const uint OPEN = 1u; // what an open plane sees
const uint SAYS = 2u; // what the field holds of `cell`

// Cell i of the eight around q, in cells from the first one's centre; last: there will be no further attempt. w: its trilinear weight.
uint cell_around(vec3 q, int i, vec3 field_dims, bool last, out ivec3 cell, out float w) {
    vec3 base = floor(q);
    vec3 f = q - base;
    vec3 o = vec3(i & 1, (i >> 1) & 1, i >> 2);
    vec3 wanted = base + o;
    vec3 c = clamp(wanted, vec3(0.0), field_dims - 1.0);
    cell = ivec3(c);
    vec3 w3 = mix(1.0 - f, f, o);
    w = w3.x * w3.y * w3.z;
    vec3 centre = (c + 0.5) / field_dims;
    bool vacuum = above(centre) < 0.0 || !is_kept(centre * vec3(textureSize(volume, 0)));
    if (w > 0.0 && !vacuum && wanted != c) return OPEN;
    return w > 0.0 && (vacuum || last) ? SAYS : SILENT;
}

// One field cell outwards, in cells: the world normal back to voxel space, its largest component made 1.
vec3 one_cell_out(vec3 normal, vec3 dims, vec3 field_dims) {
    vec3 outward = transpose(mat3(voxel_to_world_normal)) * normal * (1.0 / dims) * field_dims;
    float largest = max(max(abs(outward.x), abs(outward.y)), abs(outward.z));
    return largest > 0.0 ? outward / largest : vec3(0.0);
}
