// A ray's way through the grid of majorant cells (Amanatides and Woo 1987). Needs in scope: CELL, the voxels along a
// cell's edge. Distances are the ray's own, world units.
struct Walk {
    ivec3 cell;
    ivec3 stride;
    vec3 next;   // where the ray leaves the cell along each axis
    vec3 across; // from one face to the next along each axis
};

Walk walk_from(vec3 p, vec3 d, float t, ivec3 cells) {
    Walk w;
    w.cell = clamp(ivec3(floor((p + d * t) / float(CELL))), ivec3(0), cells - 1);
    w.stride = ivec3(sign(d));
    w.next = (vec3((w.cell + max(w.stride, ivec3(0))) * int(CELL)) - p) / d;
    w.across = float(CELL) / abs(d);
    return w;
}

float walk_boundary(Walk w) {
    return min(min(w.next.x, w.next.y), w.next.z);
}

// Into the next cell; false where there is none.
bool walk_on(inout Walk w, ivec3 cells) {
    bvec3 least = lessThanEqual(w.next, vec3(walk_boundary(w)));
    w.cell += ivec3(least) * w.stride;
    w.next += vec3(least) * w.across;
    return all(greaterThanEqual(w.cell, ivec3(0))) && all(lessThan(w.cell, cells));
}
