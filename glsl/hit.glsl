// Where a viewing ray first meets D >= iso. Needs in scope: volume, iso, side, step_length, voxel_to_world_normal,
// metric_diagonal, metric_cross.
const int BISECTIONS = 12;
const int REFINEMENTS = 8; // further ones, for the start of shadow rays

struct Hit {
    float t;     // world units from the eye; below 0: none
    float start; // the last place before it that is surely vacuum: where shadow rays begin
    vec3 normal; // world, length 1, out of the surface
};

// D - iso, positive inside the surface; n: normalised coordinates.
float above(vec3 n) {
    return side * (textureLod(volume, n, 0.0).r - iso);
}

// World-space unit normal, pointing out of the surface; zero where the data is flat.
vec3 outward_normal(vec3 n, vec3 dims) {
    vec3 h = 1.0 / dims;
    vec3 g = vec3(
        above(n + vec3(h.x, 0.0, 0.0)) - above(n - vec3(h.x, 0.0, 0.0)),
        above(n + vec3(0.0, h.y, 0.0)) - above(n - vec3(0.0, h.y, 0.0)),
        above(n + vec3(0.0, 0.0, h.z)) - above(n - vec3(0.0, 0.0, h.z)));
    vec3 w = -(mat3(voxel_to_world_normal) * g);
    float l = length(w);
    return l > 0.0 ? w / l : vec3(0.0);
}

// By steps of step_length, then bisection; the volume's own face may cut the surface open.
Hit find_hit(vec3 eye, vec3 d, vec2 span, vec3 dims) {
    Hit hit = Hit(-1.0, -1.0, vec3(0.0));
    float total = span.y - span.x;
    uint steps = uint(ceil(total / step_length));
    vec3 scale3 = 1.0 / dims;
    vec3 p0 = (eye + d * span.x) * scale3;
    vec3 dn = d * scale3;
    float lo = 0.0;
    float hi = above(p0) >= 0.0 ? 0.0 : -1.0;
    bool cut_open = hi == 0.0;
    for (uint i = 1u; i <= steps && hi < 0.0; i++) {
        float t = min(float(i) * step_length, total);
        if (above(p0 + dn * t) >= 0.0) hi = t;
        else lo = t;
    }
    if (hi < 0.0) return hit;
    for (int i = 0; i < BISECTIONS && !cut_open; i++) {
        float middle = 0.5 * (lo + hi);
        if (above(p0 + dn * middle) >= 0.0) hi = middle;
        else lo = middle;
    }
    float t = 0.5 * (lo + hi);
    hit.t = span.x + t;
    for (int i = 0; i < REFINEMENTS && !cut_open; i++) {
        float middle = 0.5 * (lo + hi);
        if (above(p0 + dn * middle) >= 0.0) hi = middle;
        else lo = middle;
    }
    hit.start = span.x + lo;
    hit.normal = outward_normal(p0 + dn * t, dims);
    if (cut_open && span.x > 0.0) {
        // The face through which the ray enters: its normal is a gradient of one coordinate.
        vec3 a = min((vec3(0.0) - eye) / d, (dims - eye) / d);
        vec3 axis = vec3(0.0);
        if (a.x >= a.y && a.x >= a.z) axis.x = -sign(d.x);
        else if (a.y >= a.z) axis.y = -sign(d.y);
        else axis.z = -sign(d.z);
        hit.normal = normalize(mat3(voxel_to_world_normal) * axis);
    }
    if (hit.normal == vec3(0.0)) {
        // Flat data has no gradient: face the viewer. The ray in world space is M d = M^-T (M^T M d).
        vec3 g = metric_diagonal * d + vec3(metric_cross.x * d.y + metric_cross.y * d.z, metric_cross.x * d.x + metric_cross.z * d.z,
            metric_cross.y * d.x + metric_cross.z * d.y);
        hit.normal = -normalize(mat3(voxel_to_world_normal) * g);
    }
    return hit;
}
