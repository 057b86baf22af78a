// Where a viewing ray first meets D >= iso, for isosurface and trace. Needs in scope: volume, iso, side, step_length,
// voxel_to_world_normal (of any scale near 1), metric_diagonal, metric_cross, ray.glsl and clip.glsl.
const int BISECTIONS = 12;

// A ray from where it enters the box (or from the eye), in normalised coordinates.
struct Line {
    vec3 eye;    // voxels
    vec3 d;      // voxels per world unit
    float begin; // world units from the eye, where it enters the box or what is kept of it
    float total; // to where it leaves the box
    vec3 dims;
    vec3 p0;
    vec3 dn;
};

Line line_of(vec3 eye, vec3 d, float begin, float end, vec3 dims) {
    vec3 scale = 1.0 / dims;
    return Line(eye, d, begin, end - begin, dims, (eye + d * begin) * scale, d * scale);
}

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
    vec3 w = -(mat3(voxel_to_world_normal) * near_one(g));
    float l = length(w);
    return l > 0.0 ? w / l : vec3(0.0);
}

float above_at(Line l, float t) {
    return above(l.p0 + l.dn * t);
}

// Takes steps from..to - 1 of step_length until one is inside: hi is the first that is, lo the last before it that is not.
// Returns the step that it came to.
uint search(Line l, uint from, uint to, inout float lo, inout float hi) {
    uint i = from;
    for (; i < to; i++) {
        float t = min(float(i) * step_length, l.total);
        if (above_at(l, t) >= 0.0) {
            hi = t;
            break;
        }
        lo = t;
    }
    return i;
}

// The surface lies between lo, outside, and hi, inside: halves that so many times.
void bisect(Line l, int times, inout float lo, inout float hi) {
    for (int i = 0; i < times; i++) {
        float middle = 0.5 * (lo + hi);
        if (above_at(l, middle) >= 0.0) hi = middle;
        else lo = middle;
    }
}

// World, length 1, out of the surface at t; cut_open: the volume's own face, or a clip plane, cuts it open there.
vec3 normal_at(Line l, float t, bool cut_open) {
    vec3 normal = outward_normal(l.p0 + l.dn * t, l.dims);
    if (cut_open && t == 0.0 && l.begin > 0.0) {
        // The face through which the ray enters: its normal is a gradient of one coordinate.
        vec3 a = min((vec3(0.0) - l.eye) / l.d, (l.dims - l.eye) / l.d);
        vec3 axis = vec3(0.0);
        if (a.x >= a.y && a.x >= a.z) axis.x = -sign(l.d.x);
        else if (a.y >= a.z) axis.y = -sign(l.d.y);
        else axis.z = -sign(l.d.z);
        if (CLIPS > 0u) {
            float last = max(max(a.x, a.y), a.z);
            for (uint k = 0u; k < CLIPS; k++) {
                vec4 n = clip_plane(k);
                float slope = dot(n.xyz, l.d);
                float t = -(dot(n.xyz, l.eye) + n.w) / slope;
                if (slope > 0.0 && t >= last) {
                    last = t;
                    axis = -n.xyz;
                }
            }
        }
        normal = normalize(mat3(voxel_to_world_normal) * near_one(axis));
    }
    if (normal == vec3(0.0)) {
        // Flat data has no gradient: face the viewer. The ray in world space is M d = M^-T (M^T M d).
        vec3 d = l.d;
        vec3 g = metric_diagonal * d + vec3(metric_cross.x * d.y + metric_cross.y * d.z, metric_cross.x * d.x + metric_cross.z * d.z,
            metric_cross.y * d.x + metric_cross.z * d.y);
        normal = -normalize(mat3(voxel_to_world_normal) * near_one(g));
    }
    return normal;
}
