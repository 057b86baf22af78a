// Clip planes: what is kept is convex, so a ray meets it in one interval, and every march is cut exactly at the plane
// (trilinear inside, vacuum beyond). Needs in scope: CLIPS, the number of planes, and vec4 clip_plane(uint k): n.p + w >= 0
// is kept, p in voxels. Without planes nothing is left of it. Twin: stages::twin::clip_span.
// Counted: 8 multiply-adds and a division per ray and plane.

// The kept part of a ray's interval; x > y where there is none.
vec2 clip_span(vec3 p, vec3 d, vec2 span) {
    if (CLIPS > 0u) {
        for (uint k = 0u; k < CLIPS; k++) {
            vec4 n = clip_plane(k);
            float at = dot(n.xyz, p) + n.w;
            float slope = dot(n.xyz, d);
            float t = -at / slope;
            if (slope > 0.0) span.x = max(span.x, t);
            if (slope < 0.0) span.y = min(span.y, t);
            if (slope == 0.0 && at < 0.0) span.y = span.x - 1.0;
        }
    }
    return span;
}

// Whether a place is kept.
bool is_kept(vec3 p) {
    bool kept = true;
    if (CLIPS > 0u) {
        for (uint k = 0u; k < CLIPS; k++) {
            vec4 n = clip_plane(k);
            kept = kept && dot(n.xyz, p) + n.w >= 0.0;
        }
    }
    return kept;
}
