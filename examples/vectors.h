/* vectors.h: vectors, colors, interpolation. World axes of the scenes: x to the right, y up, z towards the viewer. */

#ifndef EX_VECTORS_H
#define EX_VECTORS_H

#include "basics.h"

#define EX_PI 3.14159265358979323846

typedef struct ex_vec {
    double x, y, z;
} ex_vec;

static inline ex_vec ex_vec_of(double x, double y, double z) {
    const ex_vec r = {x, y, z};
    return r;
}
static inline ex_vec ex_vec_add(ex_vec a, ex_vec b) { return ex_vec_of(a.x + b.x, a.y + b.y, a.z + b.z); }
static inline ex_vec ex_vec_sub(ex_vec a, ex_vec b) { return ex_vec_of(a.x - b.x, a.y - b.y, a.z - b.z); }
static inline ex_vec ex_vec_scale(ex_vec a, double s) { return ex_vec_of(a.x * s, a.y * s, a.z * s); }
static inline double ex_vec_dot(ex_vec a, ex_vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static inline double ex_vec_length(ex_vec a) { return sqrt(ex_vec_dot(a, a)); }
static inline ex_vec ex_vec_cross(ex_vec a, ex_vec b) {
    return ex_vec_of(a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x);
}
static inline ex_vec ex_vec_unit(ex_vec a) {
    const double length = ex_vec_length(a);
    return length > 0 ? ex_vec_scale(a, 1 / length) : a;
}
/* A unit vector perpendicular to `a`. */
static inline ex_vec ex_vec_perpendicular(ex_vec a) {
    return ex_vec_unit(ex_vec_cross(a, fabs(a.y) < 0.9 * ex_vec_length(a) ? ex_vec_of(0, 1, 0) : ex_vec_of(1, 0, 0)));
}
/* The dot product of packed vectors. */
static inline double ex_dot(const double a[3], const double b[3]) { return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]; }
static inline double ex_clamp(double x, double low, double high) { return x < low ? low : x > high ? high : x; }
static inline double ex_mix(double a, double b, double t) { return a + (b - a) * t; }
/* 0 below `low`, 1 above `high`, smooth in between. */
static inline double ex_ramp(double low, double high, double x) {
    const double t = ex_clamp((x - low) / (high - low), 0, 1);
    return t * t * (3 - 2 * t);
}

/* Colors are linear RGB. */
static inline void ex_color(float out[3], double r, double g, double b) {
    out[0] = (float)r, out[1] = (float)g, out[2] = (float)b;
}
static inline void ex_store(float out[3], ex_vec v) { ex_color(out, v.x, v.y, v.z); }

#endif /* EX_VECTORS_H */
