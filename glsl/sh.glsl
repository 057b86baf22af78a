// Real, orthonormal spherical harmonics of bands 0..3, index = l(l+1)+m, signs as in Sloan 2008. Twin: src/scene/sh.rs.
#ifndef HALFLIGHT_SH_GLSL
#define HALFLIGHT_SH_GLSL

// Y_lm(d) of a direction of unit length.
void sh_basis(vec3 d, precise out float y[16]) {
    float zz = d.z * d.z;
    float c2 = d.x * d.x - d.y * d.y; // sin²θ cos 2φ
    y[0] = 0.28209479177387814;
    y[1] = -0.48860251190291992 * d.y;
    y[2] = 0.48860251190291992 * d.z;
    y[3] = -0.48860251190291992 * d.x;
    y[4] = 1.0925484305920792 * d.x * d.y;
    y[5] = -1.0925484305920792 * d.y * d.z;
    y[6] = 0.94617469575756008 * zz - 0.31539156525252005;
    y[7] = -1.0925484305920792 * d.x * d.z;
    y[8] = 0.54627421529603959 * c2;
    y[9] = -0.59004358992664352 * d.y * (3.0 * d.x * d.x - d.y * d.y);
    y[10] = 2.8906114426405543 * d.x * d.y * d.z;
    y[11] = -0.45704579946446577 * d.y * (5.0 * zz - 1.0);
    y[12] = d.z * (1.8658816629505770 * zz - 1.1195289977703462);
    y[13] = -0.45704579946446577 * d.x * (5.0 * zz - 1.0);
    y[14] = 1.4453057213202771 * d.z * c2;
    y[15] = -0.59004358992664352 * d.x * (d.x * d.x - 3.0 * d.y * d.y);
}

#endif
