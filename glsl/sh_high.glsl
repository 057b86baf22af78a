// Real orthonormal spherical harmonics of the bands in which the clamped cosine has energy: l = 0, 1, 2, 4, 6.
// Signs as in Sloan 2008. Order: bands ascending, m from -l to l: 1 + 3 + 5 + 9 + 13 values.

#define SH_HIGH_COUNT 31

void sh_even(vec3 w, out float y[SH_HIGH_COUNT]) {
    const int first[7] = int[7](0, 2, 6, -1, 13, -1, 24); // position of (l, 0); -1: band not kept
    float c = 1.0; // Re (x + iy)^m, with the Condon-Shortley sign (-1)^m
    float s = 0.0; // Im
    float sectoral = 0.28209479177387814; // normalised P_m^m / sin^m
    for (int m = 0; m <= 6; m++) {
        if (m > 0) {
            float c_next = -(c * w.x - s * w.y);
            s = -(c * w.y + s * w.x);
            c = c_next;
            sectoral *= sqrt(float(2 * m + 1) / float(2 * m));
        }
        float scale = m == 0 ? 1.0 : 1.4142135623730951;
        float before = 0.0;
        float p = sectoral; // normalised P_l^m / sin^m, from l = m upwards
        for (int l = m; l <= 6; l++) {
            if (l > m) {
                float ll = float(l * l);
                float mm = float(m * m);
                float l1 = float((l - 1) * (l - 1));
                float a = sqrt((4.0 * ll - 1.0) / (ll - mm));
                float b = sqrt((l1 - mm) / (4.0 * l1 - 1.0));
                float next = a * (w.z * p - b * before);
                before = p;
                p = next;
            }
            if (first[l] >= 0) {
                y[first[l] + m] = scale * c * p;
                if (m > 0) y[first[l] - m] = scale * s * p;
            }
        }
    }
}
